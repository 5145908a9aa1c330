"""A trajectory of the user's own, loaded by name: ``trajectory.kind = "package.module:factory"``."""

import inspect
import math
from collections.abc import Sequence
from itertools import chain
from typing import Annotated, Any, ClassVar

import msgspec

from groundstation.config import (
    FACTORY,
    ConfigError,
    Open,
    Option,
    UserCodeFault,
    call_factory,
    expand_factory,
    find_object,
    needed_names,
)
from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.port import Reference, Trajectory

KEY = "trajectory.kind"
LOOKED_AT_S = 60.0
"""So much of a curve is looked at before the flight that does not say when it ends or repeats [s]."""


class OwnTrajectoryConfig(
    Open, msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="custom"
):
    """A factory and its options. Written shorter: ``kind = "package.module:factory"``, options beside it."""

    EXAMPLE: ClassVar[str] = "package.module:factory"
    factory: Annotated[str, msgspec.Meta(pattern=FACTORY)]
    """Where the trajectory comes from: ``package.module:factory``, called as factory(options) or factory(), whose
    result has at(time_s) -> Reference; or a function of the time [s] that returns the Reference itself."""
    options: dict[str, Option] = msgspec.field(default_factory=dict)
    """What the factory gets."""

    @classmethod
    def expand(cls, table: dict[str, Any]) -> dict[str, Any]:
        """``table`` in this struct's own form where its ``kind`` names a factory, else as it is."""
        return expand_factory(cls, table)

    def build(self) -> Trajectory:
        """The user's trajectory.

        Raises:
            ConfigError: it can't be imported, is not there, fails, or makes no trajectory.
        """
        found = find_object(KEY, self.factory)
        needed = needed_names(found, self.options) if inspect.isroutine(found) else None
        if needed is not None and len(needed) == 1 and needed != ["options"]:
            return OwnTrajectory(found, found, self.factory)
        made = call_factory(KEY, self.factory, found, (), self.options)
        if not callable(getattr(made, "at", None)):
            raise ConfigError(KEY, f"{self.factory} made a {type(made).__name__} without at(time_s) -> Reference")
        return OwnTrajectory(made, made.at, self.factory)


class OwnTrajectory:
    """Any curve; what it leaves out of :class:`Trajectory` is made up for, and what is no reference ends the flight."""

    def __init__(self, curve: Any, at: Any, name: str) -> None:
        """``at`` is asked for references; ``curve`` may tell when it ends, and ``name`` is for the operator.

        Raises:
            ConfigError: it gives no reference for its beginning.
        """
        self._curve, self._at, self._name = curve, at, name
        duration = getattr(curve, "duration_s", None)
        self.duration_s: float | None = None if duration is None else float(duration)
        """It rests at its last point from then on [s]; None where it never ends, or does not say."""
        try:
            self.at(0.0)
        except UserCodeFault as fault:
            raise ConfigError(KEY, str(fault)) from fault.__cause__

    @property
    def joints_s(self) -> Sequence[float]:
        """Its own, or from its beginning to its end, to one turn, or to where nobody looks further [s]."""
        end = self.duration_s or float(getattr(self._curve, "period_s", LOOKED_AT_S))
        joints: Sequence[float] | None = getattr(self._curve, "joints_s", None)
        return (0.0, end) if joints is None else joints

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        return self.at(time_s).position_ned

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]; numbers may be any that Python makes floats of.

        Raises:
            UserCodeFault: the user's code failed, or this is no reference of finite numbers.
        """
        rests = self.duration_s is not None and time_s >= self.duration_s
        try:
            found = self._at(self.duration_s if rests else time_s)
        except Exception as error:
            raise UserCodeFault(f"trajectory {self._name}", error) from error
        if not isinstance(found, Reference):
            raise UserCodeFault(f"trajectory {self._name} returned a {type(found).__name__}, not a Reference")
        try:
            position, *derivatives = [
                (float(x), float(y), float(z))
                for x, y, z in (found.position_ned, found.velocity_ned, found.acceleration_ned, found.jerk_ned)
            ]
            yaw, yaw_rate = float(found.yaw_rad), float(found.yaw_rate_rad_s)
        except (TypeError, ValueError):
            raise UserCodeFault(f"trajectory {self._name}: expected vectors of three numbers in {found}") from None
        if not all(map(math.isfinite, (yaw, yaw_rate, *position, *chain(*derivatives)))):
            raise UserCodeFault(f"trajectory {self._name} asked for {found} at {time_s:g} s")
        if rests:
            return Reference(position, yaw_rad=yaw)
        velocity, acceleration, jerk = derivatives
        return Reference(position, velocity, acceleration, jerk, yaw, yaw_rate)
