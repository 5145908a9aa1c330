"""Headline of a flight, counted from its messages: how long, how well, how it ended. Sans-IO."""

import msgspec

from groundstation.core.messages import SteadyError
from groundstation.recording.channels import (
    CommandMessage,
    ErrorsMessage,
    LostMessage,
    MeasuredMessage,
    MissionMessage,
)


class FlightHeadline(msgspec.Struct, frozen=True, kw_only=True):
    """The figures of one flight."""

    state: str
    """Mission state at the end."""
    reason: str
    flown_s: float
    """Time on the trajectory [s]."""
    commands: int
    poses: int
    rms_m: float | None
    """Root mean square distance of the estimate from the reference over the steady part [m], if
    there was one."""
    max_m: float | None
    """Largest such distance [m]."""
    true_rms_m: float | None = None
    """RMS error of a simulated vehicle's true place, at every step of the simulation [m]; None of a
    real flight."""
    true_max_m: float | None = None
    lost: int
    """Records that are missing because the recorder could not keep up."""


TOPICS = ("/command", "/errors", "/measured", "/mission", "/lost")
"""Channels that the headline is counted from."""


class HeadlineCounter:
    """Counts the headline from the messages of a flight, in their order."""

    def __init__(self) -> None:
        self._state = "idle"
        self._reason = ""
        self._flight_time_s = 0.0
        self._flown_s = 0.0
        self._commands = 0
        self._poses = 0
        self._lost = 0
        self._steady = SteadyError()

    def add(self, message: msgspec.Struct) -> None:
        """Count one message; messages of other channels change nothing."""
        match message:
            case CommandMessage():
                self._commands += 1
                self._flight_time_s = message.flight_time_s
            case ErrorsMessage():
                if self._state == "tracking" and self._flight_time_s >= 0.0:
                    self._flown_s = self._flight_time_s
                    self._steady.add(self._flown_s, message.error_m)
            case MeasuredMessage():
                self._poses += 1
            case MissionMessage():
                # The first line of a state says why it was entered.
                if message.state != self._state:
                    self.end_flight(message.state, message.text)
            case LostMessage():
                self._lost += message.count

    def end_flight(self, state: str, reason: str) -> None:
        """Set the state at the end, and its reason."""
        self._state, self._reason = state, reason

    def headline(self) -> FlightHeadline:
        """Return the figures so far."""
        return FlightHeadline(
            state=self._state,
            reason=self._reason,
            flown_s=self._flown_s,
            commands=self._commands,
            poses=self._poses,
            rms_m=self._steady.rms_m,
            max_m=self._steady.max_m,
            lost=self._lost,
        )
