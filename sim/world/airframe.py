"""Airframe: the vehicle as its autopilot uses it, with motors that may be off and its own estimate.

Attitude estimators are seen to do this: between two corrections the estimate turns as the body
does, to a hundredth of a degree; it is off by a few tenths of a degree, which wander over many
seconds; and an estimator that knows no accelerations takes a part of a lasting tilt for level, as
the accelerometers of a tilted multirotor show no tilt while it accelerates freely.
"""

import math
from collections.abc import Iterator
from typing import Protocol

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3
from links.core import thrust
from sim.world.quadrotor import Quadrotor, TrueState
from sim.world.world import World


class Airframe(Protocol):
    """Motors, body and sensors as the autopilot on board uses them. Times never go backwards."""

    def act(self, time_s: float, thrust_fraction: float, rates_rad_s: Vec3) -> None:
        """Follow a thrust signal (0..1) and body rates [rad/s, FRD] from ``time_s`` on."""

    def power(self, time_s: float, on: bool) -> None:
        """Switch the motors on (armed) or off: without thrust, whatever ``act`` gets."""

    def release(self, time_s: float) -> None:
        """Release a vehicle that is held in the air until it follows; does nothing afterwards."""

    def truth(self, time_s: float) -> TrueState:
        """Return the exact state at ``time_s``."""

    def measure(self, time_s: float) -> TrueState:
        """Return the true state with the noise of the vehicle's own position estimate."""

    def estimate_attitude(self, time_s: float) -> tuple[Quat, Vec3]:
        """Return attitude and body rates [rad/s] by its own estimator, from gyros and
        accelerometers.
        """


LOOP_S = 0.004
"""Period of the autopilot's attitude loop [s], whose newest result is sent. Chosen."""
WANDER_RAD = math.radians(0.5)
"""Tilt error of the autopilot's estimate on each axis, 1σ [rad]. Chosen."""
TILT_WANDER_S = 10.0
"""Correlation time of that error [s]. Chosen."""
TILT_GAIN_PER_S = 0.1
"""Gain of the accelerometers' correction of the tilt [1/s]. Chosen."""


class AttitudeEstimator:
    """Attitude estimator of one vehicle: tilt from gyros, corrected by accelerometers."""

    def __init__(self, normals: Iterator[tuple[float, ...]], gravity: float) -> None:
        """``normals`` gives rows of three standard normal numbers; ``gravity`` is in m/s²."""
        self._normals = normals
        self._gravity = gravity
        self._truth: TrueState | None = None
        self._wander: Vec3 = _scale(WANDER_RAD, next(normals))
        """Random error about each body axis [rad]."""
        self._tilt = (0.0, 0.0)
        """Slow mean of the acceleration north and east over gravity: the tilt [rad] by which
        accelerometers take the vehicle for upright."""

    def estimate_attitude(self, truth: TrueState) -> tuple[Quat, Vec3]:
        """Return the estimated attitude and body rates [rad/s] of ``truth``, which is no earlier
        than the last one.
        """
        last, self._truth = self._truth, truth
        if last is not None and truth.time_s > last.time_s:
            self._advance(last, truth, truth.time_s - last.time_s)
        age = math.fmod(truth.time_s, LOOP_S)
        rates = truth.rates_rad_s
        (a, b, c), (p, q, r), (north, east) = self._wander, rates, self._tilt
        attitude = so3.rotate(truth.attitude, (a - age * p, b - age * q, c - age * r))
        # A vehicle that accelerates north is tilted about west; the correction turns it about east.
        return so3.multiply(so3.rotate(so3.IDENTITY, (-east, north, 0.0)), attitude), rates

    def _advance(self, last: TrueState, truth: TrueState, dt_s: float) -> None:
        """Advance both errors by ``dt_s`` [s]."""
        keep = math.exp(-dt_s / TILT_WANDER_S)
        a, b, c = self._wander
        x, y, z = _scale(WANDER_RAD * math.sqrt(1.0 - keep * keep), next(self._normals))
        self._wander = (keep * a + x, keep * b + y, keep * c + z)
        (u, v, _), (u0, v0, _) = truth.velocity_ned, last.velocity_ned
        north, east = (
            (0.0, 0.0)
            if truth.on_ground
            else ((u - u0) / (dt_s * self._gravity), (v - v0) / (dt_s * self._gravity))
        )
        pull = 1.0 - math.exp(-dt_s * TILT_GAIN_PER_S)
        a, b = self._tilt
        self._tilt = (a + pull * (north - a), b + pull * (east - b))


def _scale(by: float, row: tuple[float, ...]) -> Vec3:
    x, y, z = row
    return by * x, by * y, by * z


class SimulatedVehicle:
    """Implements :class:`Airframe` on a :class:`sim.world.quadrotor.Quadrotor`."""

    def __init__(
        self,
        plant: Quadrotor,
        world: World,
        noise: Iterator[tuple[float, ...]],
        wander: Iterator[tuple[float, ...]],
        estimator: AttitudeEstimator | None = None,
    ) -> None:
        """Begin with motors off; ``noise`` gives rows of six, ``wander`` of three standard normal
        numbers for :meth:`measure`.

        Without an ``estimator`` its attitude is that of :meth:`measure`, as where its own estimate
        serves as the poses.
        """
        self.plant = plant
        self._world = world
        self._noise = noise
        self._heading_error_deg = 0.0
        self._resets = 0
        self._wander = PositionWander(world, wander)
        self._estimator = estimator
        self._on = False

    def act(self, time_s: float, thrust_fraction: float, rates_rad_s: Vec3) -> None:
        """Follow a thrust signal (0..1) and body rates [rad/s, FRD] from ``time_s`` on."""
        if self._on:
            share = thrust(thrust_fraction, self._world.thrust_curve)
            self.plant.command(time_s, share * self._world.thrust_max_n, rates_rad_s)

    def power(self, time_s: float, on: bool) -> None:
        """Switch the motors on or off."""
        self._on = on
        if not on:
            self.plant.command(time_s, 0.0, (0.0, 0.0, 0.0))

    def release(self, time_s: float) -> None:
        """Release the vehicle that is held in the air."""
        self.plant.release(time_s)

    def truth(self, time_s: float) -> TrueState:
        """Return the exact state."""
        return self.plant.truth(time_s)

    def measure(self, time_s: float) -> TrueState:
        """Return the state by its own estimator, with the noise that the scenario gives to
        poses.
        """
        truth = with_noise(self.plant.truth(time_s), self._world, next(self._noise))
        if self._world.floor_hold_s > 0.0:
            (north, east, down), (u, v, _), (higher, up) = (
                truth.position_ned,
                truth.velocity_ned,
                self.plant.floor.own_estimate,
            )
            truth = msgspec.structs.replace(
                truth, position_ned=(north, east, down - higher), velocity_ned=(u, v, -up)
            )
        if any(bias := self._world.velocity_bias):
            (u, v, w), (i, j, k) = truth.velocity_ned, bias
            truth = msgspec.structs.replace(truth, velocity_ned=(u + i, v + j, w + k))
        truth = self._wander.distort(truth, self.plant.released_s)
        if not (self._heading_error_deg or self._resets):
            return truth
        attitude = so3.multiply(
            so3.from_euler_zyx(0.0, 0.0, math.radians(self._heading_error_deg)), truth.attitude
        )
        return msgspec.structs.replace(truth, attitude=attitude, resets=truth.resets + self._resets)

    def disturb_heading(self, off_deg: float) -> None:
        """Turn the estimator's heading by ``off_deg`` [deg] without a reset, as a magnet does."""
        self._heading_error_deg = off_deg

    def reset_heading(self) -> None:
        """Have its estimator find its true heading, and report that reset."""
        self._heading_error_deg = 0.0
        self._resets += 1

    def estimate_attitude(self, time_s: float) -> tuple[Quat, Vec3]:
        """Return attitude and body rates [rad/s] by its own estimator."""
        if self._estimator is not None:
            return self._estimator.estimate_attitude(self.plant.truth(time_s))
        seen = self.measure(time_s)
        return seen.attitude, seen.rates_rad_s


def with_noise(truth: TrueState, world: World, normals: tuple[float, ...]) -> TrueState:
    """Return ``truth`` with the scenario's noise on position and attitude, by six standard normal
    numbers.
    """
    n, a, jitter = world.pose_noise_m, world.attitude_noise_rad, world.pose_jitter_s
    if n == 0.0 and a == 0.0:
        return truth
    (x, y, z), (i, j, k, roll, pitch, yaw) = truth.position_ned, normals
    if jitter:
        # The number that makes the noise of the yaw, which moves nothing, also makes the stamp's.
        late, (u, v, w) = jitter * yaw, truth.velocity_ned
        x, y, z = x + late * u, y + late * v, z + late * w
    return TrueState(
        truth.time_s,
        (x + n * i, y + n * j, z + n * k),
        truth.velocity_ned,
        so3.rotate(truth.attitude, (a * roll, a * pitch, a * yaw)),
        truth.rates_rad_s,
        truth.thrust_n,
        truth.on_ground,
        truth.resets,
    )


WANDER_S = 2.0
"""Time in which a position wanders by ``estimate_wander_m`` [s], 1σ per axis."""
WANDER_DECAY_S = 40.0
"""Time constant with which a position's wander decays [s]. Chosen."""
SPEED_PER_M = 1.5
"""Step of the measured velocity's wander per step of the position's [1/s]: PX4's is 5 cm/s in
0.5 s."""
SPEED_DECAY_S = 5.0
"""Time constant with which the velocity's wander decays [s]. Chosen."""


class PositionWander:
    """Wander of a measured position and yaw about the true ones."""

    def __init__(self, world: World, normals: Iterator[tuple[float, ...]]) -> None:
        """Begin without wander; ``normals`` gives rows of three standard normal numbers."""
        self._world = world
        self._normals = normals
        self._at_s: float | None = None
        self._position_m: Vec3 = (0.0, 0.0, 0.0)
        self._velocity_m_s: Vec3 = (0.0, 0.0, 0.0)

    def distort(self, truth: TrueState, released_s: float | None) -> TrueState:
        """Return ``truth`` with its wander. Times do not go backwards."""
        world = self._world
        if world.estimate_wander_m:
            elapsed = truth.time_s - (truth.time_s if self._at_s is None else self._at_s)
            self._at_s = truth.time_s
            keep = math.exp(-elapsed / WANDER_DECAY_S)
            step = world.estimate_wander_m * math.sqrt(elapsed / WANDER_S)
            (a, b, c), (i, j, k) = self._position_m, next(self._normals)
            self._position_m = a, b, c = (
                keep * a + step * i,
                keep * b + step * j,
                keep * c + step * k,
            )
            fade = math.exp(-elapsed / SPEED_DECAY_S)
            (d, e, f), step = self._velocity_m_s, SPEED_PER_M * step
            self._velocity_m_s = d, e, f = (
                fade * d + step * i,
                fade * e + step * j,
                fade * f + step * k,
            )
            (x, y, z), (u, v, w) = truth.position_ned, truth.velocity_ned
            truth = msgspec.structs.replace(
                truth, position_ned=(x + a, y + b, z + c), velocity_ned=(u + d, v + e, w + f)
            )
        if world.estimate_yaw_step_deg:
            if released_s is not None and truth.time_s - released_s >= world.estimate_yaw_step_s:
                return msgspec.structs.replace(truth, resets=1)
            half = math.radians(-0.5 * world.estimate_yaw_step_deg)
            turned = so3.multiply((math.cos(half), 0.0, 0.0, math.sin(half)), truth.attitude)
            truth = msgspec.structs.replace(truth, attitude=turned)
        return truth
