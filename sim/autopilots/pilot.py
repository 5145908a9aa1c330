"""What a simulated autopilot flies by itself: an attitude, a climb, a level descent. Plain P and PI loops."""

import math
from typing import Protocol

from groundstation.core.geometry import Quat, Vec3, so3
from sim.world import Truth

ATTITUDE_GAIN = 5.0
"""Body rate per attitude error [1/s]."""
DESCENT_M_S = 0.5
"""Speed of the descent [m/s]."""
SPEED_GAIN, SPEED_INTEGRAL_GAIN = 4.0, 2.0
"""Acceleration per error of that speed [1/s], and per its integral [1/s²]: PX4's MPC_Z_VEL_P_ACC and _I_ACC."""
INTEGRAL_LIMIT = 5.0
"""Largest acceleration by the integral [m/s²]."""
BRAKING_GAIN, BRAKING_LEAN = 1.8, math.radians(15.0)
"""Acceleration per horizontal speed [1/s], PX4's MPC_XY_VEL_P_ACC, and how far it leans for that at most [rad]."""
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


class Climb:
    """Keep a vertical speed; turn as told, or level out."""

    def __init__(self, hover: float, climb_m_s: float, rates_rad_s: Vec3 | None, begin_s: float) -> None:
        """``hover`` is the thrust 0..1 that about holds the vehicle (PX4: MPC_THR_HOVER); no rates: level out."""
        self._hover = hover
        self._climb = climb_m_s
        self._rates = rates_rad_s
        self._time_s = begin_s
        self._integral = 0.0

    def fly(self, truth: Truth) -> tuple[float, Vec3]:
        """Thrust towards the vertical speed, and the rates."""
        elapsed, self._time_s = truth.time_s - self._time_s, truth.time_s
        if truth.on_ground and self._climb <= 0.0:
            return 0.0, (0.0, 0.0, 0.0)
        too_fast = truth.velocity_ned[2] + self._climb
        integral = self._integral + SPEED_INTEGRAL_GAIN * too_fast * elapsed
        self._integral = min(max(integral, -INTEGRAL_LIMIT), INTEGRAL_LIMIT)
        upward = SPEED_GAIN * too_fast + self._integral
        down = so3.to_body(truth.attitude, (0.0, 0.0, 1.0))
        thrust = self._hover * (1.0 + upward / GRAVITY) / max(down[2], 0.5)
        level = (-ATTITUDE_GAIN * down[1], ATTITUDE_GAIN * down[0], 0.0)
        return min(max(thrust, 0.0), 1.0), level if self._rates is None else self._rates


class Descend(Climb):
    """Level out, come down slowly, stop the rotors on the ground."""

    def __init__(self, hover: float, begin_s: float, *, brakes: bool = False) -> None:
        """``hover``: see the base; one that ``brakes`` knows its speed, and leans against it."""
        super().__init__(hover, -DESCENT_M_S, None, begin_s)
        self._brakes = brakes

    def fly(self, truth: Truth) -> tuple[float, Vec3]:
        """Thrust towards the vertical speed, and the rates."""
        thrust, rates = super().fly(truth)
        if not self._brakes or truth.on_ground:
            return thrust, rates
        north, east, _ = truth.velocity_ned
        most = math.tan(BRAKING_LEAN)
        push = math.hypot(north, east) * BRAKING_GAIN / GRAVITY
        share = BRAKING_GAIN / GRAVITY * (1.0 if push <= most else most / push)
        # Where the body's z axis shall point: its thrust, along -z, against the speed.
        x, y, z = so3.to_body(truth.attitude, (share * north, share * east, 1.0))
        # Position controllers ask for the thrust that the wanted attitude needs, not for more while it leans farther.
        thrust *= max(so3.third_column(truth.attitude)[2], 0.5)
        n = 1.0 / math.sqrt(x * x + y * y + z * z)
        return thrust, (-ATTITUDE_GAIN * y * n, ATTITUDE_GAIN * x * n, 0.0)
