"""What a simulated autopilot flies by itself: holding an attitude, and coming down level. Plain P and PI loops."""

from typing import Protocol

from groundstation import so3
from groundstation.ops import Quat, Vec3
from sim.airframe import Truth

ATTITUDE_GAIN = 5.0
"""Body rate per attitude error [1/s]."""
DESCENT_M_S = 0.5
"""Speed of the descent [m/s]."""
SPEED_GAIN, SPEED_INTEGRAL_GAIN = 2.0, 1.0
"""Acceleration per error of that speed [1/s], and per its integral [1/s²]."""
INTEGRAL_LIMIT = 5.0
"""Largest acceleration by the integral [m/s²]."""
GRAVITY = 9.81
"""[m/s²]"""


class Pilot(Protocol):
    """A control loop on board."""

    def fly(self, truth: Truth) -> tuple[float, Vec3]:
        """Thrust 0..1 and body rates [rad/s] for the state ``truth``."""
        ...


class HoldAttitude:
    """Turn to an attitude and stay there, at a given thrust."""

    def __init__(self, attitude: Quat, thrust: float) -> None:
        """``attitude`` is body FRD to world NED; ``thrust`` 0..1."""
        self._attitude = so3.normalized(attitude)
        self._thrust = thrust

    def fly(self, truth: Truth) -> tuple[float, Vec3]:
        """Rates along the shortest turn."""
        x, y, z = so3.rotation_vector(so3.multiply(so3.conjugate(truth.attitude), self._attitude))
        return self._thrust, (ATTITUDE_GAIN * x, ATTITUDE_GAIN * y, ATTITUDE_GAIN * z)


class Descend:
    """Level out, come down slowly, stop the rotors on the ground."""

    def __init__(self, hover: float, begin_s: float) -> None:
        """``hover`` is the thrust 0..1 that about holds the vehicle (PX4: MPC_THR_HOVER)."""
        self._hover = hover
        self._time_s = begin_s
        self._integral = 0.0

    def fly(self, truth: Truth) -> tuple[float, Vec3]:
        """Rates towards level, thrust towards the speed of the descent."""
        elapsed, self._time_s = truth.time_s - self._time_s, truth.time_s
        if truth.on_ground:
            return 0.0, (0.0, 0.0, 0.0)
        too_fast = truth.velocity_ned[2] - DESCENT_M_S
        integral = self._integral + SPEED_INTEGRAL_GAIN * too_fast * elapsed
        self._integral = min(max(integral, -INTEGRAL_LIMIT), INTEGRAL_LIMIT)
        upward = SPEED_GAIN * too_fast + self._integral
        down = so3.to_body(truth.attitude, (0.0, 0.0, 1.0))
        thrust = self._hover * (1.0 + upward / GRAVITY) / max(down[2], 0.5)
        rates = (-ATTITUDE_GAIN * down[1], ATTITUDE_GAIN * down[0], 0.0)
        return min(max(thrust, 0.0), 1.0), rates
