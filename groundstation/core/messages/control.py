"""What an estimator hands to a controller, what a controller answers, and the two ports."""

from typing import NamedTuple, Protocol

from groundstation.core.geometry import Real, Vec3
from groundstation.core.messages.snapshot import Diagnostics
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Motion


class Estimate(NamedTuple):
    """The vehicle at the instant a command will act."""

    time_s: float
    """That instant, on the event loop's clock [s]."""
    motion: Motion
    """Position, velocity, attitude, thrust and body rates there."""
    disturbance: Vec3
    """The observer's disturbance d̂ [m/s², NED]."""
    disturbance_step: Vec3
    """What innovations since the last estimate ask b̂ to change by [m/s²] (raw composite form; else zero)."""
    effectiveness: Real = 1.0
    """λ̂: true thrust over told thrust [-]; the vehicle's told mass over it is what thrust seems to lift."""


class Decision(NamedTuple):
    """What a controller wants, and why."""

    drive: ActuatorCommand
    """Thrust [N] and body rates [rad/s, FRD], within the vehicle's limits."""
    saturated: bool
    """True where any of the four was clamped."""
    diagnostics: Diagnostics


class Controller(Protocol):
    """An estimate and a reference in, a command out. Sans-IO; state inside."""

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; ``interval_s`` [s] has passed since the last one (0 at the first)."""
        ...
