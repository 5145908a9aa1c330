"""The estimator: a model-based observer at the newest pose's instant, rolled forward through sent commands.

With composite adaptation in its provable form the observer is autonomous: it is driven by its own d̂ and ĉ, never
by b̂. Otherwise b̂ drives it (see :meth:`ModelEstimator.follow`).
"""

import math
from collections import deque

from groundstation.control import effectiveness
from groundstation.control.effectiveness import Effectiveness, along, pushed, told
from groundstation.control.estimation import Estimation
from groundstation.control.model import Drive, Motion, rolled
from groundstation.control.observer import (
    Densities,
    Gain,
    begun,
    corrected,
    corrected_attitude,
    fourth_difference,
    innovation,
    later,
    seen,
    seen_moving,
)
from groundstation.control.port import Estimate
from groundstation.ops import FLOATS, Vec3
from groundstation.poses.port import Pose
from groundstation.vehicle import Vehicle

ZERO: Vec3 = (0.0, 0.0, 0.0)
STEP_LIMIT = 0.025
"""Longest single step of the model [s]; longer spans are split."""
NOISE_MEMORY = 100
"""Poses over which the position noise is averaged."""
NOISE_FLOOR_M2 = 1e-12
"""Even a perfect source is not believed beyond a micrometre: float noise would do the rest [m²]."""


class ModelEstimator:
    """State at the newest pose's time stamp, and the commands that act from then on.

    The state before the first pose is unknown; :meth:`predict` must not be called then.
    """

    def __init__(self, vehicle: Vehicle, gains: Estimation) -> None:
        """Take what the controller is told about the vehicle, and the gains and switches."""
        self._vehicle = vehicle
        self._gains = gains
        self._mass = vehicle.mass_kg
        self._gravity = gains.gravity
        self._separates = gains.composite == "provable" and gains.effectiveness_deviation > 0.0
        self.frozen = False
        """True on the floor, whose push must not be learnt as an error of the thrust: λ̂ then rests."""
        self.diverged_m = 0.0
        """How far the newest pose was from where the model had the vehicle [m]."""
        self._thrust_lag = vehicle.thrust_lag_s
        self._rate_lag = vehicle.rate_lag_s
        wander, white = (
            gains.position_wander**2,
            (
                gains.acceleration_noise**2,
                gains.wind_noise**2,
                gains.wind_rate_noise**2,
            ),
        )
        self._still, self._moving = Densities(0.0, *white), Densities(wander, *white)
        self._noise = gains.pose_noise_m**2
        self._covariance = begun(self._noise)
        self._effectiveness = told(gains.effectiveness_deviation)
        self._recent: deque[tuple[float, Vec3]] = deque(maxlen=5)
        self._reset_count = 0
        self._stamp = 0.0
        self._motion: Motion | None = None
        self._disturbance: Vec3 = ZERO
        self._disturbance_rate: Vec3 = ZERO
        self._disturbance_step: Vec3 = ZERO
        self._drives: deque[tuple[float, Drive]] = deque()

    @property
    def ready(self) -> bool:
        """True from the first pose on."""
        return self._motion is not None

    @property
    def stamp_s(self) -> float:
        """Time stamp of the newest pose [s]."""
        return self._stamp

    def sent(self, time_s: float, drive: Drive) -> None:
        """A command acts from ``time_s`` on; one for the same instant or later replaces it."""
        drives = self._drives
        while drives and drives[-1][0] >= time_s:
            drives.pop()
        drives.append((time_s, drive))

    def release(self) -> None:
        """The vehicle begins to fly: forget the disturbance that its stand, or a hand, seemed to be."""
        self._covariance = begun(self._noise)
        self._effectiveness = told(self._gains.effectiveness_deviation)
        self._disturbance = self._disturbance_rate = self._disturbance_step = ZERO

    def lifted(self) -> Vec3:
        """The vehicle has left the floor; returns the disturbance that is left then [m/s², NED].

        Until then the floor's push was part of it, but that fades to nothing at this very instant: what is left
        vertically is the wind and the error of the thrust. Sideways it was the floor's friction, and is forgotten.
        """
        self.frozen = False
        down = self._disturbance[2]
        self.release()
        self._disturbance = (0.0, 0.0, down)
        return self._disturbance

    def follow(self, disturbance: Vec3) -> None:
        """Drive the observer by b̂ [m/s², NED] instead of its own d̂ (composite adaptation off, or raw)."""
        self._disturbance = disturbance

    @property
    def noise_m(self) -> float:
        """Position noise of the poses as measured, 1σ per axis [m]."""
        return math.sqrt(self._noise)

    def pose(self, pose: Pose) -> None:
        """Correct the model by one pose."""
        previous = self._motion
        if previous is None:
            self._motion = self._first(pose)
            self._reset_count, self._stamp = pose.reset_count, pose.time_s
            return
        dt = pose.time_s - self._stamp
        if dt <= 0.0:
            return
        if pose.reset_count != self._reset_count:
            # The source moved its origin, not the vehicle: take the new place, keep velocity and disturbance.
            previous = self._roll(previous, self._stamp, pose.time_s)
            self._motion = previous._replace(position=pose.position_ned, attitude=pose.attitude)
            self._disturbance = self._disturbance_at(pose.time_s)
            self._reset_count, self._stamp = pose.reset_count, pose.time_s
            self._recent.clear()
            return
        self._measure_noise(pose)
        gains = self._gains
        model = self._roll(previous, self._stamp, pose.time_s)
        separates = self._separates and not self.frozen
        densities = self._still if pose.velocity_ned is None else self._moving
        expected = later(self._covariance, dt, densities)
        gain, self._covariance = seen(expected, self._noise)
        step = innovation(pose.position_ned, model.position)
        self.diverged_m = math.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
        if separates:
            self._effectiveness = self._pushed(previous, model, dt)
        moved = self._correct(model.position, model.velocity, self._disturbance_at(pose.time_s), gain, step)
        if separates:
            moved = self._judge(*moved, gain, step, expected.pp + self._noise)
        if pose.velocity_ned is not None:
            expected, noise = self._covariance, gains.velocity_noise_m_s**2
            gain, self._covariance = seen_moving(expected, noise)
            step = innovation(pose.velocity_ned, moved[1])
            moved = self._correct(*moved, gain, step)
            if separates:
                moved = self._judge(*moved, gain, step, expected.vv + noise, of=1)
        position, velocity, self._disturbance = moved
        if gains.observer == "backward_euler":
            position = pose.position_ned
            velocity = corrected(ZERO, 1.0 / dt, innovation(position, previous.position))
        attitude = corrected_attitude(FLOATS, model.attitude, pose.attitude, gains.attitude_gain)
        self._motion = Motion(position, velocity, attitude, model.thrust, model.rates)
        self._stamp = pose.time_s
        self._forget(pose.time_s)

    def _correct(
        self, position: Vec3, velocity: Vec3, disturbance: Vec3, gain: Gain, step: Vec3
    ) -> tuple[Vec3, Vec3, Vec3]:
        """Position, velocity and disturbance, corrected by the innovation ``step``; ĉ and b̂'s step in place."""
        composite = self._gains.composite
        if composite == "provable":
            disturbance = corrected(disturbance, gain.d, step)
            self._disturbance_rate = corrected(self._disturbance_rate, gain.c, step)
        elif composite == "raw":
            self._disturbance_step = corrected(self._disturbance_step, gain.d, step)
        return corrected(position, gain.p, step), corrected(velocity, gain.v, step), disturbance

    def _pushed(self, previous: Motion, model: Motion, dt: float) -> Effectiveness:
        """Thrust effectiveness at the end of a roll of ``dt`` [s] from ``previous`` to ``model``."""
        x, y, z = self._disturbance_at(self._stamp + 0.5 * dt)
        push = pushed(self._effectiveness, previous, model, dt, (x, y, z + self._gravity))
        return effectiveness.later(self._effectiveness, dt, push, self._gains.effectiveness_walk)

    def _judge(
        self, position: Vec3, velocity: Vec3, disturbance: Vec3, gain: Gain, step: Vec3, variance: float, of: int = 0
    ) -> tuple[Vec3, Vec3, Vec3]:
        """Ask the innovation ``step`` what it says of the thrust; the chain moves along with it."""
        self._effectiveness, moved = effectiveness.seen(FLOATS, self._effectiveness, step, gain, variance, of)
        e = self._effectiveness
        self._disturbance_rate = along(self._disturbance_rate, e, moved, 3)
        return along(position, e, moved, 0), along(velocity, e, moved, 1), along(disturbance, e, moved, 2)

    def predict(self, time_s: float) -> Estimate:
        """The vehicle at ``time_s``; with delay prediction off, as it was at the newest pose."""
        motion = self._motion
        assert motion is not None, "predict() before the first pose"
        ahead = self._roll(motion, self._stamp, time_s)
        if not self._gains.delay_prediction:
            # The actuators are modelled from our own commands and need no pose.
            ahead = motion._replace(thrust=ahead.thrust, rates=ahead.rates)
        step, self._disturbance_step = self._disturbance_step, ZERO
        return Estimate(time_s, ahead, self._disturbance_at(time_s), step, self._effectiveness.value)

    def _measure_noise(self, pose: Pose) -> None:
        """Follow the noise of the source by fourth differences, over poses at equal intervals only."""
        recent = self._recent
        recent.append((pose.time_s, pose.position_ned))
        if len(recent) < 5:
            return
        (t0, a), (t1, b), (_, c), (_, d), (t4, e) = recent
        if abs((t4 - t0) - 4.0 * (t1 - t0)) > 0.1 * (t1 - t0):
            return
        variance = fourth_difference(a, b, c, d, e)
        self._noise = max(self._noise + (variance - self._noise) / NOISE_MEMORY, NOISE_FLOOR_M2)

    def _disturbance_at(self, time_s: float) -> Vec3:
        """The disturbance as it will have moved by ``time_s`` at its present rate."""
        return corrected(self._disturbance, time_s - self._stamp, self._disturbance_rate)

    def _first(self, pose: Pose) -> Motion:
        velocity = pose.velocity_ned or (0.0, 0.0, 0.0)
        drive = self._drives[-1][1] if self._drives else Drive(0.0, (0.0, 0.0, 0.0))
        return Motion(pose.position_ned, velocity, pose.attitude, drive.thrust, drive.rates)

    def _roll(self, motion: Motion, start: float, end: float) -> Motion:
        """``motion`` from ``start`` to ``end`` through the commands that act between."""
        drives, last = self._drives, len(self._drives) - 1
        disturbance = self._disturbance_at(0.5 * (start + end))
        mass, gravity = self._mass / self._effectiveness.value, self._gravity
        thrust_lag, rate_lag = self._thrust_lag, self._rate_lag
        time, index = start, 0
        drive = drives[0][1] if drives else Drive(motion.thrust, motion.rates)
        change = drives[1][0] if last > 0 else end
        while time < end - 1e-9:
            while index < last and change <= time + 1e-9:
                index += 1
                drive, change = drives[index][1], drives[index + 1][0] if index < last else end
            until = change if change < end else end
            if until - time > STEP_LIMIT:
                until = time + STEP_LIMIT
            motion = rolled(
                FLOATS,
                motion,
                drive,
                until - time,
                mass=mass,
                gravity=gravity,
                disturbance=disturbance,
                thrust_lag=thrust_lag,
                rate_lag=rate_lag,
            )
            time = until
        return motion

    def _forget(self, stamp: float) -> None:
        """Drop commands that no longer act after ``stamp``."""
        drives = self._drives
        while len(drives) > 1 and drives[1][0] <= stamp:
            drives.popleft()
