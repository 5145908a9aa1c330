"""Flight of others, as an import makes it: messages by topic, and what was changed or left out.

Poses stand where those of our own flights do (``/measured``); commands have a channel of their own
(``/imported/…``), so that nobody takes them for ours.
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundstation.core.messages import Pose
from groundstation.recording import CHANNELS, MeasuredMessage, Quaternion, Vector3, quaternion

Column = NDArray[np.float64]
Positive = Annotated[float, msgspec.Meta(ge=0.001)]
"""A mass [kg], a time constant [s], a gain [1/s] or a rate [1/s]."""

FASTEST_RAD_S = 100.0
"""No vehicle turns faster [rad/s]: a set-point that asks for more is not believed."""


class MappedVehicle(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Known figures of the vehicle; those that a flight shows by itself may be left out."""

    mass_kg: Positive = 1.0
    thrust_lag_s: Positive = 0.05
    thrust_delay_s: Annotated[float, msgspec.Meta(ge=0.0)] = 0.0
    """Thrust follows its signal so much later than the turns follow theirs [s]."""
    rate_lag_s: Positive = 0.05
    thrust_curve: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    """f of thrust = f u² + (1 - f) u, from signal to thrust [-]."""
    attitude_p: Positive = 6.5
    """Gain of the autopilot's attitude loop, from attitude set-points to body rates [1/s]."""


class ImportedSetpoint(msgspec.Struct, frozen=True, gc=False):
    """Command to the vehicle in a flight of others."""

    time_s: float
    thrust: float
    """Signal of the collective thrust, as a share of the full one [0..1]."""
    rates_rad_s: Vector3 | msgspec.UnsetType = msgspec.UNSET
    """Body rates, FRD."""
    attitude: Quaternion | msgspec.UnsetType = msgspec.UNSET
    """Body FRD to world NED."""


class ImportedState(msgspec.Struct, frozen=True, gc=False):
    """Whether the autopilot said that it may be flying: armed, and not on the ground."""

    time_s: float
    may_fly: bool


MEASURED = "/measured"
SETPOINT = "/imported/setpoint"
STATE = "/imported/state"
IMPORTED: dict[str, tuple[str, type[msgspec.Struct]]] = {
    MEASURED: CHANNELS[MEASURED],
    SETPOINT: ("groundstation.ImportedSetpoint", ImportedSetpoint),
    STATE: ("groundstation.ImportedState", ImportedState),
}
"""Topic → name of its schema, and type of its messages."""


@dataclass
class ImportedFlight:
    """A flight as it will be written."""

    begun_s: float
    """The first pose on the clock of the file [s]: times count from here."""
    messages: list[tuple[float, str, Any]] = field(default_factory=list)
    """Time [s], topic and message."""
    hover: float | None = None
    """Thrust signal that hovers, where the source tells."""
    missing: list[str] = field(default_factory=list)
    notes: Counter[str] = field(default_factory=Counter)
    """Number of entries changed or left out, by reason."""

    def of(self, topic: str) -> list[Any]:
        """Messages of a topic."""
        return [message for _, name, message in self.messages if name == topic]

    def add_pose(self, pose: Pose, number: int) -> None:
        """Add a pose, at its arrival."""
        velocity = msgspec.UNSET if pose.velocity_ned is None else Vector3(*pose.velocity_ned)
        at, attitude = Vector3(*pose.position_ned), quaternion(pose.attitude)
        message = MeasuredMessage(
            pose.time_s, pose.arrival_s, number, at, attitude, pose.reset_count, velocity
        )
        self.messages.append((pose.arrival_s, MEASURED, message))
