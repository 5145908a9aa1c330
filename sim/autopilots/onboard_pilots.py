"""Control loops of the simulated autopilots: hold an attitude, climb, descend. Sans-IO.

Plain P and PI loops, which know the true state.
"""

import math
from typing import Protocol

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.vehicle import GRAVITY
from sim.world import TrueState

ATTITUDE_GAIN = 5.0
"""Body rate per attitude error [1/s]. Chosen: between PX4's MC_ROLL_P, 6.5, and
ArduCopter's ATC_ANG_RLL_P, 4.5."""
DESCENT_M_S = 0.5
"""Sink rate of a descent [m/s]: ArduCopter's LAND_SPEED."""
SPEED_GAIN = 4.0
"""Acceleration per error of the climb rate [1/s]: PX4's MPC_Z_VEL_P_ACC."""
SPEED_INTEGRAL_GAIN = 2.0
"""Acceleration per integral of that error [1/s²]: PX4's MPC_Z_VEL_I_ACC."""
INTEGRAL_LIMIT = 5.0
"""Largest acceleration by that integral [m/s²]. Chosen."""
BRAKING_GAIN = 1.8
"""Acceleration per horizontal speed [1/s]: PX4's MPC_XY_VEL_P_ACC."""
BRAKING_TILT_RAD = math.radians(15.0)
"""Largest tilt of that braking [rad]. Chosen."""


class OnboardPilot(Protocol):
    """Control loop on board."""

    def fly(self, truth: TrueState) -> tuple[float, Vec3]:
        """Return thrust (0..1) and body rates [rad/s, FRD] in the state ``truth``."""


class HoldAttitude:
    """Turn to an attitude and stay there, at a given thrust."""

    def __init__(self, attitude: Quat, thrust: float) -> None:
        """``attitude`` is body FRD to world NED; ``thrust`` 0..1."""
        self._attitude = so3.normalize(attitude)
        self._thrust = thrust

    def fly(self, truth: TrueState) -> tuple[float, Vec3]:
        """Return the thrust, and rates along the shortest turn."""
        x, y, z = so3.rotation_vector(so3.multiply(so3.conjugate(truth.attitude), self._attitude))
        return self._thrust, (ATTITUDE_GAIN * x, ATTITUDE_GAIN * y, ATTITUDE_GAIN * z)


class Climb:
    """Level out, and keep a vertical speed."""

    def __init__(self, hover: float, climb_m_s: float, begin_s: float) -> None:
        """``hover`` is the estimated hover thrust, 0..1 (PX4: MPC_THR_HOVER).

        ``climb_m_s`` is the wanted climb rate [m/s], ``begin_s`` the present instant [s].
        """
        self._hover = hover
        self._climb = climb_m_s
        self._time_s = begin_s
        self._integral = 0.0

    def fly(self, truth: TrueState) -> tuple[float, Vec3]:
        """Return thrust towards the climb rate, and rates to level."""
        elapsed, self._time_s = truth.time_s - self._time_s, truth.time_s
        if truth.on_ground:
            return 0.0, (0.0, 0.0, 0.0)
        too_fast = truth.velocity_ned[2] + self._climb
        integral = self._integral + SPEED_INTEGRAL_GAIN * too_fast * elapsed
        self._integral = min(max(integral, -INTEGRAL_LIMIT), INTEGRAL_LIMIT)
        upward = SPEED_GAIN * too_fast + self._integral
        down = so3.to_body(truth.attitude, (0.0, 0.0, 1.0))
        # More thrust as it is tilted, up to 60 degrees.
        thrust = self._hover * (1.0 + upward / GRAVITY) / max(down[2], 0.5)
        level = (-ATTITUDE_GAIN * down[1], ATTITUDE_GAIN * down[0], 0.0)
        return min(max(thrust, 0.0), 1.0), level


class Descend(Climb):
    """Level out, come down slowly, stop the rotors on the ground."""

    def __init__(self, hover: float, begin_s: float, *, brakes: bool = False) -> None:
        """``hover`` as in :class:`Climb`; ``brakes``: whether it knows its horizontal speed, and
        tilts against it.
        """
        super().__init__(hover, -DESCENT_M_S, begin_s)
        self._brakes = brakes

    def fly(self, truth: TrueState) -> tuple[float, Vec3]:
        """Return thrust towards the sink rate, and rates to level, or to the braking tilt."""
        thrust, rates = super().fly(truth)
        if not self._brakes or truth.on_ground:
            return thrust, rates
        north, east, _ = truth.velocity_ned
        most = math.tan(BRAKING_TILT_RAD)
        wanted = math.hypot(north, east) * BRAKING_GAIN / GRAVITY
        share = BRAKING_GAIN / GRAVITY * (1.0 if wanted <= most else most / wanted)
        # Wanted direction of the body's z axis: thrust, along -z, acts against the speed.
        x, y, z = so3.to_body(truth.attitude, (share * north, share * east, 1.0))
        # A position controller commands the thrust of the wanted attitude, not more while the
        # vehicle is tilted farther.
        thrust *= max(so3.third_column(truth.attitude)[2], 0.5)
        n = 1.0 / math.sqrt(x * x + y * y + z * z)
        return thrust, (-ATTITUDE_GAIN * y * n, ATTITUDE_GAIN * x * n, 0.0)
