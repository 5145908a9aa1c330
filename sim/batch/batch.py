"""Batch: many flights at once, N vehicles as arrays of shape (N,), from the same law, observer,
predictor and plant.

What :func:`sim.runs.flight.fly` does with one vehicle through wire bytes, this does with N: the
same random numbers, cameras, frames, losses and outages, the same single-precision set-points. Only
the orchestration is written again (a test holds both against each other): who has a pose, which
command acts when, the controller's memory, and what the referee writes down. All are told the same
and share the periods of frames and poses. Thrust and rates follow their commands by first-order
lags alone: no rotors, and no dead times.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt

from groundstation.config import ConfigError
from groundstation.core.control import Adaptive, Gains, Law
from groundstation.core.estimation import (
    NOISE_FLOOR_M2,
    NOISE_MEMORY,
    NOISE_SPAN_S,
    PP,
    STEP_LIMIT,
    AlongTrack,
    Chain,
    Covariance,
    Densities,
    Effectiveness,
    Estimation,
    StampNoise,
    apply_effectiveness,
    correct_attitude,
    correct_chain,
    find_direction,
    fourth_difference,
    initial_covariance,
    initial_effectiveness,
    part_along,
    predict_covariance,
    predict_effectiveness,
    split_noise,
    turn_track,
    update_covariance,
    update_effectiveness,
    weigh_along,
    widen_covariance,
)
from groundstation.core.geometry import ZERO, Ops, Real, Vec3, add_scaled, arrays, rotate, subtract
from groundstation.core.messages import (
    ROUNDING_S,
    SATURATION_FROM_S,
    SETTLED_M,
    STEADY_S,
    Decision,
    Estimate,
)
from groundstation.core.vehicle import (
    ActuatorCommand,
    ActuatorResponse,
    Motion,
    Vehicle,
    begin_response,
    integrate_actuators,
    integrate_motion,
)
from groundstation.pose.sources import ViconConfig
from groundstation.settings import Config
from links.mavlink.protocol import STREAM_S
from sim.batch.one_by_one import OneByOne
from sim.runs import BACK_M, CONFIRM_S, CRASH_M, Effort, sought
from sim.text import notice
from sim.world import (
    STILL,
    AirDrag,
    Body,
    Physics,
    SteadyWind,
    World,
    advance_turbulence,
    begin_turbulence,
    compute_drag,
    compute_steady,
    compute_turbulence,
    find_grid_step,
    generator,
    integrate,
)

Array: TypeAlias = npt.NDArray[np.float64]
Index: TypeAlias = npt.NDArray[np.intp]

OPS = arrays()


def zeros(count: int, width: int) -> Any:
    """``width`` arrays of ``count`` zeros, each its own: ``put`` writes into one without touching
    the others.
    """
    return tuple(np.zeros(count) for _ in range(width))


def pick(values: Any, who: Any) -> Any:
    """The entries ``who`` of every array in a nested tuple or struct; plain numbers stay."""
    if isinstance(values, np.ndarray):
        return values[who]
    if isinstance(values, msgspec.Struct):
        return type(values)(*pick(msgspec.structs.astuple(values), who))
    if isinstance(values, tuple):
        parts = [pick(value, who) for value in values]
        return type(values)(*parts) if hasattr(values, "_fields") else tuple(parts)
    return values


def put(values: Any, who: Any, parts: Any) -> None:
    """Write ``parts`` into the entries ``who`` of every array of ``values``, of the same shape.

    None stays.
    """
    if values is None:
        return
    if isinstance(values, np.ndarray):
        values[who] = parts
        return
    if isinstance(values, msgspec.Struct):
        values, parts = msgspec.structs.astuple(values), msgspec.structs.astuple(parts)
    for value, part in zip(values, parts, strict=True):
        put(value, who, part)


KEPT_FRAMES = 64
"""Commands remembered: longer than any outage that a flight survives."""


class Filtered(NamedTuple):
    """Known at the newest pose.

    See :class:`groundstation.core.estimation.estimator.ModelEstimator`. Elementwise.
    """

    stamp: Real
    motion: Motion
    disturbance: Vec3
    rate: Vec3
    covariance: Covariance
    effectiveness: Effectiveness
    noise: Real
    stamp_noise: StampNoise
    track: AlongTrack
    """That of the covariance across the motion, in no direction, where stamps are not off."""
    times: tuple[Real, ...]
    """Time stamps of the newest five poses [s]."""
    places: tuple[Vec3, ...]
    """And their positions [m, NED]."""
    driven: ActuatorResponse
    """State of the newest pose rolled forward by the commands to the time asked last."""


class BatchEstimator:
    """State at each vehicle's newest pose.

    Commands act from frames at multiples of ``period_s`` on.
    """

    def __init__(
        self, vehicle: Vehicle, gains: Estimation, start: Any, idle_thrust_n: float, period_s: float
    ) -> None:
        """``start`` is the (3, N) position [m, NED] at which the vehicles are held, with
        ``idle_thrust_n`` [N].
        """
        n = start.shape[1]
        zero: Any = np.zeros(n)
        self._vehicle = vehicle
        self._gains = gains
        self._period = period_s
        noises = (
            gains.pose_wander,
            gains.acceleration_noise,
            gains.wind_noise,
            gains.wind_rate_noise,
        )
        self._densities = Densities(*(noise**2 for noise in noises))
        self._separates = gains.effectiveness_deviation > 0.0
        upright = (zero + 1.0, *zeros(n, 3))
        state: Any = Filtered(
            zero - np.inf,
            Motion(tuple(start.copy()), zeros(n, 3), upright, zero + idle_thrust_n, zeros(n, 3)),
            *(zeros(n, 3), zeros(n, 3)),
            zeros(n, 10),
            Effectiveness(*zeros(n, 3), *(zeros(n, 3) for _ in range(4)), *zeros(n, 4)),
            zero + gains.pose_noise_m**2,
            (zero + gains.pose_noise_m**2, zero + 0.0),
            AlongTrack(zeros(n, 3), zeros(n, 10)),
            tuple(zero - np.inf for _ in range(5)),
            tuple(zeros(n, 3) for _ in range(5)),
            ActuatorResponse(zeros(n, 4), zero, zeros(n, 3), zeros(n, 3), zeros(n, 3)),
        )
        self._state = state
        self.release()
        self._drives = np.zeros((KEPT_FRAMES, 4, n))
        self._drives[:, 0] = idle_thrust_n
        self._newest = 0

    @property
    def stamp_s(self) -> Any:
        """Time stamp of each vehicle's newest pose [s]."""
        return self._state.stamp

    def release(self) -> None:
        """As :meth:`ModelEstimator.release`."""
        state = self._state
        for covariance in (state.covariance, state.track.covariance):
            put(covariance, slice(None), initial_covariance(state.noise))
        put(
            state.effectiveness,
            slice(None),
            initial_effectiveness(self._gains.effectiveness_deviation),
        )
        put((state.disturbance, state.rate), slice(None), (ZERO, ZERO))

    def take_command(self, frame: int, drive: ActuatorCommand) -> None:
        """The command of ``frame`` acts from frame · period on."""
        self._newest = frame
        self._drives[frame % KEPT_FRAMES] = (drive.thrust, *drive.rates)

    def pose(self, who: Index, stamp: Any, position: Any, attitude: Any) -> None:
        """One pose for each of the vehicles ``who``."""
        first = ~np.isfinite(self._state.stamp[who])
        if first.any():
            new = who[first]
            self._state.stamp[new] = stamp[first]
            put(self._state.motion.attitude, new, pick(attitude, first))
            who = who[~first]
            stamp = stamp[~first]
            position = pick(position, ~first)
            attitude = pick(attitude, ~first)
        if who.size:
            with np.errstate(invalid="ignore"):  # -inf - -inf before the fifth pose
                self._drive(stamp, who)
                old = pick(self._state, who)
                new = self._correct(OPS, old, stamp, position, attitude)
                for arrays_of_all, before, after in zip(self._state, old, new, strict=True):
                    if after is not before:
                        put(arrays_of_all, who, after)

    def _correct(
        self, ops: Ops, old: Filtered, stamp: Any, position: Any, attitude: Any
    ) -> Filtered:
        """``old`` and one pose: stamp [s], position [m, NED], attitude.

        Commands have been rolled until then.
        """
        noise, stamp_noise, times, places = self._measure_noise(ops, old, stamp, position)
        dt = stamp - old.stamp
        model = self._at(old, dt)
        expected = predict_covariance(old.covariance, dt, self._densities)
        step = subtract(position, model.position)
        if self._gains.pose_jitter_s == 0.0:
            expected = widen_covariance(ops, expected, noise, step)
            across2, track, along = expected[PP] + noise, old.track, None
            gain, covariance = update_covariance(expected, noise)
        else:
            gain, covariance, across2, along, track = self._weigh_apart(
                ops, old.track, expected, model.velocity, dt, noise, stamp_noise, step
            )
        chain: Chain = (
            model.position,
            model.velocity,
            add_scaled(old.disturbance, dt, old.rate),
            old.rate,
        )
        if along is not None:
            chain = correct_chain(chain, along.more, part_along(along.axis, step))
        chain = correct_chain(chain, gain, step)
        e = old.effectiveness
        if self._separates:
            e = predict_effectiveness(
                ops, e, dt, old.driven, self._vehicle.mass_kg, self._gains.effectiveness_walk
            )
            e, moved = update_effectiveness(ops, e, step, gain, across2, 0, along)
            chain = apply_effectiveness(chain, moved, e)
        place, speed, now, rate = chain
        turned = correct_attitude(ops, model.attitude, attitude, self._gains.attitude_gain)
        motion = Motion(place, speed, turned, model.thrust, model.rates)
        seen = (noise, stamp_noise, track, times, places)
        return Filtered(stamp, motion, now, rate, covariance, e, *seen, old.driven)

    def _weigh_apart(
        self,
        ops: Ops,
        old: AlongTrack,
        expected: Any,
        velocity: Any,
        dt: Any,
        noise: Any,
        stamp_noise: Any,
        step: Any,
    ) -> Any:
        """Weigh the innovation ``step`` [m] across and along the track, where stamps jitter.

        Returns:
            The gain and the covariance across, its innovation's variance [m²], and the correction
            and the covariance along the track.
        """
        told_s = self._gains.pose_jitter_s
        across, jitter2 = split_noise(ops, noise, stamp_noise, NOISE_FLOOR_M2, told_s)
        axis, speed2 = find_direction(ops, velocity)
        narrow = predict_covariance(old.covariance, dt, self._densities)
        both = turn_track(expected, AlongTrack(old.axis, narrow), axis)
        # Where stamps are not off there is one filter, with which the two begin again.
        off = jitter2 > 0.0
        apart: Any = (
            tuple(ops.where(off, a, b) for a, b in zip(one, expected, strict=True)) for one in both
        )
        most = across + jitter2 * speed2
        wide, narrow = (widen_covariance(ops, one, most, step) for one in apart)
        across2, along2 = wide[PP] + across, narrow[PP] + most
        gain, covariance = update_covariance(wide, across)
        found = update_covariance(narrow, most)
        return gain, covariance, across2, *weigh_along(ops, axis, gain, found, across2, along2)

    def predict(self, time_s: float) -> Estimate:
        """Every vehicle at ``time_s``."""
        state = self._state
        self._drive(np.full(state.stamp.size, time_s), np.arange(state.stamp.size))
        h = time_s - state.stamp
        disturbance = add_scaled(state.disturbance, h, state.rate)
        deviation: Any = np.sqrt(state.effectiveness.variance)
        return Estimate(
            time_s, self._at(state, h), disturbance, ZERO, state.effectiveness.value, deviation
        )

    def _drive(self, end: Any, who: Index) -> None:
        """Let the commands sent act on ``who`` from their newest poses to ``end`` [s]."""
        period, vehicle, driven = self._period, self._vehicle, self._state.driven
        motion = pick(self._state.motion, who)
        put(driven, who, begin_response(motion))
        time = self._state.stamp[who]
        while (going := time < end - 1e-9).any():
            part, now, last = who[going], time[going], end[going]
            until = np.minimum(last, now + STEP_LIMIT)
            frame = np.minimum(np.floor((now + 1e-9) / period).astype(int), self._newest)
            until = np.where(frame < self._newest, np.minimum(until, (frame + 1) * period), until)
            thrust, *rates = self._drives[frame % KEPT_FRAMES, :, part].T
            command = ActuatorCommand(thrust, tuple(rates))
            h, lags = np.maximum(until - now, 1e-12), (vehicle.thrust_lag_s, vehicle.rate_lag_s)
            put(driven, part, integrate_actuators(OPS, pick(driven, part), command, h, *lags))
            time[going] = until

    def _at(self, old: Filtered, h: Any) -> Any:
        """The motion ``h`` [s] after the newest pose; commands have been rolled until then."""
        north, east, down = old.disturbance
        mass: Any = self._vehicle.mass_kg / old.effectiveness.value
        other = (north, east, down + self._gains.gravity)
        return integrate_motion(
            old.motion, old.driven, h, mass, other, old.rate, self._vehicle.drag_per_s
        )

    def _measure_noise(self, ops: Ops, old: Filtered, stamp: Any, position: Any) -> Any:
        """As :meth:`ModelEstimator._measure_noise`."""
        times, places = (*old.times[1:], stamp), (*old.places[1:], position)
        span: Any = times[4] - times[0]
        # Before the fifth pose the first of the times is -inf, and the comparison false.
        counts = span <= NOISE_SPAN_S
        noise, (before, speed2) = old.noise, old.stamp_noise
        variance, along, way2 = fourth_difference(times, places)
        measured = noise + (variance - noise) / NOISE_MEMORY
        seen = (
            ops.where(counts, before + (along - before) / NOISE_MEMORY, before),
            ops.where(counts, speed2 + (way2 / (span * span) - speed2) / NOISE_MEMORY, speed2),
        )
        return (
            ops.where(counts, ops.clamp(measured, NOISE_FLOOR_M2, math.inf), noise),
            seen,
            times,
            places,
        )


Seen = Callable[[Index, Index, Array], Any]
"""``seen(step, who, taken_s)``: the Body of each vehicle of ``who`` at ``taken_s`` [s], in that
step of the frame."""


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
        self._noise = np.stack(
            [generator(seed, "noise").standard_normal((poses, 6)) for seed in seeds], axis=2
        )
        luck = np.stack([generator(seed, "pose loss").random(poses) for seed in seeds], axis=1)
        self._lost = luck < np.array([w.pose_loss for w in worlds])
        self._sigma = np.array([w.pose_noise_m for w in worlds])
        self._jitter = np.array([w.pose_jitter_s for w in worlds])
        self._sigma_attitude = np.array([w.attitude_noise_rad for w in worlds])
        self._latency = np.array([w.pose_latency_s for w in worlds])
        self._told_latency = told_latency_s
        self._outage = np.array([w.outage_s for w in worlds])
        self._outage_period = np.array([w.outage_period_s for w in worlds])
        self._who: Index = np.empty(0, int)
        self._under_way: Array = np.empty((9, 0))
        """Arrival, stamp, position, attitude of the poses under way, and ``_who`` they show, in
        order of exposure."""

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
        late = self._jitter[who] * normals[5]
        moved = zip(body.position, body.velocity, strict=True)
        position = [p + late * v + n * normals[i] for i, (p, v) in enumerate(moved)]
        angle: Any = tuple(a * normals[3 + i] for i in range(3))
        attitude: Any = rotate(body.attitude, angle)
        latency = self._latency[who]
        # Exact where the source is told the truth: a pose is then stamped with its exposure.
        stamp = np.where(
            latency == self._told_latency, taken, taken + (latency - self._told_latency)
        )
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
"""Rows of random numbers drawn at a time [-]."""


def column(worlds: Sequence[World], name: str) -> Any:
    """The values of one key in all ``worlds``, the last axis counting them."""
    return np.array([getattr(world, name) for world in worlds], np.float64).T.copy()


class BatchWind:
    """Disturbances of N vehicles: mean, gust, step or push, and turbulence.

    See :class:`sim.world.world.Wind`.
    """

    def __init__(self, worlds: Sequence[World], seeds: Sequence[int]) -> None:
        """Take the first state."""
        keys = (
            "wind_mean",
            "wind_gust",
            "wind_gust_hz",
            "wind_step",
            "wind_step_time_s",
            "wind_push_s",
        )
        self._steady = SteadyWind(*(column(worlds, key) for key in keys))
        self._turbulence = column(worlds, "wind_turbulence")
        self._draws = (
            [generator(seed, "turbulence") for seed in seeds] if self._turbulence.any() else []
        )
        self._grid = 0
        """Step of the turbulence's grid in time [-]."""
        self._block = self._draw() if self._draws else np.zeros((1, 3, len(worlds)))
        self._turbulence_state = begin_turbulence(tuple(self._block[0]))

    def at(self, time_s: float) -> Any:
        """The disturbance [m/s², NED] at ``time_s`` after the release.

        Questions go forward in time.
        """
        while self._draws and self._grid < find_grid_step(time_s):
            self._grid += 1
            if self._grid % BLOCK == 0:
                self._block = self._draw()
            self._turbulence_state = advance_turbulence(
                self._turbulence_state, tuple(self._block[self._grid % BLOCK])
            )
        steady = np.array(compute_steady(OPS, self._steady, time_s))
        return steady + np.array(compute_turbulence(self._turbulence_state, self._turbulence))

    def _draw(self) -> Array:
        return np.stack([draw.standard_normal((BLOCK, 3)) for draw in self._draws], axis=2)


class ReceivedCommands:
    """Commands as N vehicles take them: frames lost, single precision, thrust by its true gain,
    rates within limits.
    """

    def __init__(self, worlds: Sequence[World], seeds: Sequence[int], duration_s: float) -> None:
        """No thrust and no rates, before the first frame of a flight of ``duration_s`` [s]."""
        first, n = worlds[0], len(worlds)
        self._thrust_max = column(worlds, "thrust_max_n")
        self._thrust_curve = column(worlds, "thrust_curve")
        self._gain, self._sag = column(worlds, "thrust_gain"), column(worlds, "thrust_sag")
        self._limits = np.radians(column(worlds, "rate_limits_deg_s"))
        losses = [
            generator(seed, "frame loss").random(int(duration_s / first.frame_period_s) + 8)
            for seed in seeds
        ]
        self._frame_lost = column(worlds, "frame_loss") > np.array(losses).T
        self.gains = self._gain.copy()
        """True thrust gain at the newest command that arrived [-]."""
        self.thrust: Any = np.zeros(n)
        """Thrust of that command [N]."""
        self.rates: Any = zeros(n, 3)
        """And its body rates [rad/s]."""

    def take(
        self,
        frame: int,
        time_s: float,
        drive: ActuatorCommand,
        told_full_n: float,
        told_curve: float,
    ) -> None:
        """Frame number ``frame`` leaves at ``time_s`` after the release.

        Some vehicles never hear it.

        The full signal is told to give ``told_full_n`` [N], on the curve ``told_curve``
        (links/core/deadman.py).
        """
        told = np.clip(np.asarray(drive.thrust) / told_full_n, 1e-30, 1.0)
        straight = 1.0 - told_curve
        signal = 2.0 * told / (straight + np.sqrt(straight * straight + 4.0 * told_curve * told))
        # On the wire both are single-precision numbers.
        signal = signal.astype(np.float32).astype(np.float64)
        share = self._thrust_curve * signal * signal + (1.0 - self._thrust_curve) * signal
        rates = [np.asarray(rate).astype(np.float32).astype(np.float64) for rate in drive.rates]
        gain = self._gain * (1.0 - self._sag * min(1.0, time_s / 60.0))
        # The first frame is what releases the vehicle; losses count from the second.
        lost = self._frame_lost[frame - 1] & (frame > 0)
        self.gains[...] = np.where(lost, self.gains, gain)
        self.thrust[...] = np.where(lost, self.thrust, gain * share * self._thrust_max)
        for now, new, limit in zip(self.rates, rates, self._limits, strict=True):
            now[...] = np.where(lost, now, np.clip(new, -limit, limit))


class Fleet:
    """The truth about N vehicles, one frame of commands at a time.

    ``track`` has shape (steps + 1, 14, N): the vehicles at the start of each plant step of the
    frame, and at its end. ``felt`` has shape (steps + 1, 3, N): the disturbance b [m/s², NED] at
    the start of the frame, and in each step.
    """

    def __init__(
        self, worlds: Sequence[World], seeds: Sequence[int], steps: int, duration_s: float
    ) -> None:
        """Hold them; ``steps`` of the plant make a frame."""
        first, n = worlds[0], len(worlds)
        self.count = n
        self.commands = ReceivedCommands(worlds, seeds, duration_s)
        """Newest command that each has received."""
        self._floor = column(worlds, "floor_z_m")
        self.start = column(worlds, "start_ned")
        self._steps, self._step_s = steps, first.frame_period_s / steps
        self._plant: Any = _describe_plant(worlds)
        self.track = np.zeros((steps + 1, BODY, n))
        self.track[-1, :3] = self.start
        turn: Any = tuple(np.radians(column(worlds, "start_turn_deg")))
        self.track[-1, 6:10] = rotate((np.ones(n), *zeros(n, 3)), turn)
        self.track[-1, 10] = (
            column(worlds, "start_thrust") * column(worlds, "mass_kg") * first.gravity
        )
        self._start_velocity = column(worlds, "start_velocity")
        self._wind = BatchWind(worlds, seeds)
        self.felt = np.zeros((steps + 1, 3, n))

    def release(self) -> None:
        """Let go of all of them."""
        self.track[-1, 3:6] = self._start_velocity

    @property
    def body(self) -> Any:
        """The Body of each at the end of the newest frame."""
        return _body(self.track[-1])

    def fly(self, time_s: float) -> Seen:
        """All steps of the frame that begins at ``time_s`` after the release.

        Returns what cameras see in it.
        """
        h, track, commands = self._step_s, self.track, self.commands
        track[0] = track[-1]
        starts: Array = time_s + np.arange(self._steps, dtype=np.float64) * h
        for row, time in zip(self.felt, (time_s, *(starts + 0.5 * h).tolist()), strict=True):
            row[...] = self._wind.at(time)
        command = commands.thrust, commands.rates
        body = _body(track[0])
        for felt, end in zip(self.felt[1:], track[1:], strict=True):
            body = _step(body, command, tuple(felt), h, self._plant)
            put(_body(end), slice(None), body)

        def see(step: Any, who: Any, taken: Any) -> Any:
            before, wind = _body(track[step, :, who].T), tuple(self.felt[step + 1, :, who].T)
            since = np.maximum(taken - starts[step], 1e-12)
            return _step(before, pick(command, who), wind, since, pick(self._plant, who))

        return see

    def find_crashes(self, steps: int) -> Any:
        """Find the vehicles that hit the floor or left every room within ``steps`` steps of this
        frame.

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


def _describe_plant(worlds: Sequence[World]) -> Any:
    """Physics, and drag along the body's axes; None where there is none."""
    physics = Physics(
        column(worlds, "mass_kg"),
        column(worlds, "thrust_lag_s"),
        column(worlds, "rate_lag_s"),
        column(worlds, "drag_per_s"),
        column(worlds, "rate_leak"),
        worlds[0].gravity,
    )
    linear, air = tuple(column(worlds, "drag_body_per_s")), tuple(column(worlds, "air_velocity"))
    within, along = column(worlds, "inflow_drag_per_m")
    drag = AirDrag(linear, within, along, column(worlds, "inflow_lift_per_m"), air)
    drags = any(np.any(x) for x in (*drag.linear, *drag[1:4]))
    return physics, drag if drags else None


def _step(body: Any, command: Any, wind: Any, h: Any, plant: Any) -> Any:
    """One step of the plant."""
    (thrust, rates), (physics, drag) = command, plant
    if drag is not None:
        wind = tuple(a + b for a, b in zip(wind, compute_drag(OPS, body, drag), strict=True))
    return integrate(OPS, body, thrust, rates, wind, h, physics)


def _body(numbers: Any) -> Any:
    """The Body of 14 rows, without a copy."""
    px, py, pz, vx, vy, vz, w, x, y, z, thrust, p, q, r = numbers
    return Body((px, py, pz), (vx, vy, vz), (w, x, y, z), thrust, (p, q, r))


STEADY_FROM_S = STEADY_S - ROUNDING_S


class Flights(NamedTuple):
    """One figure a flight, arrays of shape (N,); see :class:`sim.runs.referee.FlightVerdict`.

    Lengths in metres.
    """

    rms_m: Array
    max_m: Array
    settle_s: Array
    """nan where it never settled."""
    effort_rad_s: Array
    saturated: Array
    lyapunov_start: Array
    lyapunov_floor: Array
    b_hat_share_max: Array
    """Largest |b̂| over the flight, in shares of B + ε [-]."""
    thrust_margin_n: Array
    """Least distance of the commanded thrust from either of its limits over the steady part [N]."""
    thrust_scale: Array
    """λ̂ at the last command [-]."""
    thrust_scale_deviation: Array
    """Its standard deviation as the estimator has it [-]."""
    gust_peak_m: Array
    """Largest error after the wind's step or push; nan where there is none."""
    gust_back_s: Array
    """Time after it from which the error stays below 5 cm [s]; nan where it never does."""
    lowest_m: Array
    """Lowest point, counted downwards [m, NED]."""
    survived: npt.NDArray[np.bool_]


class Marks:
    """Score sheet of N flights: commands and steps are kept as they come, and judged at the end."""

    def __init__(
        self, worlds: Sequence[World], duration_s: float, vehicle: Vehicle, law: Estimation
    ) -> None:
        """All still fly; ``vehicle`` and ``law`` as told, whose limits and bounds margins are
        counted from.
        """
        count = len(worlds)
        self._duration, self._vehicle = duration_s, vehicle
        self._law = law if isinstance(law, Law) else None
        self._alive = np.ones(count, bool)
        pushed = [world.wind_step != ZERO for world in worlds]
        self._pushed_s = np.where(pushed, column(worlds, "wind_step_time_s"), np.nan)
        """When the wind steps [s]; nan where it does not."""
        self._effort = Effort()
        self._scale: tuple[Any, Any] = np.ones(count), np.zeros(count)
        self._b_hat2 = np.zeros(count)
        """Largest |b̂|² so far."""
        self._commands: list[tuple[float, Any, Any, Any, Any]] = []
        """Time [s], whether it was clamped, thrust [N], square of the effort and V, of each
        command."""
        self._steps: list[tuple[Array, Array]] = []
        """Ends of the steps of a frame [s], and errors of shape (steps, N) [m]."""
        self._lowest = np.full(count, -np.inf)

    def mark_failed(self, who: Any) -> None:
        """These flights have failed."""
        self._alive &= ~who

    def command(self, time_s: float, decision: Decision, estimate: Estimate, wind: Array) -> None:
        """One command of each, what it was computed from, and the true disturbance b [m/s², NED] at
        that instant.
        """
        self._scale = estimate.effectiveness, estimate.effectiveness_deviation
        seen, drive, law = decision.diagnostics, decision.drive, self._law
        x, y, z = seen.b_hat
        self._b_hat2 = np.maximum(self._b_hat2, x * x + y * y + z * z)
        weight = 0.5 / law.kb if law is not None and law.kb > 0.0 else 0.0
        north, east, down = sought(wind, estimate, self._vehicle.mass_kg)
        v = seen.v_known + weight * ((x - north) ** 2 + (y - east) ** 2 + (z - down) ** 2)
        square = self._effort.square(time_s, drive.rates)
        self._commands.append((time_s, decision.saturated, drive.thrust, square, v))

    def steps(self, ends: Array, errors: Array, heights: Array) -> None:
        """The errors [m] of shape (steps, N) after the plant steps that end at ``ends`` [s after
        the release].

        ``heights`` are counted downwards [m, NED].
        """
        self._steps.append((ends, errors))
        self._lowest = np.maximum(self._lowest, heights.max(axis=0, initial=-np.inf))

    def flights(self) -> Flights:
        """The figures; nan for those that crashed."""
        nan, end_s = np.where(self._alive, 0.0, np.nan), self._duration - 0.01
        columns = [np.array(values) for values in zip(*self._commands, strict=True)]
        times, saturated, thrusts, squares, v = columns
        steady, clampable = times >= STEADY_FROM_S, times >= SATURATION_FROM_S
        vehicle, law = self._vehicle, self._law
        margins = np.minimum(thrusts - vehicle.thrust_min_n, vehicle.thrust_max_n - thrusts)[steady]
        ends, errors = map(np.concatenate, zip(*self._steps, strict=True))
        late = errors[ends >= STEADY_FROM_S]
        settled_s = _find_last(ends, errors >= SETTLED_M, np.zeros(len(nan)))
        after = ends[:, None] >= self._pushed_s
        peak_m = np.where(after, errors, -np.inf).max(axis=0)
        back_s = _find_last(ends, after & (errors >= BACK_M), self._pushed_s)
        return Flights(
            rms_m=np.sqrt(_sum_up(late * late) / max(len(late), 1)) + nan,
            max_m=late.max(axis=0, initial=0.0) + nan,
            settle_s=np.where(settled_s < end_s, settled_s, np.nan) + nan,
            effort_rad_s=np.sqrt(_sum_up(squares[steady]) / max(steady.sum(), 1)) + nan,
            saturated=saturated[clampable].sum(axis=0) / max(clampable.sum(), 1),
            lyapunov_start=v[0],
            lyapunov_floor=(
                np.sort(v[steady], axis=0)[steady.sum() // 2] if steady.any() else np.nan
            )
            + nan,
            b_hat_share_max=np.sqrt(self._b_hat2)
            / (np.inf if law is None else law.b_bound + law.epsilon)
            + nan,
            thrust_margin_n=margins.min(axis=0, initial=np.inf) + nan,
            thrust_scale=self._scale[0] + nan,
            thrust_scale_deviation=self._scale[1] + nan,
            gust_peak_m=np.where(np.isfinite(peak_m), peak_m, np.nan) + nan,
            gust_back_s=np.where(back_s < end_s, back_s - self._pushed_s, np.nan) + nan,
            lowest_m=self._lowest,
            survived=self._alive,
        )


def _sum_up(values: Array) -> Any:
    """The sum of each flight's ``values``, of shape (steps, N): to the same bit, however many fly
    with it.
    """
    return np.ascontiguousarray(values.T).sum(axis=1)


def _find_last(ends: Array, marked: Any, none: Array) -> Any:
    """The last of ``ends`` at which each flight is ``marked``, of shape (steps, N).

    ``none`` where it never is.
    """
    return np.where(marked.any(axis=0), ends[ends.size - 1 - np.argmax(marked[::-1], axis=0)], none)


def require_batchable(world: World, config: Config) -> None:
    """Refuse what no batch can fly as whole flights do, in ``world``.

    Raises:
        ConfigError: the key, and what a batch flies instead.
    """
    gains = config.controller
    if gains.observer != "model" or (isinstance(gains, Gains) and gains.composite != "provable"):
        raise ConfigError("controller", notice("batch.controller"))
    if not isinstance(config.pose, ViconConfig):
        raise ConfigError("pose.kind", notice("batch.source", found=config.pose.kind))
    if world.plant == "rotors":
        raise ConfigError("sim.plant", notice("batch.rotors"))
    for name in ("command_delay_s", "thrust_delay_s", "rate_delay_s"):
        for section, told in (("vehicle", config.vehicle), ("sim", world)):
            if getattr(told, name) > 0.0:
                raise ConfigError(f"{section}.{name}", notice("batch.delay"))
    if world.tunnel != STILL:
        raise ConfigError("sim.tunnel", notice("batch.tunnel"))
    for name in (
        "occlusion_s",
        "swap_s",
        "tracker_yaw_deg",
        "estimate_wander_m",
        "estimate_yaw_step_deg",
    ):
        if getattr(world, name) != 0.0:
            raise ConfigError(f"sim.{name}", notice("batch.cameras"))


def fly_batch(
    worlds: Sequence[World], config: Config, seeds: Sequence[int], *, duration_s: float = 60.0
) -> Flights:
    """Fly N vehicles in N worlds, all told the same ``config``, for ``duration_s`` [s] after the
    release.

    Raises:
        ValueError: the worlds differ in a period or in the reference.
        ConfigError: see :func:`require_batchable`.
    """
    for name in ("frame_period_s", "pose_rate_hz", "speed_m_s", "gravity"):
        if any(getattr(world, name) != getattr(worlds[0], name) for world in worlds):
            raise ValueError(notice("batch.different", key=name))
    for world in worlds:
        require_batchable(world, config)
    batch = Batch(worlds, config, seeds, duration_s)
    for frame in range(-math.ceil(batch.release_s / batch.period_s), 0):
        batch.hold(frame * batch.period_s)
    for frame in range(math.ceil(duration_s / batch.period_s - 1e-9)):
        batch.fly(frame)
    return batch.marks.flights()


class Batch:
    """N flights under way: truth, cameras, ground stations and score, one frame at a time."""

    def __init__(
        self, worlds: Sequence[World], config: Config, seeds: Sequence[int], duration_s: float
    ) -> None:
        """Hold the vehicles at their starts; the arguments are those of :func:`fly_batch`."""
        gains, vehicle, pose, first = config.controller, config.vehicle, config.pose, worlds[0]
        assert isinstance(pose, ViconConfig)
        self.period_s = first.frame_period_s
        self.release_s = CONFIRM_S + math.ceil(STREAM_S / self.period_s - 1e-9) * self.period_s
        """When the flights begin, from the start of the cameras [s]."""
        self._config, self._duration_s = config, duration_s
        steps = math.ceil(self.period_s / first.step_s - 1e-9)
        self._step_s = self.period_s / steps
        self._starts: Array = np.arange(steps, dtype=np.float64) * self._step_s
        """Beginning of each plant step in a frame [s]."""
        self._fleet = Fleet(worlds, seeds, steps, duration_s)
        self._cameras = Cameras(worlds, seeds, duration_s, self.release_s, pose.latency_s)
        idle_n = config.flight.idle_thrust * (vehicle.mass_kg * gains.gravity)
        self._estimator = BatchEstimator(vehicle, gains, self._fleet.start, idle_n, self.period_s)
        self._controller = (
            Adaptive(vehicle, gains, OPS)
            if isinstance(gains, Gains)
            else OneByOne(self._fleet.count, config)
        )
        self._trajectory = config.trajectory.build()
        self.marks = Marks(worlds, duration_s, vehicle, gains)

    def hold(self, time_s: float) -> None:
        """One frame before the release: nothing moves, but the cameras run."""
        self._take_poses(time_s)
        body = self._fleet.body
        self._cameras.expose(np.array([time_s + self.period_s]), lambda _, who, __: pick(body, who))

    def fly(self, frame: int) -> None:
        """One frame after the release: poses, a command, the vehicles' motion, and its marks."""
        time_s, fleet, estimator = frame * self.period_s, self._fleet, self._estimator
        self._take_poses(time_s)
        if frame == 0:
            estimator.release()
            fleet.release()
        # Where poses stay away too long commands stop, and with them the flight.
        self.marks.mark_failed(time_s > estimator.stamp_s + self._config.flight.coast_s)
        estimate, decision = self._decide(time_s, self.period_s if frame > 0 else 0.0)
        estimator.take_command(frame, decision.drive)
        fleet.commands.take(
            frame, time_s, decision.drive, self._config.full_thrust_n, self._config.thrust_curve
        )
        seen, ends = fleet.fly(time_s), time_s + self._starts + self._step_s
        self._cameras.expose(ends, seen)
        self.marks.command(time_s, decision, estimate, fleet.felt[0])
        # The last frame is held beyond the end of the flight.
        ends = ends[ends <= self._duration_s + 1e-9]
        wanted = np.array([self._trajectory.position_at(end) for end in ends.tolist()]).reshape(
            -1, 3, 1
        )
        places = fleet.track[1 : ends.size + 1, :3]
        self.marks.steps(ends, np.sqrt(((places - wanted) ** 2).sum(axis=1)), places[:, 2])
        self.marks.mark_failed(fleet.find_crashes(ends.size))

    def _take_poses(self, time_s: float) -> None:
        for who, stamp, position, attitude in self._cameras.take_arrivals(time_s):
            self._estimator.pose(who, stamp, position, attitude)

    def _decide(self, time_s: float, interval_s: float) -> tuple[Estimate, Decision]:
        """Estimate and command at ``time_s``, ``interval_s`` [s] after the last one."""
        estimate = self._estimator.predict(time_s)
        return estimate, self._controller.decide(estimate, self._trajectory.at(time_s), interval_s)
