"""Headline of a flight, as a list of flights shows it: how long, how well, how it ended."""

from typing import Any

import msgspec

from groundstation.core.messages import SteadyError


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
    """Root mean square distance of the estimate from the reference over the steady part [m], if there was one."""
    max_m: float | None
    """Largest such distance [m]."""
    true_rms_m: float | None = None
    """The same of a simulated vehicle's true place, at every step of the simulation; None of a real flight [m]."""
    true_max_m: float | None = None
    lost: int
    """Records that are missing because the recorder could not keep up."""


class HeadlineCounter:
    """Keeps the headline as messages pass by."""

    def __init__(self) -> None:
        """Nothing has happened."""
        self._state, self._reason = "idle", ""
        self._flown = 0.0
        self._commands = self._poses = self._lost = 0
        self._steady = SteadyError()
        self._flight_time = 0.0

    def enter_state(self, state: str, text: str) -> None:
        """A line of the mission, in ``state``: the first of a state says why it was entered."""
        if state != self._state:
            self._state, self._reason = state, text

    def end_flight(self, state: str, reason: str) -> None:
        """The flight is over."""
        self._state, self._reason = state, reason

    def count_pose(self) -> None:
        """A pose was taken."""
        self._poses += 1

    def count_command(self, flight_time_s: float, error_m: float) -> None:
        """A command was made."""
        self._commands += 1
        if self._state != "tracking" or flight_time_s < 0.0:
            return
        self._flown = flight_time_s
        self._steady.add(flight_time_s, error_m)

    def count_missing(self, count: int) -> None:
        """Records went missing."""
        self._lost += count

    def read(self, topic: str, message: dict[str, Any]) -> None:
        """The same from a message of a recording."""
        if topic == "/command":
            self._flight_time = message["flight_time_s"]
        elif topic == "/errors":
            self.count_command(self._flight_time, message["error_m"])
        elif topic == "/measured":
            self.count_pose()
        elif topic == "/mission":
            self.enter_state(message["state"], message["text"])
        elif topic == "/lost":
            self.count_missing(message["count"])

    def headline(self) -> FlightHeadline:
        """The figures so far."""
        return FlightHeadline(
            state=self._state,
            reason=self._reason,
            flown_s=self._flown,
            commands=self._commands,
            poses=self._poses,
            rms_m=self._steady.rms_m,
            max_m=self._steady.max_m,
            lost=self._lost,
        )
