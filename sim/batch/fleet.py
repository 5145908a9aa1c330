"""Truth about N vehicles: plants, wind, and cameras with poses that are noisy, late, and sometimes lost.

What :mod:`sim.runs.stage` and sim/trackers/trackers.py are to one vehicle.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from groundstation.core.geometry import Ops, rotate
from groundstation.core.vehicle import ActuatorCommand
from sim.batch.kernel import Array, Index
from sim.batch.stages import Stages, pick, put, zeros
from sim.runs import CRASH_M
from sim.world import Body, Eddies, Physics, World, begin_eddies, cell, compute_turbulence, generator, integrate, stir

Seen = Callable[[Index, Index, Array], Any]
"""``seen(step, who, taken_s)``: the Body of each vehicle of ``who`` at ``taken_s`` [s], in that step of the frame."""


class Cameras:
    """The poses of N vehicles: true at their exposures, delivered later or never."""

    def __init__(
        self,
        worlds: Sequence[World],
        seeds: Sequence[int],
        duration_s: float,
        release_s: float,
        told_latency_s: float,
    ) -> None:
        """Draw every pose's noise and fate as :class:`sim.trackers.trackers.Mocap` does.

        ``told_latency_s`` [s] is what the pose source takes off a pose's arrival to stamp it.
        """
        n = len(worlds)
        self._period = 1.0 / worlds[0].pose_rate_hz
        phase = np.array([generator(seed, "phase").random() for seed in seeds]) * self._period
        self._next_s = phase - release_s
        self._number = np.zeros(n, int)
        poses = int((duration_s + release_s) / self._period) + 4
        self._noise = np.stack([generator(seed, "noise").standard_normal((poses, 6)) for seed in seeds], axis=2)
        luck = np.stack([generator(seed, "pose loss").random(poses) for seed in seeds], axis=1)
        self._lost = luck < np.array([w.pose_loss for w in worlds])
        self._sigma = np.array([w.pose_noise_m for w in worlds])
        self._sigma_attitude = np.array([w.attitude_noise_rad for w in worlds])
        self._latency = np.array([w.pose_latency_s for w in worlds])
        self._told_latency = told_latency_s
        self._outage = np.array([w.outage_s for w in worlds])
        self._outage_period = np.array([w.outage_period_s for w in worlds])
        self._who: Index = np.empty(0, int)
        self._under_way: Array = np.empty((9, 0))
        """Arrival, stamp, position, attitude of the poses under way, and ``_who`` they show, in order of exposure."""

    def expose(self, ends: Array, seen: Seen) -> None:
        """Take the pictures of one frame, whose steps end at ``ends`` [s after the release]."""
        limits = ends - 1e-12
        while (due := self._next_s < limits[-1]).any():
            who = np.flatnonzero(due)
            taken = self._next_s[who]
            self._expose(who, taken, seen(np.searchsorted(limits, taken, side="right"), who, taken))

    def _expose(self, who: Index, taken: Array, body: Any) -> None:
        """Take one picture of each of the vehicles ``who``."""
        number = self._number[who]
        normals, lost = self._noise[number, :, who].T, self._lost[number, who]
        self._next_s[who] += self._period
        self._number[who] += 1
        period, outage = self._outage_period[who], self._outage[who]
        lost |= (outage > 0.0) & (taken >= 0.0) & (taken % period >= period - outage)
        n, a = self._sigma[who], self._sigma_attitude[who]
        position = [p + n * normals[i] for i, p in enumerate(body.position)]
        angle: Any = tuple(a * normals[3 + i] for i in range(3))
        attitude: Any = rotate(body.attitude, angle)
        latency = self._latency[who]
        # Exact where the source is told the truth: a pose is then stamped with its exposure.
        stamp = np.where(latency == self._told_latency, taken, taken + (latency - self._told_latency))
        kept = ~lost
        self._who = np.concatenate([self._who, who[kept]])
        pose = np.stack([taken + latency, stamp, *position, *attitude])
        self._under_way = np.concatenate([self._under_way, pose[:, kept]], axis=1)

    def take_arrivals(self, time_s: float) -> Iterator[tuple[Index, Array, Any, Any]]:
        """(who, stamp, position, attitude) of what has arrived by ``time_s``.

        The first pose of each vehicle, then the second of each that has one, and so on.
        """
        now = self._under_way[0] <= time_s
        who, poses = self._who[now], self._under_way[:, now]
        self._who, self._under_way = self._who[~now], self._under_way[:, ~now]
        while who.size:
            _, first = np.unique(who, return_index=True)
            stamp, x, y, z, *attitude = poses[1:, first]
            yield who[first], stamp, (x, y, z), tuple(attitude)
            who, poses = np.delete(who, first), np.delete(poses, first, axis=1)


BODY = 14
"""Numbers that make a Body."""
BLOCK = 512
"""Grid steps of turbulence drawn at a time."""


class Fleet:
    """The truth about N vehicles, one frame of commands at a time.

    ``track`` has shape (steps + 1, 14, N): the vehicles at the start of each plant step of the frame, and at its end.
    ``felt`` has shape (steps + 1, 3, N): the disturbance b [m/s², NED] at the start of the frame, and in each step.
    """

    def __init__(
        self,
        worlds: Sequence[World],
        seeds: Sequence[int],
        *,
        duration_s: float,
        release_s: float,
        steps: int,
        told_latency_s: float,
        stages: Stages,
    ) -> None:
        """``release_s`` [s] is when the flights begin, counted from the start of the cameras."""
        first = worlds[0]
        self.count = n = len(worlds)

        def column(name: str) -> Any:
            return np.array([getattr(w, name) for w in worlds], np.float64)

        self._physics: Any = Physics(
            column("mass_kg"),
            column("thrust_lag_s"),
            column("rate_lag_s"),
            column("drag_per_s"),
            column("rate_leak"),
            first.gravity,
        )
        self._thrust_max, self._thrust_curve = column("thrust_max_n"), column("thrust_curve")
        self._gain, self._sag = column("thrust_gain"), column("thrust_sag")
        self._limits = np.radians(np.array([w.rate_limits_deg_s for w in worlds])).T
        self._floor = column("floor_z_m")
        self.start = np.array([w.start_ned for w in worlds]).T
        self._steps, self._step_s = steps, first.frame_period_s / steps
        self.track = np.zeros((steps + 1, BODY, n))
        self.track[-1, :3] = self.start
        self.track[-1, 6] = 1.0
        self.track[-1, 10] = column("start_thrust") * self._physics.mass_kg * first.gravity
        self.felt = np.zeros((steps + 1, 3, n))
        self._thrust_command: Any = np.zeros(n)
        self._rate_command: Any = zeros(n, 3)
        self._gust_hz, self._wind_step_s = column("wind_gust_hz"), column("wind_step_time_s")
        self._mean, self._gust, self._wind_step = (
            np.array([getattr(w, key) for w in worlds], np.float64).T.copy()
            for key in ("wind_mean", "wind_gust", "wind_step")
        )
        self._turbulence = column("wind_turbulence")
        self._normals = [generator(seed, "turbulence") for seed in seeds]
        self._stirs = bool(self._turbulence.any())
        self._grid, self._block = 0, self._draw() if self._stirs else np.zeros((1, 3, n))
        zero: Any = np.zeros(n)
        eddies = Eddies(zeros(n, 3), zero, zero.copy())
        put(eddies, slice(None), begin_eddies(tuple(self._block[0])))
        told = self._thrust_command, self._rate_command, self._physics
        self._frame = stages(self._advance, (tuple(map(_body, self.track)), tuple(map(tuple, self.felt[1:])), *told))
        self._part = stages(_observe, told)
        winds = (tuple(self._mean), tuple(self._gust), tuple(self._wind_step), self._wind_step_s, self._gust_hz)
        self._blow = stages(_blown, (*winds, self._turbulence, eddies, tuple(map(tuple, self.felt))))
        self._cameras = Cameras(worlds, seeds, duration_s, release_s, told_latency_s)
        self.arrived = self._cameras.take_arrivals
        losses = [generator(seed, "frame loss").random(int(duration_s / first.frame_period_s) + 8) for seed in seeds]
        self._frame_lost = column("frame_loss") > np.array(losses).T

    def hold(self, time_s: float) -> None:
        """A frame before the release: nothing moves, but the cameras run."""
        body = _body(self.track[-1])
        self._cameras.expose(np.array([time_s + self._steps * self._step_s]), lambda _, who, __: pick(body, who))

    def command(self, frame: int, time_s: float, drive: ActuatorCommand, told_full_n: float, told_curve: float) -> None:
        """Frame number ``frame`` leaves at ``time_s`` after the release; some vehicles never hear it.

        The full signal is told to give ``told_full_n`` [N], on the curve ``told_curve`` (links/core/thrust_curve.py).
        """
        told, straight = np.clip(np.asarray(drive.thrust) / told_full_n, 1e-30, 1.0), 1.0 - told_curve
        signal = 2.0 * told / (straight + np.sqrt(straight * straight + 4.0 * told_curve * told))
        # On the wire both are single-precision numbers.
        signal = signal.astype(np.float32).astype(np.float64)
        share = self._thrust_curve * signal * signal + (1.0 - self._thrust_curve) * signal
        rates = [np.asarray(rate).astype(np.float32).astype(np.float64) for rate in drive.rates]
        gain = self._gain * (1.0 - self._sag * min(1.0, time_s / 60.0))
        # The first frame is what releases the vehicle; losses count from the second.
        lost = self._frame_lost[frame - 1] & (frame > 0)
        self._thrust_command[...] = np.where(lost, self._thrust_command, gain * share * self._thrust_max)
        for now, new, limit in zip(self._rate_command, rates, self._limits, strict=True):
            now[...] = np.where(lost, now, np.clip(new, -limit, limit))

    def fly(self, time_s: float) -> None:
        """All steps of the frame that begins at ``time_s`` after the release, and the pictures taken meanwhile."""
        h, track = self._step_s, self.track
        track[0] = track[-1]
        starts: Array = time_s + np.arange(self._steps, dtype=np.float64) * h
        self._blow(tuple((time, tuple(self._new_normals(time))) for time in (time_s, *(starts + 0.5 * h).tolist())))
        self._frame(())

        def observe(step: Any, who: Any, taken: Any) -> Any:
            before = _body(track[step, :, who].T)
            return self._part(
                (before, tuple(self.felt[step + 1, :, who].T), np.maximum(taken - starts[step], 1e-12)), who
            )

        self._cameras.expose(starts + h, observe)

    def _advance(self, ops: Ops, state: Any, _: Any) -> Any:
        bodies, felt, thrust, rates, physics = state
        after = [bodies[0]]
        for wind in felt:
            after.append(integrate(ops, after[-1], thrust, rates, wind, self._step_s, physics))
        return (tuple(after), *state[1:]), ()

    def _new_normals(self, time_s: float) -> Iterator[Any]:
        """What stirs the turbulence until ``time_s`` after the release; questions go forward in time."""
        while self._stirs and self._grid < cell(time_s):
            self._grid += 1
            if self._grid % BLOCK == 0:
                self._block = self._draw()
            yield tuple(self._block[self._grid % BLOCK])

    def _draw(self) -> Array:
        return np.stack([g.standard_normal((BLOCK, 3)) for g in self._normals], axis=2)

    def find_crashes(self, steps: int) -> Any:
        """Who has hit the floor or left every room within so many ``steps`` of this frame.

        They are put back to their start, out of the way.
        """
        x, y, z = np.moveaxis(self.track[1 : steps + 1, :3], 1, 0)
        x0, y0, z0 = self.start
        far = (x - x0) ** 2 + (y - y0) ** 2 + (z - z0) ** 2 > CRASH_M**2
        down = ((z >= self._floor - 1e-9) | far | ~np.isfinite(x + y + z)).any(axis=0)
        if down.any():
            end = self.track[-1]
            end[:, down] = 0.0
            end[:3, down] = self.start[:, down]
            end[6, down] = 1.0
        return down


def _observe(ops: Ops, state: Any, given: Any) -> Any:
    before, wind, h = given
    thrust, rates, physics = state
    return state, integrate(ops, before, thrust, rates, wind, h, physics)


def _blown(ops: Ops, state: Any, given: Any) -> Any:
    *winds, eddies, _ = state
    mean, gust, step, step_s, gust_hz, turbulence = winds
    now = []
    for time_s, stirs in given:
        for normals in stirs:
            eddies = stir(eddies, normals)
        sine = ops.sin(2.0 * np.pi * gust_hz * time_s)
        steady = (m + g * sine + s * (time_s >= step_s) for m, g, s in zip(mean, gust, step, strict=True))
        now.append(tuple(a + b for a, b in zip(steady, compute_turbulence(eddies, turbulence), strict=True)))
    return (*winds, eddies, tuple(now)), ()


def _body(numbers: Any) -> Any:
    """The Body of 14 rows, without a copy."""
    px, py, pz, vx, vy, vz, w, x, y, z, thrust, p, q, r = numbers
    return Body((px, py, pz), (vx, vy, vz), (w, x, y, z), thrust, (p, q, r))
