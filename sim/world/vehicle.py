"""Simulated vehicle as its autopilot sees it: a plant behind motors that may be off, and its own estimate. Sans-IO.

What attitude estimators are seen to do: between two corrections the estimate turns as the body does, to a hundredth of
a degree; it is off by a few tenths of a degree, which wander over many seconds; and one that knows no accelerations
takes a part of a lean that lasts for level, as a leaning multirotor's accelerometers show no lean while it accelerates
freely.
"""

import math
from collections.abc import Iterator

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3
from links.core import thrust
from sim.world.quadrotor import Quadrotor, TrueState
from sim.world.world import World

LOOP_S = 0.004
"""What is told is that of the newest turn of its loop [s]."""
WANDER_RAD, TILT_WANDER_S = math.radians(0.5), 10.0
"""How far it is off on each axis (1σ) [rad], and over how long that wanders [s]."""
UPRIGHT_PER_S = 0.1
"""How fast accelerometers pull it upright: a share of what they show to be wrong [1/s]."""
LONGEST_S = 0.1
"""What happened between two questions further apart is not taken for one acceleration [s]."""


class Horizon:
    """One vehicle's estimator."""

    def __init__(self, normals: Iterator[tuple[float, ...]], gravity: float) -> None:
        """``normals`` gives rows of three standard normal numbers; ``gravity`` is in m/s²."""
        self._normals = normals
        self._gravity = gravity
        self._truth: TrueState | None = None
        self._wander: Vec3 = _scale(WANDER_RAD, next(normals))
        self._pulled = (0.0, 0.0)

    def feel(self, truth: TrueState) -> tuple[Quat, Vec3]:
        """Attitude and body rates [rad/s] as estimated, while ``truth`` is so; never earlier than before."""
        last, self._truth = self._truth, truth
        if last is not None and truth.time_s > last.time_s:
            self._go_on(last, truth, truth.time_s - last.time_s)
        age = math.fmod(truth.time_s, LOOP_S)
        rates = truth.rates_rad_s
        (a, b, c), (p, q, r), (north, east) = self._wander, rates, self._pulled
        attitude = so3.rotate(truth.attitude, (a - age * p, b - age * q, c - age * r))
        # Who accelerates north leans nose down, about west; so pulled upright is about east.
        return so3.multiply(so3.rotate(so3.IDENTITY, (-east, north, 0.0)), attitude), rates

    def _go_on(self, last: TrueState, truth: TrueState, since: float) -> None:
        """Wander and be pulled for ``since`` [s]."""
        keep = math.exp(-since / TILT_WANDER_S)
        a, b, c = self._wander
        x, y, z = _scale(WANDER_RAD * math.sqrt(1.0 - keep * keep), next(self._normals))
        self._wander = (keep * a + x, keep * b + y, keep * c + z)
        (u, v, _), (u0, v0, _) = truth.velocity_ned, last.velocity_ned
        free = since <= LONGEST_S and not truth.on_ground
        north, east = ((u - u0) / (since * self._gravity), (v - v0) / (since * self._gravity)) if free else (0.0, 0.0)
        pull = 1.0 - math.exp(-since * UPRIGHT_PER_S)
        a, b = self._pulled
        self._pulled = (a + pull * (north - a), b + pull * (east - b))


def _scale(by: float, row: tuple[float, ...]) -> Vec3:
    x, y, z = row
    return by * x, by * y, by * z


class SimulatedVehicle:
    """Implements :class:`sim.world.quadrotor.Airframe` on a :class:`Quadrotor`."""

    def __init__(
        self,
        plant: Quadrotor,
        world: World,
        noise: Iterator[tuple[float, ...]],
        wander: Iterator[tuple[float, ...]],
        horizon: Horizon | None = None,
    ) -> None:
        """Motors off; ``noise`` gives rows of six, ``wander`` of three standard normal numbers for :meth:`measure`.

        Without a ``horizon`` its attitude is that of :meth:`measure`, as where its own estimate serves as the poses.
        """
        self.plant = plant
        self._world = world
        self._noise = noise
        self._astray, self._resets = 0.0, 0
        self._wander = PositionWander(world, wander)
        self._horizon = horizon
        self._on = False

    def act(self, time_s: float, thrust_fraction: float, rates_rad_s: Vec3) -> None:
        """From ``time_s`` on, follow a thrust signal (0..1) and body rates [rad/s, FRD]."""
        if self._on:
            share = thrust(thrust_fraction, self._world.thrust_curve)
            self.plant.command(time_s, share * self._world.thrust_max_n, rates_rad_s)

    def power(self, time_s: float, on: bool) -> None:
        """Motors on or off."""
        self._on = on
        if not on:
            self.plant.command(time_s, 0.0, (0.0, 0.0, 0.0))

    def release(self, time_s: float) -> None:
        """Let go of the vehicle that is held in the air."""
        self.plant.release(time_s)

    def truth(self, time_s: float) -> TrueState:
        """The exact state."""
        return self.plant.truth(time_s)

    def measure(self, time_s: float) -> TrueState:
        """The state with the noise that the scenario gives to poses, as its own estimator has it."""
        truth = with_noise(self.plant.truth(time_s), self._world, next(self._noise))
        if self._world.floor_hold_s > 0.0:
            (north, east, down), (u, v, _), (higher, up) = truth.position_ned, truth.velocity_ned, self.plant.felt
            truth = msgspec.structs.replace(truth, position_ned=(north, east, down - higher), velocity_ned=(u, v, -up))
        if any(bias := self._world.velocity_bias):
            (u, v, w), (i, j, k) = truth.velocity_ned, bias
            truth = msgspec.structs.replace(truth, velocity_ned=(u + i, v + j, w + k))
        truth = self._wander.distort(truth, self.plant.released_s)
        if not (self._astray or self._resets):
            return truth
        attitude = so3.multiply(so3.from_euler_zyx(0.0, 0.0, math.radians(self._astray)), truth.attitude)
        return msgspec.structs.replace(truth, attitude=attitude, resets=truth.resets + self._resets)

    def lead_heading_astray(self, off_deg: float) -> None:
        """From now on its estimator has its heading so far off [deg], as near a magnet, and does not know."""
        self._astray = off_deg

    def reset_heading(self) -> None:
        """Have its estimator find its true heading, and say that it has turned it."""
        self._astray = 0.0
        self._resets += 1

    def feel(self, time_s: float) -> tuple[Quat, Vec3]:
        """Attitude and body rates as its own estimator has them."""
        if self._horizon is not None:
            truth = self.plant.truth(time_s)
            attitude, (p, q, r) = self._horizon.feel(truth)
            if shake := TREMBLE_RAD_S * _tremble(truth, self._world):
                i, j, k, *_ = next(self._noise)
                p, q, r = p + shake * i, q + shake * j, r + shake * k
            return attitude, (p, q, r)
        seen = self.measure(time_s)
        return seen.attitude, seen.rates_rad_s


TREMBLE_M, TREMBLE_RAD, TREMBLE_RAD_S, LEGS_GIVE = 0.0025, 0.015, 0.3, 0.3
"""How a vehicle trembles that stands: place, attitude and rates, 1σ per axis [m, rad, rad/s], each times its thrust as
a share of its weight, up to the last of these [-]. Nothing is published; so much is seen beside our cameras' noise."""


def _tremble(truth: TrueState, world: World) -> float:
    """Its thrust as a share of its weight, where it trembles by it [-]."""
    if not (world.trembles and truth.on_ground):
        return 0.0
    return min(truth.thrust_n / (world.mass_kg * world.gravity), LEGS_GIVE)


def with_noise(truth: TrueState, world: World, normals: tuple[float, ...]) -> TrueState:
    """``truth`` with the scenario's noise on position and attitude, from six standard normal numbers."""
    n, a, jitter = world.pose_noise_m, world.attitude_noise_rad, world.pose_jitter_s
    if shake := _tremble(truth, world):
        n, a = math.hypot(n, TREMBLE_M * shake), math.hypot(a, TREMBLE_RAD * shake)
    if n == 0.0 and a == 0.0:
        return truth
    (x, y, z), (i, j, k, roll, pitch, yaw) = truth.position_ned, normals
    if jitter:
        # Of the attitude's noise about the thrust, which moves nothing: one number less to draw.
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


WANDER_S, FORGETS_S = 2.0, 40.0
"""Over which a wander is told [s], and the time constant with which it comes back [s]."""
SPEED_PER_M, SPEED_FORGETS_S = 1.5, 5.0
"""What is measured of its speed wanders so much more [1/s], and comes back so fast [s]: PX4's by 5 cm/s in 0.5 s."""


class PositionWander:
    """What a measured place and yaw do that the vehicle does not."""

    def __init__(self, world: World, normals: Iterator[tuple[float, ...]]) -> None:
        """Nothing yet; ``normals`` gives rows of three standard normal numbers."""
        self._world = world
        self._normals = normals
        self._at_s: float | None = None
        self._off: Vec3 = (0.0, 0.0, 0.0)
        self._fast: Vec3 = (0.0, 0.0, 0.0)

    def distort(self, truth: TrueState, released_s: float | None) -> TrueState:
        """``truth`` as it is measured; times do not go backwards."""
        world = self._world
        if world.estimate_wander_m:
            elapsed = truth.time_s - (truth.time_s if self._at_s is None else self._at_s)
            self._at_s = truth.time_s
            keep = math.exp(-elapsed / FORGETS_S)
            step = world.estimate_wander_m * math.sqrt(elapsed / WANDER_S)
            (a, b, c), (i, j, k) = self._off, next(self._normals)
            self._off = a, b, c = (keep * a + step * i, keep * b + step * j, keep * c + step * k)
            fade = math.exp(-elapsed / SPEED_FORGETS_S)
            (d, e, f), step = self._fast, SPEED_PER_M * step
            self._fast = d, e, f = (fade * d + step * i, fade * e + step * j, fade * f + step * k)
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
