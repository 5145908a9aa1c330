"""What a simulated autopilot may do to, and learn of, the vehicle it sits on."""

from typing import Protocol

import msgspec

from groundstation.core.geometry import Quat, Vec3


class Truth(msgspec.Struct, frozen=True, gc=False):
    """The exact state of the simulated vehicle at one instant."""

    time_s: float
    """Event loop's clock [s]."""
    position_ned: Vec3
    """[m]"""
    velocity_ned: Vec3
    """[m/s]"""
    attitude: Quat
    """Body FRD to world NED, w first."""
    rates_rad_s: Vec3
    """Body rates, FRD [rad/s]."""
    thrust_n: float
    """Thrust the rotors give now [N]."""
    on_ground: bool
    """True while it rests on the floor (not while it is held in the air)."""
    resets: int = 0
    """How often the estimator that measured it has moved its origin or heading."""


class Airframe(Protocol):
    """Motors, body and sensors as the autopilot on board sees them. Times never go backwards."""

    def act(self, time_s: float, thrust_fraction: float, rates_rad_s: Vec3) -> None:
        """From ``time_s`` on, follow a thrust signal (0..1) and body rates [rad/s, FRD]."""
        ...

    def power(self, time_s: float, on: bool) -> None:
        """Motors on (armed) or off; off means no thrust whatever ``act`` says."""
        ...

    def release(self, time_s: float) -> None:
        """Let go of a vehicle that is held in the air until it obeys; does nothing afterwards."""
        ...

    def truth(self, time_s: float) -> Truth:
        """The exact state at ``time_s``."""
        ...

    def measured(self, time_s: float) -> Truth:
        """The same with the noise of the vehicle's own position estimate."""
        ...

    def felt(self, time_s: float) -> tuple[Quat, Vec3]:
        """Attitude and body rates [rad/s] as its own estimator has them, by gyros and accelerometers."""
        ...
