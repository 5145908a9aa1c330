"""Estimator of N vehicles: :class:`groundstation.core.estimation.estimator.ModelEstimator` on arrays.

The same pure functions on arrays of shape (N,), or on those vehicles whose pose has just arrived. Only what differs
between one vehicle and many is written here: who has a pose, and which command acts when.

Beside it the certificate of N flights (:class:`groundstation.core.control.adaptive.CertificateMonitor`): the same
V_m against the same bound, and how long that lasts; nobody is told. Written again is only what the watch does step by
step with numbers of one flight (a test holds both against each other).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from groundstation.core import NOISE_POSES
from groundstation.core.control import LASTING_S, Gains, Law, measure, noise_power
from groundstation.core.estimation import (
    NOISE_FLOOR_M2,
    NOISE_MEMORY,
    STEP_LIMIT,
    AlongTrack,
    Covariance,
    Densities,
    Effectiveness,
    StampNoise,
    correct,
    correct_attitude,
    correct_by_both,
    find_direction,
    fourth_difference,
    initial_covariance,
    initial_effectiveness,
    innovation,
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
from groundstation.core.geometry import Ops, Real, Vec3
from groundstation.core.messages import Decision, Estimate
from groundstation.core.vehicle import (
    ZERO,
    ActuatorCommand,
    ActuatorResponse,
    Motion,
    Vehicle,
    integrate_actuators,
    integrate_motion,
)
from sim.batch.kernel import Array, Index
from sim.batch.stages import Stages, pick, put, zeros

KEPT_FRAMES = 64
"""Commands remembered: longer than any outage that a flight survives."""


class Filtered(NamedTuple):
    """Known at the newest pose; see :class:`groundstation.core.estimation.estimator.ModelEstimator`. Elementwise."""

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
    """What commands make of the newest pose's state, as far as was asked last."""


class BatchEstimator:
    """State at each vehicle's newest pose; commands act from frames at multiples of ``period_s`` on."""

    def __init__(
        self, vehicle: Vehicle, gains: Gains, start: Any, idle_thrust_n: float, period_s: float, stages: Stages
    ) -> None:
        """``start`` is the (3, N) position [m, NED] at which the vehicles are held, with ``idle_thrust_n`` [N]."""
        n = start.shape[1]
        zero: Any = np.zeros(n)
        self._vehicle = vehicle
        self._gains = gains
        self._period = period_s
        self._delays = tuple(dict.fromkeys((vehicle.thrust_delay_s, vehicle.rate_delay_s)))
        self._densities = Densities(0.0, gains.acceleration_noise**2, gains.wind_noise**2, gains.wind_rate_noise**2)
        self._separates = gains.effectiveness_deviation > 0.0
        upright = (zero + 1.0, *zeros(n, 3))
        state: Any = Filtered(
            zero - np.inf,
            Motion(tuple(start.copy()), zeros(n, 3), upright, zero + idle_thrust_n, zeros(n, 3)),
            *(zeros(n, 3), zeros(n, 3)),
            Covariance(*zeros(n, 10)),
            Effectiveness(*zeros(n, 2), *(zeros(n, 3) for _ in range(4))),
            zero + gains.pose_noise_m**2,
            StampNoise(zero + gains.pose_noise_m**2, zero + 0.0),
            AlongTrack(zeros(n, 3), Covariance(*zeros(n, 10))),
            tuple(zero - np.inf for _ in range(5)),
            tuple(zeros(n, 3) for _ in range(5)),
            ActuatorResponse(zeros(n, 4), zero, zeros(n, 3), zeros(n, 3), zeros(n, 3)),
        )
        self._state = state
        self.release()
        self._drives = np.zeros((KEPT_FRAMES, 4, n))
        self._drives[:, 0] = idle_thrust_n
        self._newest = 0
        self._begin = stages(_rolling, (state.motion, state.driven))
        self._roll = stages(self._roll_each, state.driven)
        self._correct = stages(self._correct_each, state)
        self._ahead = stages(self._predict, state)

    @property
    def stamp_s(self) -> Any:
        """Time stamp of each vehicle's newest pose [s]."""
        return self._state.stamp

    @property
    def noise_m2(self) -> Any:
        """Variance of the position noise of each vehicle's poses as measured, per axis [m²]."""
        return self._state.noise

    def release(self) -> None:
        """As :meth:`ModelEstimator.release`."""
        state = self._state
        for covariance in (state.covariance, state.track.covariance):
            put(covariance, slice(None), initial_covariance(state.noise))
        put(state.effectiveness, slice(None), initial_effectiveness(self._gains.effectiveness_deviation))
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
            who, stamp, position, attitude = who[~first], stamp[~first], pick(position, ~first), pick(attitude, ~first)
        if who.size:
            with np.errstate(invalid="ignore"):  # -inf - -inf before the fifth pose
                self._drive(stamp, who)
                self._correct((stamp, position, attitude), who)

    def _correct_each(self, ops: Ops, old: Filtered, given: Any) -> Any:
        """One pose, whose stamp [s], position [m, NED] and attitude are given; commands have been rolled until then."""
        stamp, position, attitude = given
        noise, stamp_noise, times, places = self._measure_noise(ops, old, stamp, position)
        dt = stamp - old.stamp
        model = self._at(old, dt)
        expected = predict_covariance(old.covariance, dt, self._densities)
        step = innovation(position, model.position)
        if (told := self._gains.pose_jitter_s) == 0.0:
            expected = widen_covariance(ops, expected, noise, step)
            across2, track, along = expected.pp + noise, old.track, None
            gain, covariance = update_covariance(expected, noise)
        else:
            across, jitter2 = split_noise(ops, noise, stamp_noise, NOISE_FLOOR_M2, told)
            axis, speed2 = find_direction(ops, model.velocity)
            narrow = predict_covariance(old.track.covariance, dt, self._densities)
            both = turn_track(expected, AlongTrack(old.track.axis, narrow), axis)
            # Where stamps are not off there is one filter, and it is what the two begin with where they are again.
            off = jitter2 > 0.0
            wide, narrow = (
                Covariance(*(ops.where(off, a, b) for a, b in zip(one, expected, strict=True))) for one in both
            )
            most = across + jitter2 * speed2
            wide, narrow = widen_covariance(ops, wide, most, step), widen_covariance(ops, narrow, most, step)
            across2, along2 = wide.pp + across, narrow.pp + most
            gain, covariance = update_covariance(wide, across)
            more, narrow = update_covariance(narrow, most)
            track, along = AlongTrack(axis, narrow), weigh_along(ops, axis, gain, more, across2, along2)
        rate = old.rate
        now = correct(old.disturbance, dt, rate)
        place, speed = model.position, model.velocity
        if along is not None:
            (p, v, d, c), part = along.more, part_along(along.axis, step)
            place, speed = correct(place, p, part), correct(speed, v, part)
            now, rate = correct(now, d, part), correct(rate, c, part)
        e = old.effectiveness
        if self._separates:
            e = predict_effectiveness(e, dt, old.driven, self._vehicle.mass_kg, self._gains.effectiveness_walk)
            e, moved = update_effectiveness(ops, e, step, gain, across2, 0, along)
            place = correct_by_both(place, gain.p, step, moved, e.p)
            speed = correct_by_both(speed, gain.v, step, moved, e.v)
            now = correct_by_both(now, gain.d, step, moved, e.d)
            rate = correct_by_both(rate, gain.c, step, moved, e.c)
        else:
            place, speed = correct(place, gain.p, step), correct(speed, gain.v, step)
            now, rate = correct(now, gain.d, step), correct(rate, gain.c, step)
        turned = correct_attitude(ops, model.attitude, attitude, self._gains.attitude_gain)
        motion = Motion(place, speed, turned, model.thrust, model.rates)
        seen = (noise, stamp_noise, track, times, places)
        return Filtered(stamp, motion, now, rate, covariance, e, *seen, old.driven), ()

    def predict(self, time_s: float) -> Estimate:
        """Every vehicle at ``time_s``."""
        self._drive(np.full(self._state.stamp.size, time_s))
        return Estimate(time_s, *self._ahead((time_s,)))

    def _predict(self, _: Ops, old: Filtered, given: Any) -> Any:
        (time_s,) = given
        h = time_s - old.stamp
        return old, (self._at(old, h), correct(old.disturbance, h, old.rate), ZERO, old.effectiveness.value)

    def _drive(self, end: Any, who: Index | None = None) -> None:
        """Let the commands sent act on ``who``, or on all, from their newest poses to ``end`` [s]."""
        period = self._period
        self._begin((), who)
        who = np.arange(end.size) if who is None else who
        time = self._state.stamp[who]
        while (going := time < end - 1e-9).any():
            part, now, last = who[going], time[going], end[going]
            until, acting = np.minimum(last, now + STEP_LIMIT), []
            for delay in self._delays:  # of thrust, and of rates where it is another
                frame = np.minimum(np.floor((now - delay + 1e-9) / period).astype(int), self._newest)
                ends = (frame + 1) * period + delay
                until = np.where(frame < self._newest, np.minimum(until, ends), until)
                acting.append(self._drives[frame % KEPT_FRAMES, :, part].T)
            thrust, rates = acting[0][0], acting[-1][1:]
            self._roll((thrust, tuple(rates), np.maximum(until - now, 1e-12)), part)
            time[going] = until

    def _roll_each(self, ops: Ops, old: ActuatorResponse, given: Any) -> Any:
        thrust, rates, h = given
        return integrate_actuators(
            ops, old, ActuatorCommand(thrust, rates), h, self._vehicle.thrust_lag_s, self._vehicle.rate_lag_s
        ), ()

    def _at(self, old: Filtered, h: Any) -> Any:
        """The motion ``h`` [s] after the newest pose; commands have been rolled until then."""
        north, east, down = old.disturbance
        mass: Any = self._vehicle.mass_kg / old.effectiveness.value
        other = (north, east, down + self._gains.gravity)
        return integrate_motion(old.motion, old.driven, h, mass, other, old.rate, self._vehicle.drag_per_s)

    def _measure_noise(self, ops: Ops, old: Filtered, stamp: Any, position: Any) -> Any:
        """As :meth:`ModelEstimator._measure_noise`."""
        times, places = (*old.times[1:], stamp), (*old.places[1:], position)
        step: Real = times[1] - times[0]
        # Before the fifth pose the first of the times is -inf, and the comparison false.
        even = abs((times[4] - times[0]) - 4.0 * step) <= 0.1 * step
        noise, (before, speed2) = old.noise, old.stamp_noise
        variance, along, way2 = fourth_difference(*places)
        measured = noise + (variance - noise) / NOISE_MEMORY
        fast2 = way2 / (times[4] - times[0]) ** 2
        seen = StampNoise(
            ops.where(even, before + (along - before) / NOISE_MEMORY, before),
            ops.where(even, speed2 + (fast2 - speed2) / NOISE_MEMORY, speed2),
        )
        return ops.where(even, ops.clamp(measured, NOISE_FLOOR_M2, math.inf), noise), seen, times, places


def _rolling(_: Ops, old: tuple[Motion, ActuatorResponse], __: Any) -> Any:
    """Begin to roll commands at the newest pose."""
    motion = old[0]
    return (motion, ActuatorResponse(motion.attitude, motion.thrust, motion.rates, ZERO, ZERO)), ()


class BatchWatch:
    """Looks at every command of N flights, and changes nothing."""

    def __init__(self, count: int, law: Law, period_s: float) -> None:
        """Take the gains, and the time from each command to the next [s]."""
        self._law, self._period, self._measure = law, period_s, measure(law)
        self._poses, self._counted_s = np.zeros(count, np.intp), np.zeros(count)
        self._power: Any = np.full(count, self._measure.decrease.power)
        self._v: Any = None
        self._fall: Any = None
        self._clamped: Any = None
        self._excess, self._peak = np.zeros(count), np.zeros(count)
        self._above_s, self._outside_s = np.zeros(count), np.zeros(count)
        self._violated, self._suspended, self._looks = np.zeros(count), np.zeros(count), 0

    def pose(self, who: Index, stamp_s: Array, noise_m2: Array) -> None:
        """One pose of each of the vehicles ``who``; D follows the noise of everyone's as measured [m², per axis]."""
        self._poses[who] += 1
        turn = self._poses[who] % NOISE_POSES == 1
        if not turn.any():
            return
        who, stamp_s = who[turn], stamp_s[turn]
        again = self._poses[who] > 1
        some, now = who[again], stamp_s[again]
        noise_m: Any = np.sqrt(noise_m2[some])
        interval_s: Any = (now - self._counted_s[some]) / NOISE_POSES
        self._power[some] = self._measure.decrease.power + noise_power(self._law, noise_m, interval_s)
        self._counted_s[who] = stamp_s

    def look(self, decision: Decision) -> None:
        """One command of each."""
        self._looks += 1
        v, fall = self._measure.of(decision.diagnostics)
        if self._v is not None and self._period < LASTING_S:  # after longer gaps each look begins anew
            self._see(v, fall, decision.diagnostics.b_hat)
        self._v, self._fall, self._clamped = v, fall, decision.saturated

    def _see(self, v: Any, fall: Any, b_hat: Any) -> None:
        dt, known, clamped = self._period, self._measure.decrease, self._clamped
        fallen = 0.5 * dt * (fall + self._fall)
        excess = self._excess + (v - self._v) + known.share * fallen - self._power * dt
        # The highest V since it has been above its bound.
        self._peak = np.maximum(np.where(self._excess == 0.0, 0.0, self._peak), v)
        self._excess = np.minimum(np.maximum(excess, 0.0), self._peak + known.spare)
        # While adaptation is suspended nothing is promised, so that time does not count.
        above = self._excess > known.spare
        self._above_s = np.where(above, self._above_s + np.where(clamped, 0.0, dt), 0.0)
        x, y, z = b_hat
        beyond = x * x + y * y + z * z > self._measure.b_bound2
        self._outside_s = np.where(beyond, self._outside_s + dt, 0.0)
        violated = np.maximum(self._above_s, self._outside_s) >= LASTING_S
        self._violated += violated
        self._suspended += clamped & ~violated

    def shares(self) -> tuple[Array, Array]:
        """Shares of the commands at which the bound was violated, and suspended [-]."""
        looks = max(self._looks, 1)
        return self._violated / looks, self._suspended / looks
