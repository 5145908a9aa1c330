"""Records that a flight hands to its recorder, in the order of the events, for a replay."""

import msgspec

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import (
    EndRecord,
    IdleRecord,
    Numbers,
    PoseRecord,
    RequestRecord,
    StatusRecord,
    SwitchRecord,
    TickRecord,
    TrajectoryRecord,
)

Peer = tuple[str, int] | None
"""Address of the other end; None on a wire that has only one."""
MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of an MCAP file."""
NO_PORT = -1
"""Stands behind the name of a serial port, which is no network address."""


class About(msgspec.Struct, frozen=True, kw_only=True):
    """Facts known before the flight: the first record of a recording."""

    config: str
    """The whole configuration, as TOML."""
    vehicle: str
    """Its name in the configuration."""
    controller: str
    trajectory: str
    period_s: float
    """Time between two commands [s]; 0 where they follow the poses, or where the link tells only
    once connected: then each :class:`StatusRecord` has it."""
    mavlink: str = ""
    """Address of the wire that carries MAVLink; empty where none does."""
    clock: str = "real"
    """``real`` or ``virtual`` time."""
    started: str = ""
    """Wall time when the recording began; empty in virtual time."""
    scenario: str = ""
    """Name of a simulated flight's scenario."""
    seed: int | None = None
    sim: str = ""
    """The simulated truth, as TOML."""


class WireRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """A wire was opened; ``wire`` numbers it from 0."""

    time_s: float
    wire: int
    kind: str
    """``udp``, ``tcp`` or ``serial``."""
    local: Peer
    """As it was asked for."""
    remote: Peer


class ReceivedRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """Bytes came in."""

    time_s: float
    wire: int
    turn: int
    """Turn of the event loop: no task ran between two arrivals of the same turn."""
    peer: Peer
    data: bytes


class SentRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """Bytes left."""

    time_s: float
    wire: int
    peer: Peer
    data: bytes


class LineRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """A line for the operator."""

    time_s: float
    state: str
    """Mission state."""
    text: str
    id: str = ""
    """Which sentence it is (docs/reference/messages.md)."""
    numbers: Numbers = {}


class LossRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """Number of records that are missing here: the writer could not keep up."""

    time_s: float
    count: int


class TruthRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """Where a simulated vehicle really is at the instant of a command; no controller sees it."""

    time_s: float
    position_ned: Vec3
    velocity_ned: Vec3
    attitude: Quat
    wind_m_s2: Vec3
    """The true disturbance, without the effect of wrong thrust or mass."""
    error_m: float | None
    """Distance from the reference of that instant [m]; None before a trajectory is flown."""


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
