"""The estimator: a model-based observer at the newest pose's instant, rolled forward through sent commands."""

from collections import deque

from groundstation.control.gains import Gains
from groundstation.control.model import Drive, Motion, rolled
from groundstation.control.observer import corrected, corrected_attitude, innovation
from groundstation.control.ops import FLOATS, Vec3
from groundstation.control.port import Estimate
from groundstation.poses.port import Pose
from groundstation.vehicle import Vehicle

STEP_LIMIT = 0.025
"""Longest single step of the model [s]; longer spans are split."""
NOMINAL_DT = 0.02
"""The pose interval at which the configured observer gains are given [s]: the paper's 50 Hz."""


class ModelEstimator:
    """State at the newest pose's time stamp, and the commands that act from then on.

    The state before the first pose is unknown; :meth:`predict` must not be called then.
    """

    def __init__(self, vehicle: Vehicle, gains: Gains) -> None:
        """Take what the controller is told about the vehicle, and the gains and switches."""
        self._vehicle = vehicle
        self._gains = gains
        self._mass = vehicle.mass_kg
        self._gravity = gains.gravity
        self._thrust_lag = vehicle.thrust_lag_s
        self._rate_lag = vehicle.rate_lag_s
        self._stamp = 0.0
        self._motion: Motion | None = None
        self._disturbance: Vec3 = (0.0, 0.0, 0.0)
        self._disturbance_step: Vec3 = (0.0, 0.0, 0.0)
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

    def follow(self, disturbance: Vec3) -> None:
        """Drive the observer by b̂ [m/s², NED] instead of its own d̂ (composite adaptation off, or raw)."""
        self._disturbance = disturbance

    def pose(self, pose: Pose) -> None:
        """Correct the model by one pose."""
        previous = self._motion
        if previous is None:
            self._motion = self._first(pose)
            self._stamp = pose.time_s
            return
        dt = pose.time_s - self._stamp
        if dt <= 0.0:
            return
        model = self._roll(previous, self._stamp, pose.time_s)
        gains = self._gains
        step = innovation(pose.position_ned, model.position)
        l1, l2, l3 = gains.observer_gains
        if gains.observer == "backward_euler":
            position, before = pose.position_ned, previous.position
            velocity = (
                (position[0] - before[0]) / dt,
                (position[1] - before[1]) / dt,
                (position[2] - before[2]) / dt,
            )
        else:
            position = corrected(model.position, l1, step)
            velocity = corrected(model.velocity, l2 / dt, step)
        if gains.composite == "provable":
            self._disturbance = corrected(self._disturbance, l3 / (dt * dt), step)
        elif gains.composite == "raw":
            self._disturbance_step = corrected(self._disturbance_step, l3 / (dt * dt), step)
        self._motion = Motion(
            position,
            velocity,
            corrected_attitude(FLOATS, model.attitude, pose.attitude, gains.attitude_gain),
            model.thrust,
            model.rates,
        )
        self._stamp = pose.time_s
        self._forget(pose.time_s)

    def predict(self, time_s: float) -> Estimate:
        """The vehicle at ``time_s``; with delay prediction off, as it was at the newest pose."""
        motion = self._motion
        assert motion is not None, "predict() before the first pose"
        if self._gains.delay_prediction:
            motion = self._roll(motion, self._stamp, time_s)
        else:
            # The actuators are modelled from our own commands and need no pose.
            now = self._roll(motion, self._stamp, time_s)
            motion = motion._replace(thrust=now.thrust, rates=now.rates)
        step, self._disturbance_step = self._disturbance_step, (0.0, 0.0, 0.0)
        return Estimate(time_s, motion, self._disturbance, step)

    def _first(self, pose: Pose) -> Motion:
        velocity = pose.velocity_ned or (0.0, 0.0, 0.0)
        drive = self._drives[-1][1] if self._drives else Drive(0.0, (0.0, 0.0, 0.0))
        return Motion(pose.position_ned, velocity, pose.attitude, drive.thrust, drive.rates)

    def _roll(self, motion: Motion, start: float, end: float) -> Motion:
        """``motion`` from ``start`` to ``end`` through the commands that act between."""
        drives = self._drives
        count = len(drives)
        time = start
        index = 0
        while index + 1 < count and drives[index + 1][0] <= time:
            index += 1
        while time < end - 1e-9:
            until = drives[index + 1][0] if index + 1 < count else end
            until = min(until, end, time + STEP_LIMIT)
            drive = drives[index][1] if count else Drive(motion.thrust, motion.rates)
            if until - time > 1e-9:
                motion = rolled(
                    FLOATS,
                    motion,
                    drive,
                    until - time,
                    mass=self._mass,
                    gravity=self._gravity,
                    disturbance=self._disturbance,
                    thrust_lag=self._thrust_lag,
                    rate_lag=self._rate_lag,
                )
            time = until
            while index + 1 < count and drives[index + 1][0] <= time + 1e-9:
                index += 1
        return motion

    def _forget(self, stamp: float) -> None:
        """Drop commands that no longer act after ``stamp``."""
        drives = self._drives
        while len(drives) > 1 and drives[1][0] <= stamp:
            drives.popleft()
