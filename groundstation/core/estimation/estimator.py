"""Estimator: a model-based observer at the newest pose's instant, rolled forward through sent commands.

What it is told, under every controller the same, is part of the config section ``[controller]``. With composite
adaptation in its provable form the observer is autonomous: it is driven by its own d̂ and ĉ, never by b̂. Otherwise b̂
drives it (see :meth:`ModelEstimator.follow`).
"""

import math
from collections import deque
from typing import Annotated, Literal, TypeAlias

import msgspec

from groundstation.core.estimation.observer import (
    AlongGain,
    AlongTrack,
    Covariance,
    Densities,
    KalmanGain,
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
    update_moving_covariance,
    weigh_along,
    widen_covariance,
)
from groundstation.core.geometry import FLOATS, Vec3
from groundstation.core.messages import Estimate, Pose
from groundstation.core.vehicle import (
    ZERO,
    ActuatorCommand,
    ActuatorResponse,
    Motion,
    Vehicle,
    integrate_actuators,
    integrate_motion,
    new,
    schedule,
)

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]

Composite: TypeAlias = Literal["provable", "raw", "off"]
"""What innovations correct beside the motion: the observer's own d̂, a controller's b̂, or nothing."""


class Estimation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Gains and switches of observer and predictor. Defaults: docs/explanation/law.md."""

    gravity: Positive = 9.81
    """g [m/s²]."""
    delay_prediction: bool = True
    """Roll the estimate forward from the pose's time stamp to the instant the command acts."""
    observer: Literal["model", "backward_euler"] = "model"
    """Velocity from a model-based observer, or from the paper's backward difference of positions."""
    attitude_gain: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 1.0
    """How much of a pose's attitude is believed against the model's [-]; 1 takes the measurement."""
    pose_noise_m: Positive = 0.0003
    """Position noise to begin with, 1σ per axis [m]; then measured in flight."""
    pose_jitter_s: NonNegative | None = None
    """How far the stamps of poses are off by chance, 1σ: noise along the velocity [s]. Not told, it is measured in
    flight; 0 takes them as they are."""
    velocity_noise_m_s: Positive = 0.02
    """Velocity noise of a source that measures velocity, 1σ per axis, beside its bias [m/s]."""
    velocity_bias_m_s: NonNegative = 0.05
    """How far on average such a velocity may be off that of its own positions, which is then believed, at most and per
    axis [m/s]; ArduCopter's, with a simulated GPS, is off by 0.016. 0 takes it as it is."""
    position_wander: NonNegative = 0.2
    """How the position of such a source wanders against its velocity [m/√s]; PX4 on simulated GPS: 0.18."""
    acceleration_noise: Positive = 0.01
    """What the model's acceleration may do from one instant to the next [m/s² per √Hz]."""
    wind_noise: Positive = 0.1
    """How the disturbance may jump [m/s³ per √Hz]: turbulence of 0.2 m/s² RMS and 2.6 s has 0.18."""
    wind_rate_noise: Positive = 1.2
    """How its rate may jump [m/s⁴ per √Hz]: larger follows gusts faster and takes more noise for wind."""

    effectiveness_deviation: NonNegative = 0.15
    """How well thrust over mass is known before the flight, 1σ [-]; 0 leaves all to the disturbance."""
    effectiveness_walk: NonNegative = 0.005
    """How it may wander in flight [1/√s]."""

    @property
    def kind(self) -> str:
        """The controller's name, as ``controller.kind`` has it."""
        return str(self.__struct_config__.tag)

    @property
    def composite(self) -> Composite:
        """The observer finds the disturbance by itself, unless the controller's config says otherwise."""
        return "provable"

    @property
    def kb(self) -> float:
        """Weight of adaptation in V [1/s² per m/s²]: none, unless the controller adapts."""
        return 0.0


STEP_LIMIT = 0.025
"""Longest single step of the model [s]; longer spans are split."""
NOISE_MEMORY = 100
"""Poses over which the position noise is averaged."""
NOISE_FLOOR_M2 = 1e-12
"""Even a perfect source is not believed beyond a micrometre: float noise would do the rest [m²]."""
BIAS_MEMORY_S = 10.0
"""Over which the mean of a measured velocity is that of its positions [s]."""
LIFTED_M_S, LIFTED_M_S2 = 0.1, 0.5
"""How well speed [m/s] and disturbance [m/s²] are known at lift-off, 1σ per axis."""


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
        self._provable = gains.composite == "provable"
        self._separates = self._provable and gains.effectiveness_deviation > 0.0
        self.frozen = False
        """True on the floor, whose push must not be learnt as an error of the thrust: λ̂ then rests."""
        self._held: Vec3 | None = None
        self.given: ActuatorResponse | None = None
        """What the commands made of the motion from the pose before to the newest; None at first and after a reset."""
        self.diverged_m = 0.0
        """How far the newest pose was from where the model had the vehicle [m]."""
        self._thrust_lag = vehicle.thrust_lag_s
        self._rate_lag = vehicle.rate_lag_s
        self._drag = vehicle.drag_per_s
        white = (gains.acceleration_noise**2, gains.wind_noise**2, gains.wind_rate_noise**2)
        self._still, self._moving = Densities(0.0, *white), Densities(gains.position_wander**2, *white)
        self._noise = gains.pose_noise_m**2
        self._stamp_noise = StampNoise(self._noise, 0.0)
        self._covariance = initial_covariance(self._noise)
        self._track: AlongTrack | None = None
        self._bias: Vec3 = ZERO
        self._effectiveness = initial_effectiveness(gains.effectiveness_deviation)
        self._recent: deque[tuple[float, Vec3]] = deque(maxlen=5)
        self._reset_count = 0
        self._stamp = 0.0
        self._motion: Motion | None = None
        self._disturbance: Vec3 = ZERO
        self._disturbance_rate: Vec3 = ZERO
        self._disturbance_step: Vec3 = ZERO
        self._drives: deque[tuple[float, ActuatorCommand]] = deque()
        self._path: list[tuple[float, ActuatorResponse, int]] = []

    @property
    def ready(self) -> bool:
        """True from the first pose on."""
        return self._motion is not None

    @property
    def stamp_s(self) -> float:
        """Time stamp of the newest pose [s]."""
        return self._stamp

    @property
    def motion(self) -> Motion | None:
        """The vehicle at the newest pose; None before the first."""
        return self._motion

    @property
    def disturbance(self) -> Vec3:
        """d̂ at the newest pose [m/s², NED]."""
        return self._disturbance

    @property
    def effectiveness(self) -> float:
        """λ̂, true thrust over told thrust [-]."""
        return float(self._effectiveness.value)

    def add_command(self, time_s: float, drive: ActuatorCommand) -> None:
        """The actuators see a command at ``time_s``; one for the same instant or later replaces it."""
        since_s, path = schedule(self._drives, self._vehicle, time_s, drive), self._path
        while len(path) > 1 and path[-1][0] > since_s:
            path.pop()

    def release(self) -> None:
        """The vehicle begins to fly: forget the disturbance that its stand, or a hand, seemed to be."""
        self._covariance, self._track = initial_covariance(self._noise), None
        self._effectiveness = initial_effectiveness(self._gains.effectiveness_deviation)
        self._disturbance = self._disturbance_rate = self._disturbance_step = ZERO

    def lift_off(self, climb_m_s: float, hover_share: float) -> Vec3:
        """The vehicle has left the floor, climbs, and seems to hover at this share of its told weight.

        What the observer has made of the floor's push and friction is forgotten, and so is the speed that it took
        the vehicle to have on the floor. What the hover thrust is off by is divided between λ̂ and the disturbance as
        both are uncertain; which of them it is does not show while thrust stays as it is.
        Returns the disturbance that is left [m/s², NED].
        """
        self.frozen = False
        self.release()
        self._covariance = self._covariance._replace(vv=LIFTED_M_S**2, dd=LIFTED_M_S2**2)
        if self._motion is not None:
            north, east, _ = self._motion.velocity
            self._motion = self._motion._replace(velocity=(north, east, -climb_m_s))
        value = 1.0
        if self._separates:
            by_thrust = (self._gains.effectiveness_deviation * self._gravity) ** 2
            weight = by_thrust / (by_thrust + 1.0)  # initial_covariance() has the disturbance at 1 m/s²
            value = 1.0 / (1.0 + weight * (hover_share - 1.0))
            e = self._effectiveness
            moved = (0.0, 0.0, hover_share * self._gravity)
            self._effectiveness = e._replace(value=value, variance=(1.0 - weight) * e.variance, d=moved)
        self._disturbance = (0.0, 0.0, (value * hover_share - 1.0) * self._gravity)
        return self._disturbance

    def hold(self, disturbance: Vec3, effectiveness: float) -> None:
        """The poses are suspect: learn nothing; ``disturbance`` [m/s², NED] and λ̂ stay so until :meth:`resume`."""
        self._held = disturbance
        self._effectiveness = self._effectiveness._replace(value=effectiveness)

    def resume(self) -> None:
        """The poses are believed again."""
        self._held = None

    @property
    def holds(self) -> bool:
        """Whether nothing is learnt."""
        return self._held is not None

    def follow(self, disturbance: Vec3) -> None:
        """Drive the observer by b̂ [m/s², NED] instead of its own d̂ (composite adaptation off, or raw)."""
        self._disturbance = disturbance

    @property
    def noise_m(self) -> float:
        """Position noise of the poses as measured, 1σ per axis [m]."""
        return math.sqrt(self._noise)

    def update(self, pose: Pose) -> None:
        """Correct the model by one pose."""
        self.given = None
        previous = self._motion
        if previous is None:
            self._begin(self._first(pose), pose)
            return
        dt = pose.time_s - self._stamp
        if dt <= 0.0:
            return
        if pose.reset_count != self._reset_count:
            # The source moved its origin, not the vehicle: take the new place, keep velocity and disturbance.
            moved = self._at(previous, self._integrate_commands(pose.time_s), dt)
            self._disturbance = correct(self._disturbance, dt, self._disturbance_rate)
            self._begin(moved._replace(position=pose.position_ned, attitude=pose.attitude), pose)
            self._recent.clear()
            return
        self._measure_noise(pose)
        gains = self._gains
        given = self.given = self._integrate_commands(pose.time_s)
        model = self._at(previous, given, dt)
        if self._separates and not self.frozen and self._held is None:
            self._effectiveness = predict_effectiveness(
                self._effectiveness, dt, given, self._mass, gains.effectiveness_walk
            )
        step = innovation(pose.position_ned, model.position)
        self.diverged_m = math.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
        disturbance = correct(self._disturbance, dt, self._disturbance_rate)
        expected, track, noise, late2 = self._expect(pose, dt, model.velocity)
        expected = widen_covariance(FLOATS, expected, noise + late2, step)
        gain, self._covariance = update_covariance(expected, noise)
        across2, along = expected.pp + noise, None
        if track is not None:
            narrow = widen_covariance(FLOATS, track.covariance, noise + late2, step)
            along2 = narrow.pp + noise + late2
            more, covariance = update_covariance(narrow, noise + late2)
            along, track = (
                weigh_along(FLOATS, track.axis, gain, more, across2, along2),
                track._replace(covariance=covariance),
            )
        chain = self._correct(model.position, model.velocity, disturbance, gain, step, across2, 0, along)
        if pose.velocity_ned is not None:
            expected, noise = self._covariance, gains.velocity_noise_m_s**2
            gain, self._covariance = update_moving_covariance(expected, noise)
            across2 = expected.vv + noise
            if track is not None:
                along2 = track.covariance.vv + noise
                more, covariance = update_moving_covariance(track.covariance, noise)
                along, track = (
                    weigh_along(FLOATS, track.axis, gain, more, across2, along2),
                    track._replace(covariance=covariance),
                )
            measured = innovation(pose.velocity_ned, self._bias)
            chain = self._correct(*chain, gain, innovation(measured, chain[1]), across2, 1, along)
            if len(self._recent) > 1 and not self.frozen and self._held is None:
                self._learn_bias(pose, measured, dt)
        self._track = track
        position, velocity, self._disturbance = chain
        if self._held is not None:
            self._disturbance, self._disturbance_rate = self._held, ZERO
        if gains.observer == "backward_euler":
            position = pose.position_ned
            velocity = correct(ZERO, 1.0 / dt, innovation(position, previous.position))
        attitude = correct_attitude(FLOATS, model.attitude, pose.attitude, gains.attitude_gain)
        self._begin(new(Motion, (position, velocity, attitude, model.thrust, model.rates)), pose)

    def _begin(self, motion: Motion, pose: Pose) -> None:
        """From here on: ``motion`` at the time stamp of ``pose``; commands that no longer act are dropped."""
        stamp, drives = pose.time_s, self._drives
        while len(drives) > 1 and drives[1][0] <= stamp:
            drives.popleft()
        self._motion, self._stamp, self._reset_count = motion, stamp, pose.reset_count
        self._path = [(stamp, new(ActuatorResponse, (motion.attitude, motion.thrust, motion.rates, ZERO, ZERO)), 0)]

    def _expect(self, pose: Pose, dt: float, velocity: Vec3) -> tuple[Covariance, AlongTrack | None, float, float]:
        """Before ``pose``: covariance across the motion, that along it, and the noise of the two [m²].

        The second noise is what comes on top along the motion; without it there is but one covariance.
        """
        densities = self._still if pose.velocity_ned is None else self._moving
        expected = predict_covariance(self._covariance, dt, densities)
        told_s = self._gains.pose_jitter_s
        noise, jitter2 = split_noise(FLOATS, self._noise, self._stamp_noise, NOISE_FLOOR_M2, told_s)
        if jitter2 == 0.0:
            return expected, None, noise, 0.0
        axis, speed2 = find_direction(FLOATS, velocity)
        along = expected
        if self._track is not None:
            along = predict_covariance(self._track.covariance, dt, densities)
            expected, along = turn_track(expected, AlongTrack(self._track.axis, along), axis)
        return expected, AlongTrack(axis, along), noise, jitter2 * speed2

    def consistency(self, pose: Pose) -> float:
        """Normalized innovation squared of ``pose``, which comes next: 3 on average where the filter is consistent."""
        ahead = self.predict(pose.time_s).motion
        expected, track, noise, late2 = self._expect(pose, pose.time_s - self._stamp, ahead.velocity)
        x, y, z = step = innovation(pose.position_ned, ahead.position)
        off2, along2 = x * x + y * y + z * z, 0.0
        if track is None:
            return off2 / (expected.pp + noise)
        x, y, z = part_along(track.axis, step)
        along2 = x * x + y * y + z * z
        return (off2 - along2) / (expected.pp + noise) + along2 / (track.covariance.pp + noise + late2)

    def _correct(
        self,
        position: Vec3,
        velocity: Vec3,
        disturbance: Vec3,
        gain: KalmanGain,
        step: Vec3,
        variance: float,
        of: int,
        along: AlongGain | None,
    ) -> tuple[Vec3, Vec3, Vec3]:
        """Position, velocity and disturbance, corrected by the innovation ``step``; ĉ, λ̂ and b̂'s step in place."""
        if along is not None:
            (p, v, d, c), part = along.more, part_along(along.axis, step)
            position, velocity = correct(position, p, part), correct(velocity, v, part)
            if self._provable:
                disturbance = correct(disturbance, d, part)
                self._disturbance_rate = correct(self._disturbance_rate, c, part)
            elif self._gains.composite == "raw":
                self._disturbance_step = correct(self._disturbance_step, d, part)
        p, v, d, c = gain
        if self._separates and not self.frozen and self._held is None:
            # What the innovation says of the thrust moves the chain, too.
            e, moved = update_effectiveness(FLOATS, self._effectiveness, step, gain, variance, of, along)
            self._effectiveness = e
            self._disturbance_rate = correct_by_both(self._disturbance_rate, c, step, moved, e.c)
            return (
                correct_by_both(position, p, step, moved, e.p),
                correct_by_both(velocity, v, step, moved, e.v),
                correct_by_both(disturbance, d, step, moved, e.d),
            )
        if self._provable:
            disturbance = correct(disturbance, d, step)
            self._disturbance_rate = correct(self._disturbance_rate, c, step)
        elif self._gains.composite == "raw":
            self._disturbance_step = correct(self._disturbance_step, d, step)
        return correct(position, p, step), correct(velocity, v, step), disturbance

    def predict(self, time_s: float) -> Estimate:
        """The vehicle at ``time_s``; with delay prediction off, as it was at the newest pose."""
        motion = self._motion
        assert motion is not None, "predict() before the first pose"
        h = time_s - self._stamp
        ahead = self._at(motion, self._integrate_commands(time_s), h)
        if not self._gains.delay_prediction:
            # The actuators are modelled from our own commands and need no pose.
            ahead = motion._replace(thrust=ahead.thrust, rates=ahead.rates)
        step, self._disturbance_step = self._disturbance_step, ZERO
        disturbance = correct(self._disturbance, h, self._disturbance_rate)
        return new(Estimate, (time_s, ahead, disturbance, step, self._effectiveness.value))

    def _measure_noise(self, pose: Pose) -> None:
        """Follow the noise of the source by fourth differences, over poses at equal intervals only."""
        recent = self._recent
        recent.append((pose.time_s, pose.position_ned))
        if len(recent) < 5:
            return
        (t0, a), (t1, b), (_, c), (_, d), (t4, e) = recent
        if abs((t4 - t0) - 4.0 * (t1 - t0)) > 0.1 * (t1 - t0):
            return
        variance, along, way2 = fourth_difference(a, b, c, d, e)
        self._noise = max(self._noise + (variance - self._noise) / NOISE_MEMORY, NOISE_FLOOR_M2)
        before, speed2 = self._stamp_noise
        self._stamp_noise = StampNoise(
            before + (along - before) / NOISE_MEMORY, speed2 + (way2 / (t4 - t0) ** 2 - speed2) / NOISE_MEMORY
        )

    def _learn_bias(self, pose: Pose, measured: Vec3, dt: float) -> None:
        """Have the mean of the velocities be what positions moved by; ``measured`` [m/s] is without the bias so far."""
        (_, before), (_, now) = self._recent[-2], self._recent[-1]
        most, k = self._gains.velocity_bias_m_s, 1.0 / BIAS_MEMORY_S
        x, y, z = correct(self._bias, k, innovation(correct(ZERO, dt, measured), innovation(now, before)))
        self._bias = (max(-most, min(most, x)), max(-most, min(most, y)), max(-most, min(most, z)))

    def _first(self, pose: Pose) -> Motion:
        velocity = pose.velocity_ned or (0.0, 0.0, 0.0)
        drive = self._drives[-1][1] if self._drives else ActuatorCommand(0.0, (0.0, 0.0, 0.0))
        return Motion(pose.position_ned, velocity, pose.attitude, drive.thrust, drive.rates)

    def _integrate_commands(self, end: float) -> ActuatorResponse:
        """What the commands sent make of the newest pose's state by ``end`` [s]; steps are kept for the next call."""
        drives, path = self._drives, self._path
        while len(path) > 1 and path[-1][0] > end:
            path.pop()
        time, state, index = path[-1]
        last = len(drives) - 1
        while time < end - 1e-9:
            while index < last and drives[index + 1][0] <= time + 1e-9:
                index += 1
            drive = drives[index][1] if drives else ActuatorCommand(state.thrust, state.rates)
            until = time + STEP_LIMIT
            if index < last and drives[index + 1][0] < until:
                until = drives[index + 1][0]
            if until > end:
                return integrate_actuators(FLOATS, state, drive, end - time, self._thrust_lag, self._rate_lag)
            state = integrate_actuators(FLOATS, state, drive, until - time, self._thrust_lag, self._rate_lag)
            time = until
            path.append((time, state, index))
        return state

    def _at(self, motion: Motion, given: ActuatorResponse, h: float) -> Motion:
        """``motion`` of the newest pose ``h`` [s] later, after commands that did what ``given`` says."""
        x, y, z = self._disturbance
        mass = self._mass / self._effectiveness.value
        return integrate_motion(motion, given, h, mass, (x, y, z + self._gravity), self._disturbance_rate, self._drag)
