"""Poses in, commands out: the estimator, the controller and the reference of one vehicle. Sans-IO."""

import math
from collections import deque
from collections.abc import Callable

import msgspec

from groundstation.core.control import (
    DESCENT_LIMITS,
    OFF,
    SUSPECT_LEVEL,
    TRACKING,
    TRANSIT,
    UPLINK_LOST_SHARE,
    Adaptive,
    CertificateMonitor,
    ControllerConfig,
    Descent,
    ExcitationTones,
    FlightLimits,
    FlightProfile,
    GainSchedule,
    GainSet,
    LimitInput,
    calm_gains,
    clamp_command,
    make_controller,
    plan_bring_down,
    plan_model_descent,
)
from groundstation.core.estimation import Ahead, ModelEstimator, Reckoning, Trusted
from groundstation.core.geometry import ZERO, Quat, Vec3, heading, interpolate
from groundstation.core.messages import (
    GAIN,
    Certificate,
    Decision,
    Estimate,
    FlightEvent,
    IdleRecord,
    Pose,
    PoseRecord,
    SwitchRecord,
    Tick,
    TrajectoryRecord,
    ignore,
)
from groundstation.core.safety import (
    SUSPECT_M_S2,
    HealthState,
    PoseGate,
    PoseHealth,
    ResponseLatency,
)
from groundstation.core.trajectory import Reference, Trajectory
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle
from links.core import Command, Segment

WIND_MEMORY_S = 3.0
"""Time constant of the mean disturbance that descents lean into [s]: longer than a gust, and than false poses are
believed."""
EXCITATION_DELAY_S = 0.25
"""Time without tones after the first climb [s]: the law settles first."""
SPARSE_S = 0.07
"""Mean interval of poses above which calm gains are used [s]: between poses errors grow without correction."""
SPARSE_MEAN_S = 1.0
"""Time constant of that mean [s]."""
GROUND_EFFECT_SHARE = 0.95
"""Below this share of the weight, ground effect carries the vehicle [-]."""
LAST_COMMAND_S = 0.5
"""Duration of the last command where commands are too late [s]: the autopilot is requested to land meanwhile."""
NEAR_FLOOR_M = 0.12
"""Height below which the floor may hold the vehicle, so that its poses need not respond [m]."""
RECENT_POSES = 6
"""Poses from which a velocity is taken where they respond again [-]: .1 s at 50 Hz."""
NOISE_POSES = 50
"""Number of poses after which the certificate takes their noise and interval again [-]."""


class _MeanDisturbance:
    """Mean disturbance since the beginning, later of the last ``WIND_MEMORY_S``, for the present λ̂."""

    def __init__(self, gravity: float) -> None:
        self.value: Vec3 | None = None
        """[m/s², NED]; None before the first command."""
        self._over_s, self._effectiveness, self._gravity = 0.0, 1.0, gravity
        self._suspect: Vec3 | None = None
        """Mean since the poses became suspect; None while they are not."""
        self._suspect_s = 0.0

    def add(self, estimate: Estimate, interval_s: float, *, is_suspect: bool = False) -> Vec3:
        """Take the estimate of one command, ``interval_s`` [s] after the one before; return the mean.

        ``is_suspect``: whether the poses are suspect.
        """
        now, scale = estimate.disturbance, estimate.effectiveness
        if self.value is not None:  # only the sum of disturbance and thrust error is observable: that sum is kept
            north, east, down = self.value
            self.value = (north, east, down + (scale - self._effectiveness) * self._gravity)
        self._effectiveness = scale
        if self.value is None:
            self.value = now
        elif interval_s > 0.0:
            self._over_s = min(self._over_s + interval_s, WIND_MEMORY_S)
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
        """Take the mean since the poses became suspect: they have responded, so that disturbance is true."""
        self.value = self._suspect or self.value


class Pilot:
    """Pipeline of one vehicle from pose to command. The caller owns time, wires and the mission."""

    def __init__(
        self,
        vehicle: Vehicle,
        config: ControllerConfig,
        coast_s: float,
        floor_z_m: float,
        tell: Callable[[FlightEvent | Tick], None] = ignore,
        clock: Callable[[], float] = lambda: 0.0,
        health: Callable[[float, float], PoseHealth] = PoseHealth,
    ) -> None:
        """Take the configured vehicle, the controller's config, and the longest use of one pose ``coast_s`` [s].

        ``floor_z_m`` is the position of a vehicle at rest on the floor [m, NED]. ``tell`` is called with each input and
        output of the pilot, stamped by the event loop's ``clock`` [s]. ``health`` makes the monitor of the poses from
        mass and g.

        Raises:
            ConfigError: a controller of the user's own can't be loaded.
        """
        self._vehicle, self._gravity = vehicle, config.gravity
        self._tell, self._clock = tell, clock
        self._coast, self._floor = coast_s, floor_z_m
        self._estimator = ModelEstimator(vehicle, config)
        self._controller = make_controller(config, vehicle)
        # An observer that does not estimate the disturbance by itself is driven by b̂.
        driven = config.composite != "provable"
        self._driver = self._controller if driven and isinstance(self._controller, Adaptive) else None
        self._watch = CertificateMonitor(vehicle, config)
        self._gains = GainSchedule(config)
        self._profile = TRACKING
        self._limits = FlightLimits(vehicle, config)
        self._gate = PoseGate()
        self._tones = ExcitationTones(vehicle, config.gravity)
        self._reference_down = math.inf
        self.health = health(vehicle.mass_kg, config.gravity)
        """Health of the poses."""
        self.response = ResponseLatency()
        """Latency of the vehicle's turns beyond the configured one."""
        self._is_released = self._has_climbed = self._is_paused = self._is_climbing = False
        self._wind = _MeanDisturbance(config.gravity)
        self._reckoning = Reckoning(vehicle, config.gravity)
        self._received = _ReceivedPoses()
        self._last_s: float | None = None
        self._leg: tuple[Trajectory, float] | None = None
        self._descent: Descent | None = None

    @property
    def newest_pose(self) -> Pose | None:
        """The newest believed pose, or None."""
        return self._received.newest

    @property
    def certificate(self) -> Certificate | None:
        """V and its bound so far, for screens."""
        return self._watch.reading()

    @property
    def noise_m(self) -> float:
        """Measured position noise of the poses, 1σ per axis [m]."""
        return self._estimator.noise_m

    @property
    def is_suspicious(self) -> bool:
        """Whether the poses are suspected, or have failed."""
        return self.health.state is not HealthState.OK

    @property
    def is_blind(self) -> bool:
        """Whether a failsafe descent takes position and velocity from the model."""
        return self._descent is not None and self._descent.blind

    @property
    def _reckons(self) -> bool:
        """Whether only the attitude of the poses is used: position and velocity are the model's."""
        return self.is_blind and not self.health.is_position_usable

    @property
    def speed_aside_m_s(self) -> float:
        """Horizontal speed at the newest pose [m/s]; in a blind descent the model's."""
        motion = self._estimator.motion
        return 0.0 if motion is None else math.hypot(*motion.velocity[:2])

    def estimate_state(self, pose: Pose) -> None:
        """Estimate the state at one pose, and the health of the poses.

        A pose that is not newer than the last, or that the gate rejects, is ignored.
        """
        self._tell(PoseRecord(pose))
        received = self._received
        if received.newest is not None and pose.time_s <= received.newest.time_s:
            return
        ahead = self._estimator.look_ahead(pose.time_s)
        if not self._accepts(pose, ahead):
            return
        health, reckons = self.health, self._reckons
        if self.is_blind and not health.is_attitude_usable:
            return
        before, last = self._estimator.motion, received.newest
        if reckons:
            self._estimator.update_attitude(pose, ahead)
        else:
            self._estimator.update(pose, ahead)
        if before is not None and last is not None and self._is_released:
            self._check_response(pose, before, pose.time_s - last.time_s)
        if reckons and health.is_position_usable:
            self._reset_position(pose)
        if received.add(pose):
            self._watch.noise(self._estimator.noise_m, received.mean_s)

    def _accepts(self, pose: Pose, ahead: Ahead | None) -> bool:
        """Whether ``pose`` is accepted: by the gate, or unchecked near the floor and where only attitude is used.

        The floor stops a vehicle as the gate does not expect.
        """
        now, is_low = self._estimator.motion, self._floor - pose.position_ned[2] < NEAR_FLOOR_M
        is_unchecked = not self._has_climbed or self._reckons or (is_low and not self._gate.is_shut)
        if now is None or ahead is None or is_unchecked:
            self._gate.restart()
            return True
        return self._gate.accepts(pose, now, ahead.motion, self.noise_m)

    def _reset_position(self, pose: Pose) -> None:
        """Take the position of ``pose`` and the velocity of the last poses, which respond again."""
        motion, first = self._estimator.motion, self._received.recent[0]
        assert motion is not None and self._descent is not None, "a descent on the model has both"
        h = pose.time_s - first.time_s
        u, v, w = ((p - q) / h for p, q in zip(pose.position_ned, first.position_ned, strict=True))
        measured, before = motion._replace(position=pose.position_ned, velocity=(u, v, w)), self._trusted_before()
        self._estimator.reset_motion(measured)
        # If they fail once more, the model goes on from here: it does not know the forces since the first failure.
        self._reckoning.begin(Trusted(pose.time_s, measured, before.disturbance, before.effectiveness))
        self._descent.blind = False

    def take_autopilot_attitude(self, time_s: float, attitude: Quat) -> None:
        """Use the autopilot's own ``attitude`` of ``time_s``, in the axes of the poses, after theirs has failed."""
        last = self._received.newest
        if last is None or time_s <= last.time_s or not self.is_blind or self.health.is_attitude_usable:
            return
        self._switch("autopilot_attitude", time_s, *attitude)
        self._received.newest = pose = msgspec.structs.replace(last, time_s=time_s, attitude=attitude)
        self._estimator.update_attitude(pose)

    def follow(self, trajectory: Trajectory, start_s: float) -> None:
        """Make ``trajectory``, begun at ``start_s`` on the event loop's clock [s], the reference."""
        self._tell(TrajectoryRecord(start_s))
        if not self._is_released:
            self._estimator.release()
            self._is_released = self._has_climbed = True
            self._trust_from_here((0.0, 0.0, 0.0))
            self.health.restart()
        self._leg = trajectory, start_s
        self._watch.restart()

    def set_gain(self, name: str, value: float) -> None:
        """Set one gain of our own controller to ``value``; the caller changes it in small steps."""
        self._switch(f"{GAIN}{name}", value)
        if self._gains.set_gain(name, value):
            self._apply_gains()

    def use_profile(self, profile: FlightProfile) -> None:
        """Fly by ``profile`` from now on."""
        is_holding, is_transit = float(profile is not TRACKING), float(profile is TRANSIT)
        self._switch("ease", is_holding, is_holding, is_transit)
        self._profile = profile
        self._is_climbing = self._is_climbing and profile is TRANSIT
        self._estimator.lands = profile is TRANSIT and not self._is_climbing

    def _switch(self, what: str, *values: float) -> None:
        """Record a request ``what`` with ``values`` (:class:`SwitchRecord`)."""
        self._tell(SwitchRecord(self._clock(), what, values))

    def _apply_gains(self) -> None:
        gains = self._gains.gains
        assert isinstance(self._controller, Adaptive) and gains is not None, "it has these gains"
        self._controller.regain(gains)
        self._watch.regain(gains)

    def set_ground_contact(self, may_have_contact: bool) -> None:
        """Keep the vehicle level while ground contact is possible."""
        if may_have_contact != self._limits.level.may_have_contact:
            self._switch("touch", float(may_have_contact))
            self._limits.level.may_have_contact = may_have_contact

    def set_uplink_lost(self, is_lost: bool) -> None:
        """Freeze adaptation and limit commands while the uplink is lost."""
        if is_lost == self._limits.uplink.is_lost:
            return
        self._switch("listen", float(is_lost))
        self._limits.uplink.is_lost = is_lost
        if is_lost:
            trusted = self._trusted_before()
            self._estimator.hold(trusted.disturbance, trusted.effectiveness)
            self.health.restart()
        else:
            self._estimator.resume()

    def set_autopilot_agreement(self, agrees: bool | None) -> None:
        """Set whether the autopilot's own attitude agrees with the poses; None if that is not known."""
        if agrees != self.health.autopilot_agrees:
            self._switch("agreement", -1.0 if agrees is None else float(agrees))
            self.health.autopilot_agrees = agrees

    def pause_response(self, paused: bool) -> None:
        """Pause the comparison of poses with commands while the link stalls: lost commands have no effect."""
        if paused != self._is_paused:
            self._switch("pause", float(paused))
            self._is_paused = paused

    def set_on_floor(self) -> None:
        """Freeze the estimate of the thrust scale: the floor carries the vehicle."""
        self._switch("stand")
        self._estimator.frozen = True

    def lift_off(self, time_s: float, hover_share: float, climb_m_s: float) -> Reference:
        """Begin to fly: the vehicle has left the floor. Return its motion at the instant at which a command acts.

        ``hover_share`` is the estimated hover thrust as a share of the weight [-], ``climb_m_s`` the climb speed [m/s].
        """
        self._switch("lift", time_s, hover_share, climb_m_s)
        hovers = max(hover_share, GROUND_EFFECT_SHARE)
        disturbance = self._estimator.lift_off(climb_m_s, hovers)
        if isinstance(self._controller, Adaptive):
            self._controller.begin(disturbance)
        self._is_released = self._is_climbing = True
        north, east, _ = disturbance  # the vehicle leans against it, and so needs more thrust to hover
        hover_n = hovers * self._vehicle.mass_kg * math.hypot(self._gravity, north, east)
        self._trust_from_here(disturbance)
        self.health.lift_off(hovers, climb_m_s)
        motion = self._estimator.predict(time_s + self._vehicle.acting_delay_s).motion
        self._limits.first_climb.lift_off(time_s, hover_n, motion.position[2])
        return Reference(motion.position, motion.velocity, yaw_rad=heading(motion.attitude))

    def descend(self, sink_m_s: float, *, blind: bool = False, rest_s: float = 0.0) -> float:
        """Begin a failsafe descent, or change it; ``blind``: take position and velocity from the model.

        ``rest_s`` is the additional time for which one pose may be used [s]. Return the largest height above the floor
        that the vehicle may have, by the model or before the poses were suspect [m].
        """
        self._switch("descend", sink_m_s, float(blind), rest_s)
        if self._descent is None:
            self._coast += rest_s
        if self._descent is None or (blind and not self._descent.blind):
            self._estimator.frozen = True  # no thrust scale from poses that may be false
            before, wind = self._trusted_before(), self._wind.value
            if blind and not self.health.is_position_usable:
                motion, wind = self._reckoning.reckon(before, self._newest_s), before.disturbance
                self._estimator.believe(motion, wind, before.effectiveness)
            wind = wind or before.disturbance
            sinks = self._estimator.predict(max(self._last_s or 0.0, self._newest_s)).motion.velocity[2]
            self._descent = Descent(self._vehicle, self._gravity, wind, before.effectiveness, sink_m_s, sinks)
        self._descent.sink_m_s = sink_m_s
        self._descent.blind = blind
        self._watch.restart()
        motion = self._estimator.motion or self._trusted_before().motion
        return self._floor - min(motion.position[2], self._trusted_before().motion.position[2])

    def idle(self, time_s: float, thrust_n: float) -> Command:
        """Return a command of ``thrust_n`` [N] and zero rates, stamped with the newest pose."""
        drive = ActuatorCommand(thrust_n, (0.0, 0.0, 0.0))
        self._send(time_s, drive)
        self._last_s = None
        command = self._command(drive, OFF if thrust_n > 0.0 else ())
        self._tell(IdleRecord(time_s, thrust_n, command))
        return command

    def compute_command(self, time_s: float) -> Tick:
        """Compute the command for a frame that leaves at ``time_s``. Needs a pose and a trajectory."""
        pose, descent = self._received.newest, self._descent
        assert pose is not None and self._leg is not None, "a command needs a pose and a trajectory"
        trajectory, start_s = self._leg
        acting = time_s + self._vehicle.acting_delay_s
        estimate = self._estimator.predict(acting)
        flight_time = acting - start_s
        reference = trajectory.at(flight_time)
        if self._gains.use(self._choose_gains()):
            self._apply_gains()
        if descent is not None:
            reference = Reference(estimate.motion.position, (0.0, 0.0, descent.sink_m_s))
        without = self._tones.take_out(estimate, heading(estimate.motion.attitude))
        interval = 0.0 if self._last_s is None or self._limits.uplink.is_lost else time_s - self._last_s
        self._last_s = time_s
        decide = self._decide if descent is None else descent.decide
        decision = decide(without, reference, interval)
        pose_down_m, wind = pose.position_ned[2], self._wind.value or ZERO
        now = LimitInput(time_s, self._limits.first_climb.lifted_s, pose_down_m, estimate, wind)
        limits = self._profile.limits if descent is None else DESCENT_LIMITS
        drive = self._limits.apply(limits, decision.drive, now)
        if descent is None:
            self._suspect_new_wind(time_s, estimate)
        decision = decision._replace(drive=self._excite(time_s, drive))
        self._reference_down = reference.position_ned[2]
        self._send(time_s, decision.drive)
        if self._driver is not None:
            self._estimator.drive(self._driver.b_hat)
        wind = self._wind.add(estimate, interval, is_suspect=self.health.is_suspect)
        if descent is not None and descent.blind:
            wind = descent.wind
        parts = self._bring_down(estimate, decision.drive, pose.time_s + self._coast - time_s, wind)
        certificate = self._watch.look(time_s, without.motion, decision)
        command = self._command(decision.drive, parts)
        tick = Tick(time_s, flight_time, pose, estimate, reference, decision, command, certificate)
        self._tell(tick)
        return tick

    def _choose_gains(self) -> GainSet | None:
        """Gain set of now: that of the profile, unless the poses are far apart or suspect."""
        if self._received.apart_s > SPARSE_S:
            return calm_gains
        return self._profile.suspect_gains if self.is_suspicious else self._profile.gains

    def _decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """Return the command of the law."""
        law, sooner_s = self._controller, self._vehicle.sooner_s
        if sooner_s == 0.0 or not isinstance(law, Adaptive):
            return law.decide(estimate, reference, interval_s)
        sooner = self._estimator.predict(estimate.time_s - sooner_s)
        sooner = self._tones.take_out(sooner, heading(sooner.motion.attitude))
        return law.decide_apart(sooner, estimate, reference, interval_s)

    def _suspect_new_wind(self, time_s: float, estimate: Estimate) -> None:
        """Suspect the poses where the disturbance is new: it is wind, or motion that false poses do not measure.

        Near the floor it is the floor's force.
        """
        height_m = self._floor - estimate.motion.position[2]
        known = self._wind.value if self._limits.first_climb.lifted_s > -math.inf and height_m > NEAR_FLOOR_M else None
        if known is not None and math.dist(estimate.disturbance, known) > SUSPECT_M_S2:
            self.health.suspect(time_s)

    def _excite(self, time_s: float, drive: ActuatorCommand) -> ActuatorCommand:
        """Return ``drive`` with excitation tones, where they are needed."""
        settled = self._limits.first_climb.has_climbed_for(time_s) > EXCITATION_DELAY_S
        is_calm = self._descent is not None or self._profile.is_excited
        level = SUSPECT_LEVEL if self.health.is_suspect or self.is_blind else float(is_calm)
        self._tones.set_level(time_s, level if settled and not self._limits.uplink.is_lost else 0.0)
        thrust, rates = self._tones.add_to(drive, time_s)
        if drive.thrust >= self._vehicle.thrust_max_n:
            thrust = drive.thrust  # the tone would only take from it
        return clamp_command(self._vehicle, thrust, rates)[0]

    def last_command(self, time_s: float, hold_s: float) -> Command:
        """Return the last command where commands are too late: zero rates, slightly less than hover thrust.

        Times are as in :meth:`surrender`. A late bring-down would brake a vehicle that does not fall.
        """
        self._switch("let_go", hold_s)
        pose = self._received.newest
        assert pose is not None, "a flight has poses"
        estimate = self._estimator.predict(time_s + self._vehicle.acting_delay_s)
        thrust = UPLINK_LOST_SHARE * self._limits.uplink.find_hover_n(estimate)
        still = (0.0, 0.0, 0.0)
        parts = (Segment(LAST_COMMAND_S, thrust, still),)
        command = Command(thrust, still, pose.id, pose.time_s, time_s + hold_s, parts)
        self._tell(IdleRecord(time_s, thrust, command))
        return command

    def surrender(self, time_s: float, hold_s: float) -> Command:
        """Return the last command where neither poses nor autopilot are usable: open loop down on the model.

        It is sent at ``time_s`` and valid for ``hold_s`` [s], so that it reaches the link's next frame; the descent is
        its bring-down.
        """
        self._switch("surrender", hold_s)
        pose, vehicle, before = self._received.newest, self._vehicle, self._trusted_before()
        assert pose is not None, "a flight has poses"
        motion = self._reckoning.reckon(before, time_s + vehicle.acting_delay_s)
        first, *rest = plan_model_descent(
            motion, vehicle, mass_kg=vehicle.mass_kg / before.effectiveness, gravity=self._gravity,
            disturbance=before.disturbance, height_m=self._floor - motion.position[2],
        )  # fmt: skip
        command = Command(first.thrust_n, first.rates_rad_s, pose.id, pose.time_s, time_s + hold_s, tuple(rest))
        self._tell(IdleRecord(time_s, command.thrust_n, command))
        return command

    def _trust_from_here(self, disturbance: Vec3) -> None:
        """Begin the dead reckoning at the present estimate."""
        motion = self._estimator.motion
        assert motion is not None, "a flight has poses"
        self._reckoning.begin(Trusted(self._newest_s, motion, disturbance, self._estimator.effectiveness))

    def _check_response(self, pose: Pose, before: Motion, dt: float) -> None:
        """Compare one believed pose with the commands."""
        estimator, health = self._estimator, self.health
        response, motion = estimator.actuator_response, estimator.motion
        if response is None or motion is None:
            return
        height, reference_m = self._floor - pose.position_ned[2], self._floor - self._reference_down
        is_high = height > NEAR_FLOOR_M or (self._descent is None and reference_m > 2.0 * NEAR_FLOOR_M)
        self._has_climbed = self._has_climbed or is_high
        moved, tilted = self._tones.advance(pose.time_s, heading(pose.attitude))
        was_suspect = health.is_suspect
        health.add_pose(
            pose, before, response, moved, tilted, estimator.disturbance, estimator.effectiveness, estimator.noise_m,
            counts=(is_high or not self._has_climbed) and not self._is_paused,
            may_stop=height > NEAR_FLOOR_M, is_blind=self.is_blind,
        )  # fmt: skip
        if was_suspect and health.is_confirmed and not health.is_suspect:
            self._wind.confirm()
        if is_high and self._descent is None:
            self.response.add_pose(pose.attitude, health.turn, dt)
        if health.calm_s == pose.time_s and not self._limits.uplink.is_lost:
            wind = self._wind.value or (0.0, 0.0, 0.0)
            self._reckoning.trust(Trusted(pose.time_s, motion, wind, estimator.effectiveness))

    def _trusted_before(self) -> Trusted:
        """Newest estimate from well before the poses were suspect."""
        return self._reckoning.find_trusted(self.health.believed_until_s)

    def _send(self, time_s: float, drive: ActuatorCommand) -> None:
        """Take a command that is sent at ``time_s`` [s]."""
        arrival_s = time_s + self._vehicle.command_delay_s
        self._estimator.add_command(arrival_s, drive)
        self._reckoning.add_command(arrival_s, drive)

    @property
    def _newest_s(self) -> float:
        newest = self._received.newest
        return -math.inf if newest is None else newest.time_s

    def _command(self, drive: ActuatorCommand, parts: tuple[Segment, ...]) -> Command:
        pose = self._received.newest
        assert pose is not None, "a command needs a pose"
        return Command(drive.thrust, drive.rates, pose.id, pose.time_s, pose.time_s + self._coast, parts)

    def _bring_down(
        self, now: Estimate, drive: ActuatorCommand, held_s: float, disturbance: Vec3
    ) -> tuple[Segment, ...]:
        """Return the bring-down after ``drive``, which is held from ``now`` for ``held_s`` [s] if no other follows."""
        if held_s <= 0.0:
            return ()
        vehicle, motion = self._vehicle, now.motion
        mass = vehicle.mass_kg / now.effectiveness
        motion = self._reckoning.roll(motion, drive, held_s, mass, disturbance)
        return plan_bring_down(
            motion,
            vehicle,
            mass_kg=mass,
            gravity=self._gravity,
            disturbance=disturbance,
            height_m=self._floor - motion.position[2],
        )


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
