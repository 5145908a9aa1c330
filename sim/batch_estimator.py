"""The estimator of N vehicles: :class:`groundstation.control.estimator.ModelEstimator` on arrays.

The same pure functions on arrays of shape (N,), or on those vehicles whose pose has just arrived. Only what differs
between one vehicle and many is written here: who has a pose, and which command acts when.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from groundstation.control import effectiveness
from groundstation.control.effectiveness import Effectiveness, told
from groundstation.control.estimator import NOISE_FLOOR_M2, NOISE_MEMORY, STEP_LIMIT
from groundstation.control.gains import Gains
from groundstation.control.model import Drive, Driven, Motion, carried, driven
from groundstation.control.observer import (
    Covariance,
    Densities,
    begun,
    corrected,
    corrected_attitude,
    corrected_twice,
    fourth_difference,
    innovation,
    later,
    seen,
)
from groundstation.control.port import Estimate
from groundstation.ops import arrays
from groundstation.vehicle import Vehicle
from sim.columns import pick, put, zeros

OPS = arrays()
KEPT_FRAMES = 64
"""Commands remembered: longer than any outage that a flight survives."""
Index = npt.NDArray[np.intp]


class BatchEstimator:
    """State at each vehicle's newest pose; commands act from frames at multiples of ``period_s`` on."""

    def __init__(self, vehicle: Vehicle, gains: Gains, start: Any, idle_thrust_n: float, period_s: float) -> None:
        """``start`` is the (3, N) position [m, NED] at which the vehicles are held, with ``idle_thrust_n`` [N]."""
        n = start.shape[1]
        zero: Any = np.zeros(n)
        self._vehicle = vehicle
        self._gains = gains
        self._period = period_s
        self._densities = Densities(0.0, gains.acceleration_noise**2, gains.wind_noise**2, gains.wind_rate_noise**2)
        self._noise: Any = zero + gains.pose_noise_m**2
        self._covariance = Covariance(*(x + zero for x in begun(self._noise)))
        self._effectiveness = self._told(n)
        self._separates = gains.effectiveness_deviation > 0.0
        self._stamp: Any = np.full(n, -np.inf)
        self._motion: Any = Motion(
            tuple(start.copy()), zeros(n, 3), (np.ones(n), *zeros(n, 3)), zero + idle_thrust_n, zeros(n, 3)
        )
        self._disturbance, self._rate = zeros(n, 3), zeros(n, 3)
        self._times = np.full((5, n), -np.inf)
        self._places = np.zeros((5, 3, n))
        self._drives = np.zeros((KEPT_FRAMES, 4, n))
        self._drives[:, 0] = idle_thrust_n
        self._newest = 0

    @property
    def stamp_s(self) -> Any:
        """Time stamp of each vehicle's newest pose [s]."""
        return self._stamp

    @property
    def noise_m2(self) -> Any:
        """Variance of the position noise of each vehicle's poses as measured, per axis [m²]."""
        return self._noise

    def release(self) -> None:
        """As :meth:`ModelEstimator.release`."""
        zero = np.zeros_like(self._noise)
        self._covariance = Covariance(*(x + zero for x in begun(self._noise)))
        self._effectiveness = self._told(zero.size)
        self._disturbance, self._rate = zeros(zero.size, 3), zeros(zero.size, 3)

    def _told(self, count: int) -> Any:
        zero: Any = np.zeros(count)
        start = told(self._gains.effectiveness_deviation)
        return Effectiveness(zero + start.value, zero + start.variance, *(zeros(count, 3) for _ in range(4)))

    def sent(self, frame: int, drive: Drive) -> None:
        """The command of ``frame`` acts from frame · period on."""
        self._newest = frame
        self._drives[frame % KEPT_FRAMES] = (drive.thrust, *drive.rates)

    def pose(self, who: Index, stamp: Any, position: Any, attitude: Any) -> None:
        """One pose for each of the vehicles ``who``."""
        first = ~np.isfinite(self._stamp[who])
        if first.any():
            new = who[first]
            self._stamp[new] = stamp[first]
            put(self._motion.attitude, new, pick(attitude, first))
            who, stamp, position, attitude = who[~first], stamp[~first], pick(position, ~first), pick(attitude, ~first)
        if not who.size:
            return
        self._measure_noise(who, stamp, position)
        before = self._stamp[who]
        dt = stamp - before
        given = self._driven(who, before, stamp)
        model = self._at(who, given, dt)
        expected = later(pick(self._covariance, who), dt, self._densities)
        gain, covariance = seen(expected, self._noise[who])
        step = innovation(position, model.position)
        rate = pick(self._rate, who)
        now = corrected(pick(self._disturbance, who), dt, rate)
        if self._separates:
            e, mass, walk = pick(self._effectiveness, who), self._vehicle.mass_kg, self._gains.effectiveness_walk
            e = effectiveness.later(e, dt, given, mass, walk)
            e, moved = effectiveness.seen(OPS, e, step, gain, expected.pp + self._noise[who])
            put(self._effectiveness, who, e)
            place = corrected_twice(model.position, gain.p, step, moved, e.p)
            speed = corrected_twice(model.velocity, gain.v, step, moved, e.v)
            now = corrected_twice(now, gain.d, step, moved, e.d)
            rate = corrected_twice(rate, gain.c, step, moved, e.c)
        else:
            place, speed = corrected(model.position, gain.p, step), corrected(model.velocity, gain.v, step)
            now, rate = corrected(now, gain.d, step), corrected(rate, gain.c, step)
        put(self._disturbance, who, now)
        put(self._rate, who, rate)
        put(self._covariance, who, covariance)
        attitude = corrected_attitude(OPS, model.attitude, attitude, self._gains.attitude_gain)
        put(self._motion, who, Motion(place, speed, attitude, model.thrust, model.rates))
        self._stamp[who] = stamp

    def predict(self, time_s: float) -> Estimate:
        """Every vehicle at ``time_s``."""
        everyone = np.arange(self._stamp.size)
        h: Any = time_s - self._stamp
        ahead = self._at(everyone, self._driven(everyone, self._stamp, np.full_like(self._stamp, time_s)), h)
        return Estimate(
            time_s, ahead, corrected(self._disturbance, h, self._rate), (0.0, 0.0, 0.0), self._effectiveness.value
        )

    def _driven(self, who: Index, start: Any, end: Any) -> Any:
        """What the commands sent make of the state of ``who`` from ``start`` to ``end`` [s]."""
        vehicle, period = self._vehicle, self._period
        motion: Any = pick(self._motion, who)
        state: Any = Driven(motion.attitude, motion.thrust, motion.rates, zeros(who.size, 3), zeros(who.size, 3))
        time = start.copy()
        part = np.arange(who.size)
        while True:
            part = part[time[part] < end[part] - 1e-9]
            if not part.size:
                return state
            now = time[part]
            frame = np.minimum(np.floor((now + 1e-9) / period).astype(int), self._newest)
            until = np.minimum(end[part], now + STEP_LIMIT)
            until = np.where(frame < self._newest, np.minimum(until, (frame + 1) * period), until)
            drive = self._drives[frame % KEPT_FRAMES, :, who[part]].T
            some: Any = driven(
                OPS,
                pick(state, part),
                Drive(drive[0], (drive[1], drive[2], drive[3])),
                np.maximum(until - now, 1e-12),
                vehicle.thrust_lag_s,
                vehicle.rate_lag_s,
            )
            put(state, part, some)
            time[part] = until

    def _at(self, who: Index, given: Any, h: Any) -> Any:
        """The motion of ``who`` ``h`` [s] after their newest poses, after commands that did what ``given`` says."""
        north, east, down = pick(self._disturbance, who)
        mass: Any = self._vehicle.mass_kg / self._effectiveness.value[who]
        other = (north, east, down + self._gains.gravity)
        return carried(pick(self._motion, who), given, h, mass, other, pick(self._rate, who))

    def _measure_noise(self, who: Index, stamp: Any, position: Any) -> None:
        """As :meth:`ModelEstimator._measure_noise`."""
        times, places = self._times[:, who], self._places[:, :, who]
        times, places = np.roll(times, -1, axis=0), np.roll(places, -1, axis=0)
        times[4], places[4] = stamp, position
        self._times[:, who], self._places[:, :, who] = times, places
        with np.errstate(invalid="ignore"):  # -inf - -inf before the fifth pose
            step = times[1] - times[0]
            even = np.isfinite(times[0]) & (np.abs((times[4] - times[0]) - 4.0 * step) <= 0.1 * step)
        variance = fourth_difference(*(tuple(place) for place in places))
        noise = self._noise[who]
        measured = np.maximum(noise + (variance - noise) / NOISE_MEMORY, NOISE_FLOOR_M2)
        self._noise[who] = np.where(even, measured, noise)
