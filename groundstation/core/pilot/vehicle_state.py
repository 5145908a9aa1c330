"""State of one vehicle by its poses, and the health of these poses. Sans-IO."""

import math
from collections import deque
from collections.abc import Callable
from functools import partial

import msgspec

from groundstation.core.control import ControllerConfig, Descent, ExcitationTones
from groundstation.core.estimation import Ahead, ModelEstimator, Reckoning, Trusted
from groundstation.core.geometry import ZERO, Quat, Vec3, heading, interpolate
from groundstation.core.health import (
    SUSPECT_M_S2,
    HealthState,
    PoseGate,
    PoseHealth,
    ResponseLatency,
)
from groundstation.core.messages import Estimate, Pose
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle

DISTURBANCE_MEMORY_S = 3.0
"""Time constant of the mean disturbance that descents lean into [s]: longer than a gust, and than
false poses are believed."""
SPARSE_MEAN_S = 1.0
"""Time constant of the mean interval of the poses [s]."""
RECENT_POSES = 6
"""Poses from which a velocity is taken where they respond again [-]: .1 s at 50 Hz."""
NEAR_FLOOR_M = 0.12
"""Height below which the floor may hold the vehicle, so that its poses need not respond [m]."""
NOISE_POSES = 50
"""Number of poses after which the certificate takes their noise and interval again [-]."""


class MeanDisturbance:
    """Mean disturbance since the beginning, later of the last ``DISTURBANCE_MEMORY_S``, for the
    present λ̂.
    """

    def __init__(self, gravity: float) -> None:
        self.value: Vec3 | None = None
        """[m/s², NED]; None before the first command."""
        self._over_s, self._effectiveness, self._gravity = 0.0, 1.0, gravity
        self._suspect: Vec3 | None = None
        """Mean since the poses became suspect; None while they are not."""
        self._suspect_s = 0.0

    def add(self, estimate: Estimate, interval_s: float, *, is_suspect: bool = False) -> Vec3:
        """Take the estimate of one command, ``interval_s`` [s] after the one before.

        Return the mean.

        ``is_suspect``: whether the poses are suspect.
        """
        now, scale = estimate.disturbance, estimate.effectiveness
        # Only the sum of disturbance and thrust error is observable: that sum is kept.
        if self.value is not None:
            north, east, down = self.value
            self.value = (north, east, down + (scale - self._effectiveness) * self._gravity)
        self._effectiveness = scale
        if self.value is None:
            self.value = now
        elif interval_s > 0.0:
            self._over_s = min(self._over_s + interval_s, DISTURBANCE_MEMORY_S)
            share = interval_s / (interval_s + self._over_s)
            self.value = interpolate(self.value, now, share)
        if not is_suspect:
            self._suspect, self._suspect_s = None, 0.0
        elif self._suspect is None:
            self._suspect = now
        elif interval_s > 0.0:
            self._suspect_s += interval_s
            share = interval_s / (interval_s + self._suspect_s)
            self._suspect = interpolate(self._suspect, now, share)
        return self.value

    def confirm(self) -> None:
        """Take the mean since the poses became suspect: they have responded, so that disturbance is
        true.
        """
        self.value = self._suspect or self.value


class VehicleState:
    """State of one vehicle by its poses and the commands sent to it, and the health of the poses.

    Times are on the event loop's clock [s].
    """

    def __init__(
        self,
        vehicle: Vehicle,
        config: ControllerConfig,
        floor_z_m: float,
        health: Callable[[float, float], PoseHealth],
        *,
        follows_poses: bool,
    ) -> None:
        """Take the configured vehicle, the controller's config, and the position at rest on the
        floor [m, NED].

        ``health`` makes the monitor of the poses from mass and g. ``follows_poses``: a command
        leaves at each pose. A pose is compared with the commands only after its own has left, as
        long as nothing speaks against the poses.
        """
        self._vehicle, self._floor, self._follows_poses = vehicle, floor_z_m, follows_poses
        self._gravity = config.gravity
        self.estimator = ModelEstimator(vehicle, config)
        """Motion at the newest pose, and its prediction."""
        self.tones = ExcitationTones(vehicle, config.gravity)
        """Tones beside the commands, to which true poses respond."""
        self.health = health(vehicle.mass_kg, config.gravity)
        """Health of the poses."""
        self.response = ResponseLatency()
        """Latency of the vehicle's turns beyond the configured one."""
        self.mean_disturbance = MeanDisturbance(config.gravity)
        """Mean disturbance of the last seconds."""
        self.reckoning = Reckoning(vehicle, config.gravity)
        """Motion by the commands alone."""
        self.received = _ReceivedPoses()
        """Poses that are believed."""
        self.descent: Descent | None = None
        """Failsafe descent that is flown; None before."""
        self.is_released = self.is_paused = self.is_uplink_lost = False
        """Whether the vehicle flies; whether poses need not respond; whether commands may not
        arrive."""
        self._reference_down_m = math.inf
        """Position of the reference at the newest command of the law [m, NED]."""
        self._gate = PoseGate()
        self._has_climbed = False
        self._due: Callable[[], None] | None = None
        """Comparison of the newest pose with the commands that is still to be done; None without
        one."""

    @property
    def newest_pose(self) -> Pose | None:
        """The newest believed pose, or None."""
        return self.received.newest

    @property
    def noise_m(self) -> float:
        """Measured position noise of the poses, 1σ per axis [m]."""
        return self.estimator.noise_m

    @property
    def newest_s(self) -> float:
        """Time stamp of that pose [s]; -inf without one."""
        newest = self.received.newest
        return -math.inf if newest is None else newest.time_s

    @property
    def are_poses_doubted(self) -> bool:
        """Whether the poses are suspected, or have failed."""
        return self.health.state is not HealthState.OK

    @property
    def is_blind(self) -> bool:
        """Whether a failsafe descent takes position and velocity from the model."""
        return self.descent is not None and self.descent.blind

    @property
    def _reckons(self) -> bool:
        """Whether only the attitude of the poses is used: position and velocity are the model's."""
        return self.is_blind and not self.health.is_position_usable

    @property
    def speed_aside_m_s(self) -> float:
        """Horizontal speed at the newest pose [m/s]; in a blind descent the model's."""
        motion = self.estimator.motion
        return 0.0 if motion is None else math.hypot(*motion.velocity[:2])

    def add_pose(self, pose: Pose) -> bool:
        """Take one pose; return whether the noise of the poses and their mean interval are measured
        anew.

        A pose that is not newer than the last, or that the gate rejects, is ignored.
        """
        self.check_response()
        received, health = self.received, self.health
        if pose.time_s <= self.newest_s:
            return False
        ahead = self.estimator.look_ahead(pose.time_s)
        if not self._accepts(pose, ahead):
            return False
        reckons = self._reckons
        if self.is_blind and not health.is_attitude_usable:
            return False
        before, last = self.estimator.motion, received.newest
        if reckons:
            self.estimator.update_attitude(pose, ahead)
        else:
            self.estimator.update(pose, ahead)
        if before is not None and last is not None and self.is_released:
            self._prepare_check(pose, before, pose.time_s - last.time_s)
            if not (self._follows_poses and health.is_calm):
                self.check_response()
        if self.is_blind and health.is_position_usable:
            self._end_blind_descent(pose, reckons=reckons)
        return received.add(pose)

    def _accepts(self, pose: Pose, ahead: Ahead | None) -> bool:
        """Whether ``pose`` is accepted: by the gate, or unchecked near the floor and where only
        attitude is used.

        The floor stops a vehicle as the gate does not expect.
        """
        now, is_low = self.estimator.motion, self._floor - pose.position_ned[2] < NEAR_FLOOR_M
        is_unchecked = not self._has_climbed or self._reckons or (is_low and not self._gate.is_shut)
        if now is None or ahead is None or is_unchecked:
            self._gate.restart()
            return True
        return self._gate.accepts(pose, now, ahead.motion, self.estimator.find_noise(now.velocity))

    def _end_blind_descent(self, pose: Pose, *, reckons: bool) -> None:
        """Descend by the poses again: they came back, or they respond again, if it ``reckons``."""
        assert self.descent is not None, "a descent is blind"
        if reckons:
            self._reset_position(pose)
        else:
            self.health.suspect(pose.time_s)  # they may be of another body now
        self.descent.blind = False

    def _reset_position(self, pose: Pose) -> None:
        """Take the position of ``pose`` and the velocity of the last poses, which respond again."""
        motion, first = self.estimator.motion, self.received.recent[0]
        assert motion is not None, "a descent on the model has a motion"
        h = pose.time_s - first.time_s
        u, v, w = ((p - q) / h for p, q in zip(pose.position_ned, first.position_ned, strict=True))
        measured = msgspec.structs.replace(motion, position=pose.position_ned, velocity=(u, v, w))
        before = self.trusted_before()
        self.estimator.reset_motion(measured)
        # If they fail once more, the model goes on from here: it does not know the forces since the
        # first failure.
        self.reckoning.begin(
            Trusted(pose.time_s, measured, before.disturbance, before.effectiveness)
        )

    def replace_attitude(self, last: Pose, time_s: float, attitude: Quat) -> None:
        """Take the pose ``last`` for one of ``time_s`` [s] with another ``attitude``."""
        self.received.newest = pose = msgspec.structs.replace(
            last, time_s=time_s, attitude=attitude
        )
        self.estimator.update_attitude(pose)

    def descend(self, before: Trusted, sink_m_s: float, *, blind: bool, at_s: float) -> None:
        """Begin a failsafe descent, or change it.

        Args:
            before: newest estimate from well before the poses were suspect.
            sink_m_s: commanded sink rate [m/s].
            blind: whether position and velocity are the model's.
            at_s: instant of the newest command [s], from whose motion it begins.
        """
        if self.descent is None or (blind and not self.descent.blind):
            self.estimator.freeze_effectiveness()
            disturbance = self.mean_disturbance.value or before.disturbance
            if blind:
                # A force that the poses have shown since is not believed, even if nothing
                # contradicts them: a hand that covers the markers has pushed before.
                disturbance = before.disturbance
                motion = self.estimator.motion or before.motion
                if not self.health.is_position_usable:
                    motion = self.reckoning.reckon(before, self.newest_s)
                self.estimator.believe(motion, disturbance, before.effectiveness)
            present_m_s = self.estimator.predict(max(at_s, self.newest_s)).motion.velocity[2]
            self.descent = Descent(
                self._vehicle,
                self._gravity,
                disturbance,
                before.effectiveness,
                sink_m_s,
                present_m_s,
            )
        self.descent.sink_m_s, self.descent.blind = sink_m_s, blind

    def release(self) -> None:
        """Begin to fly, in the air: the disturbance before was the force of what held the
        vehicle.
        """
        self.estimator.release()
        self.is_released = self._has_climbed = True
        self.trust_from_here((0.0, 0.0, 0.0))
        self.health.restart()

    def pause_response(self, paused: bool) -> None:
        """Pause the comparison of poses with commands, or resume it."""
        self.is_paused = paused

    def set_uplink_lost(self, is_lost: bool) -> None:
        """Hold disturbance and thrust scale while commands may not arrive."""
        self.check_response()
        self.is_uplink_lost = is_lost
        if not is_lost:
            self.estimator.resume()
            return
        trusted = self.trusted_before()
        self.estimator.hold(trusted.disturbance, trusted.effectiveness)
        self.health.restart()

    def suspect_new_disturbance(self, time_s: float, estimate: Estimate) -> None:
        """Suspect the poses where the disturbance is new: it is true, or motion that false poses do
        not measure.

        Near the floor it is the floor's force.
        """
        is_high = self._floor - estimate.motion.position[2] > NEAR_FLOOR_M
        known = self.mean_disturbance.value if is_high else None
        if known is not None and math.dist(estimate.disturbance, known) > SUSPECT_M_S2:
            self.health.suspect(time_s)

    def trust_from_here(self, disturbance: Vec3) -> None:
        """Begin the dead reckoning at the present estimate."""
        motion = self.estimator.motion
        assert motion is not None, "a flight has poses"
        self.reckoning.begin(
            Trusted(self.newest_s, motion, disturbance, self.estimator.effectiveness)
        )

    def _prepare_check(self, pose: Pose, before: Motion, dt: float) -> None:
        """Prepare the comparison of one believed pose with the commands until it."""
        estimator = self.estimator
        response, motion = estimator.actuator_response, estimator.motion
        if response is None or motion is None:
            return
        height = self._floor - pose.position_ned[2]
        reference_m = self._floor - self._reference_down_m
        is_high = height > NEAR_FLOOR_M or (
            self.descent is None and reference_m > 2.0 * NEAR_FLOOR_M
        )
        self._has_climbed = self._has_climbed or is_high
        moved, tilted = self.tones.advance(pose.time_s, heading(pose.attitude))
        evaluate = partial(
            self.health.add_pose,
            pose, before, response, moved, tilted, estimator.disturbance, estimator.effectiveness,
            estimator.noise_m, estimator.find_noise(before.velocity),
            counts=(is_high or not self._has_climbed) and not self.is_paused,
            may_stop=height > NEAR_FLOOR_M, is_blind=self.is_blind,
        )  # fmt: skip
        has_turned = is_high and self.descent is None
        now = Trusted(pose.time_s, motion, ZERO, estimator.effectiveness)
        self._due = partial(self._check, evaluate, now, pose.attitude if has_turned else None, dt)

    def check_response(self) -> None:
        """Compare the newest pose with the commands, unless that is done."""
        due, self._due = self._due, None
        if due is not None:
            due()

    def _check(
        self, evaluate: Callable[[], None], now: Trusted, turned: Quat | None, dt: float
    ) -> None:
        """Compare one believed pose with the commands, and trust the state ``now`` if it is above
        suspicion.

        Args:
            evaluate: evaluates the health of the poses with it.
            now: state at the pose, without the mean disturbance.
            turned: its attitude, where that tells the latency of the turns.
            dt: time since the pose before [s].
        """
        health, was_suspect = self.health, self.health.is_suspect
        evaluate()
        if was_suspect and health.state is HealthState.OK:
            if health.is_confirmed:
                self.mean_disturbance.confirm()
            if not self.is_uplink_lost:
                self.estimator.resume()
        if turned is not None:
            self.response.add_pose(turned, health.turn, dt)
        if health.calm_s == now.time_s and not self.is_uplink_lost:
            mean = self.mean_disturbance.value or ZERO
            self.reckoning.trust(msgspec.structs.replace(now, disturbance=mean))

    def trusted_before(self) -> Trusted:
        """Newest estimate from well before the poses were suspect."""
        return self.reckoning.find_trusted(self.health.believed_until_s)

    def add_command(
        self, time_s: float, drive: ActuatorCommand, reference: Reference | None = None
    ) -> None:
        """Take a command that is sent at ``time_s`` [s]; ``reference`` is what the law follows."""
        if reference is not None:
            self._reference_down_m = reference.position_ned[2]
        arrival_s = time_s + self._vehicle.command_delay_s
        self.estimator.add_command(arrival_s, drive)
        self.reckoning.add_command(arrival_s, drive)


class _ReceivedPoses:
    """Newest believed poses, and their intervals."""

    def __init__(self) -> None:
        self.newest: Pose | None = None
        """Newest pose, or None."""
        self.recent: deque[Pose] = deque(maxlen=RECENT_POSES)
        """Newest poses."""
        self.apart_s = self.mean_s = 0.0
        """Mean interval of the last second, and of the last ``NOISE_POSES`` [s]."""
        self._count, self._counted_s = 0, 0.0

    def add(self, pose: Pose) -> bool:
        """Take one pose; return whether ``mean_s`` is new."""
        last, self.newest = self.newest, pose
        self.recent.append(pose)
        self._count += 1
        if last is None:
            self._counted_s = pose.time_s
            return False
        apart = pose.time_s - last.time_s
        self.apart_s += apart / (apart + SPARSE_MEAN_S) * (apart - self.apart_s)
        if self._count % NOISE_POSES != 1:
            return False
        self.mean_s = (pose.time_s - self._counted_s) / NOISE_POSES
        self._counted_s = pose.time_s
        return True
