"""Many flights at once: N vehicles as arrays of shape (N,), from the same law, observer, predictor and plant.

What :func:`sim.fly.fly` does with one vehicle through wire bytes, this does with N: the same random numbers, the same
cameras, frames, losses and outages, the same single-precision set-points. Only the orchestration is written again
(a test holds both against each other). All vehicles are told the same and share the periods of frames and poses.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from groundstation.control.adaptive import Adaptive
from groundstation.control.gains import Gains
from groundstation.control.model import Drive
from groundstation.ops import arrays
from groundstation.settings import Config
from sim.batch_cameras import Cameras
from sim.batch_estimator import BatchEstimator
from sim.columns import pick, put, zeros
from sim.draws import stream
from sim.fly import CONFIRM_S
from sim.plant import Body, Physics, moved
from sim.referee import CRASH_M, SATURATION_FROM_S, SETTLED_M, STEADY_S
from sim.wind import GRID_S, begun, felt, stirred
from sim.world import World

Array = npt.NDArray[np.float64]
OPS = arrays()
HANDSHAKE_S = 1.2
"""How long PX4 wants set-points before it is armed: the hand-shake of a whole flight lasts so many whole frames [s]."""


class Flights(NamedTuple):
    """One figure a flight, arrays of shape (N,); see :class:`sim.referee.Verdict`. Lengths in metres."""

    rms_m: Array
    max_m: Array
    settle_s: Array
    """nan where it never settled."""
    saturated: Array
    survived: npt.NDArray[np.bool_]


class Fleet:
    """The truth about N vehicles: plants, wind and cameras."""

    def __init__(self, worlds: Sequence[World], seeds: Sequence[int], duration_s: float, release_s: float) -> None:
        """``release_s`` is when the flights begin, counted from the start of the cameras [s]."""
        self.worlds = worlds
        first = worlds[0]
        self.count = n = len(worlds)
        self.release_s = release_s

        def column(name: str) -> Any:
            return np.array([getattr(w, name) for w in worlds], np.float64)

        self.physics: Any = Physics(
            column("mass_kg"),
            column("thrust_lag_s"),
            column("rate_lag_s"),
            column("drag_per_s"),
            column("rate_leak"),
            first.gravity,
        )
        self.thrust_max = column("thrust_max_n")
        self.gain, self.sag = column("thrust_gain"), column("thrust_sag")
        self.limits = np.radians(np.array([w.rate_limits_deg_s for w in worlds])).T
        self.floor = column("floor_z_m")
        self.start = np.array([w.start_ned for w in worlds]).T
        thrust = column("start_thrust") * self.physics.mass_kg * first.gravity
        self.body = Body(
            (self.start[0].copy(), self.start[1].copy(), self.start[2].copy()),
            zeros(n, 3),
            (np.ones(n), *zeros(n, 3)),
            thrust,
            zeros(n, 3),
        )
        self.thrust_command: Any = np.zeros(n)
        self.rate_command: Any = zeros(n, 3)
        self._gust_hz, self._step_s = column("wind_gust_hz"), column("wind_step_time_s")
        self._mean, self._gust, self._step = (
            np.array([getattr(w, key) for w in worlds]).T for key in ("wind_mean", "wind_gust", "wind_step")
        )
        self._turbulence = column("wind_turbulence")
        self._normals = [stream(seed, "turbulence") for seed in seeds]
        self._block: Array = np.empty((0, 3, n))
        self._grid = -1
        self.felt: Any = zeros(n, 3)
        self._eddies: Any = None
        self.cameras = Cameras(worlds, seeds, duration_s, release_s)
        losses = [stream(seed, "frame loss").random(int(duration_s / first.frame_period_s) + 8) for seed in seeds]
        self._frame_lost = column("frame_loss") > np.array(losses).T

    def command(self, frame: int, time_s: float, drive: Drive, told_max_n: float) -> None:
        """Frame number ``frame`` leaves at ``time_s`` after the release; some vehicles never hear it."""
        # On the wire both are single-precision numbers.
        share = np.clip(np.asarray(drive.thrust) / told_max_n, 0.0, 1.0).astype(np.float32).astype(np.float64)
        rates = [np.asarray(rate).astype(np.float32).astype(np.float64) for rate in drive.rates]
        gain = self.gain * (1.0 - self.sag * min(1.0, time_s / 60.0))
        # The first frame is what releases the vehicle; losses count from the second.
        lost = self._frame_lost[frame - 1] & (frame > 0)
        self.thrust_command = np.where(lost, self.thrust_command, gain * share * self.thrust_max)
        x, y, z = (
            np.where(lost, old, np.clip(new, -limit, limit))
            for old, new, limit in zip(self.rate_command, rates, self.limits, strict=True)
        )
        self.rate_command = (x, y, z)

    def wind(self, time_s: float) -> tuple[Array, Array, Array]:
        """b at ``time_s`` after the release; questions go forward in time."""
        sine = np.sin(2.0 * np.pi * self._gust_hz * time_s)
        steady = self._mean + self._gust * sine + self._step * (time_s >= self._step_s)
        if not self._turbulence.any():
            return (steady[0], steady[1], steady[2])
        while self._grid < int(time_s / GRID_S):
            self._grid += 1
            row = self._grid % 512
            if row == 0:
                self._block = np.stack([g.standard_normal((512, 3)) for g in self._normals], axis=2)
            normals: Any = tuple(self._block[row])
            self._eddies = begun(normals) if self._eddies is None else stirred(self._eddies, normals)
        x, y, z = felt(self._eddies, self._turbulence)
        return (steady[0] + x, steady[1] + y, steady[2] + z)

    def advance(self, time_s: float, h: float) -> None:
        """One plant step from ``time_s``; the cameras that expose within it see where vehicles are."""
        self.felt = self.wind(time_s + 0.5 * h)
        self.cameras.expose(time_s, h, self.body, self.later)
        body: Any = self.body
        self.body = moved(OPS, body, self.thrust_command, self.rate_command, self.felt, h, self.physics)

    def later(self, who: Any, h: Any) -> Any:
        """Where the vehicles ``who`` are ``h`` [s] into the step under way."""
        physics = Physics(*(x[who] if isinstance(x, np.ndarray) else x for x in self.physics))
        return moved(
            OPS,
            pick(self.body, who),
            self.thrust_command[who],
            pick(self.rate_command, who),
            pick(self.felt, who),
            h,
            physics,
        )

    def crashed(self) -> Any:
        """Who has hit the floor or left every room; they are put back to their start, out of the way."""
        x, y, z = self.body.position
        far = (x - self.start[0]) ** 2 + (y - self.start[1]) ** 2 + (z - self.start[2]) ** 2 > CRASH_M**2
        down = (z >= self.floor - 1e-9) | far | ~np.isfinite(x + y + z)
        if down.any():
            put(self.body, down, Body(tuple(self.start[:, down]), (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), 0.0, (0.0,) * 3))
        return down


def refusal(config: Config) -> str | None:
    """Why a batch cannot fly ``config``; None if it can."""
    gains = config.controller
    if gains.kind == "adaptive" and gains.composite == "provable" and gains.observer == "model":
        return None
    return "a batch flies the adaptive controller with its observer and provable adaptation only"


def fly_batch(worlds: Sequence[World], config: Config, seeds: Sequence[int], *, duration_s: float = 60.0) -> Flights:
    """Fly N vehicles in N worlds, all told the same ``config``, for ``duration_s`` [s] after the release.

    Raises:
        ValueError: the worlds differ in a period or in the reference, or the configuration is not our controller's.
    """
    gains, vehicle = config.controller, config.vehicle
    first = worlds[0]
    for name in ("frame_period_s", "pose_rate_hz", "speed_m_s", "gravity"):
        if any(getattr(w, name) != getattr(first, name) for w in worlds):
            raise ValueError(f"all flights of a batch need the same sim.{name}")
    if (reason := refusal(config)) is not None or not isinstance(gains, Gains):
        raise ValueError(reason)
    period = first.frame_period_s
    release_s = CONFIRM_S + math.ceil(HANDSHAKE_S / period - 1e-9) * period
    fleet = Fleet(worlds, seeds, duration_s, release_s)
    weight = vehicle.mass_kg * gains.gravity
    estimator = BatchEstimator(vehicle, gains, fleet.start, config.flight.idle_thrust * weight, period)
    pilot = Adaptive(vehicle, gains, OPS)
    trajectory = config.trajectory.build()
    marks = Marks(fleet.count, duration_s)
    steps = math.ceil(period / first.step_s - 1e-9)
    h = period / steps
    for frame in range(-math.ceil(release_s / period), math.ceil(duration_s / period - 1e-9)):
        time = frame * period
        for who, stamp, position, attitude in fleet.cameras.arrived(time):
            estimator.pose(who, stamp, position, attitude)
        if frame < 0:
            fleet.cameras.expose(time, period, fleet.body, fleet.later)
            continue
        if frame == 0:
            estimator.release()
        decision = pilot.decide(estimator.predict(time), trajectory.at(time), 0.0 if frame == 0 else period)
        estimator.sent(frame, decision.drive)
        fleet.command(frame, time, decision.drive, vehicle.thrust_max_n)
        marks.command(time, decision.saturated)
        for step in range(steps):
            start = time + step * h
            fleet.advance(start, h)
            end = start + h
            x, y, z = trajectory.position_at(end)
            px, py, pz = fleet.body.position
            marks.step(end, np.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2), fleet.crashed())
    return marks.flights()


class Marks:
    """What the referee writes down about N flights."""

    def __init__(self, count: int, duration_s: float) -> None:
        """All still fly."""
        self._alive = np.ones(count, bool)
        self._squares, self._max = np.zeros(count), np.zeros(count)
        self._last_far = np.zeros(count)
        self._saturated, self._commands, self._steps = np.zeros(count), 0, 0
        self._duration = duration_s

    def command(self, time_s: float, saturated: Any) -> None:
        """One command of each."""
        if time_s >= SATURATION_FROM_S:
            self._saturated += saturated
            self._commands += 1

    def step(self, time_s: float, error: Array, crashed: Any) -> None:
        """The errors [m] after one plant step."""
        if time_s > self._duration + 1e-9:
            return  # the last frame is held beyond the end of the flight
        self._alive &= ~crashed
        self._last_far[error >= SETTLED_M] = time_s
        if time_s >= STEADY_S:
            self._squares += error * error
            self._max = np.maximum(self._max, error)
            self._steps += 1

    def flights(self) -> Flights:
        """The figures; nan for those that crashed."""
        nan = np.where(self._alive, 0.0, np.nan)
        settled = np.where(self._last_far < self._duration - 0.01, self._last_far, np.nan)
        return Flights(
            rms_m=np.sqrt(self._squares / max(self._steps, 1)) + nan,
            max_m=self._max + nan,
            settle_s=settled + nan,
            saturated=self._saturated / max(self._commands, 1),
            survived=self._alive,
        )
