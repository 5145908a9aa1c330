"""What a flight hands to its recorder, in the order in which it happened: everything that it takes to fly it again.

And the headline of a flight, as a list of flights shows it: how long, how well, how it ended.
"""

from typing import Any

import msgspec

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import (
    EndRecord,
    IdleRecord,
    PoseRecord,
    RequestRecord,
    StatusRecord,
    SteadyError,
    SwitchRecord,
    TickRecord,
    TrajectoryRecord,
)

Peer = tuple[str, int] | None
"""Address of the other end; None on a wire that has only one."""
MAGIC = b"\x89MCAP0\r\n"
"""How an MCAP file begins, and ends."""
NO_PORT = -1
"""Stands behind the name of a serial port, which is no network address."""


class About(msgspec.Struct, frozen=True, kw_only=True):
    """What is known before the flight: the first thing in a recording."""

    config: str
    """The whole configuration, as TOML."""
    vehicle: str
    """Its name in the configuration."""
    controller: str
    trajectory: str
    period_s: float
    """Time between two commands [s]; 0 where they follow the poses, or where the link tells only once connected: then
    each :class:`StatusRecord` has it."""
    mavlink: str = ""
    """Address of the wire that carries MAVLink; empty where none does."""
    clock: str = "real"
    """``real`` or ``virtual`` time."""
    started: str = ""
    """Wall time when the recording began; empty in virtual time."""
    scenario: str = ""
    """Of a simulated flight, as all below."""
    seed: int | None = None
    sim: str = ""
    """The simulated truth, as TOML."""


class WireRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=1):
    """A wire was opened; ``wire`` numbers it from 0."""

    time_s: float
    wire: int
    kind: str
    """``udp``, ``tcp`` or ``serial``."""
    local: Peer
    """As it was asked for."""
    remote: Peer


class ReceivedRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=2):
    """Bytes came in."""

    time_s: float
    wire: int
    turn: int
    """Turn of the event loop: no task ran between two arrivals of the same turn."""
    peer: Peer
    data: bytes


class SentRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=3):
    """Bytes left."""

    time_s: float
    wire: int
    peer: Peer
    data: bytes


class LineRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=8):
    """A line for the operator."""

    time_s: float
    state: str
    """Mission state."""
    text: str


class LossRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=11):
    """So many records are missing here: whoever writes them could not keep up."""

    time_s: float
    count: int


class TruthRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=14):
    """Where a simulated vehicle really is at the instant of a command; no controller sees it."""

    time_s: float
    position_ned: Vec3
    velocity_ned: Vec3
    attitude: Quat
    wind_m_s2: Vec3
    """The true disturbance, without the effect of wrong thrust or mass."""
    error_m: float | None
    """From the reference of that instant; None where no trajectory is flown yet."""


Record = (
    WireRecord
    | ReceivedRecord
    | SentRecord
    | PoseRecord
    | TrajectoryRecord
    | IdleRecord
    | TickRecord
    | LineRecord
    | RequestRecord
    | StatusRecord
    | LossRecord
    | EndRecord
    | SwitchRecord
    | TruthRecord
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
