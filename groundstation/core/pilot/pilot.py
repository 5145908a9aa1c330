"""Pilot: poses in, commands out. Estimator, controller and reference of one vehicle. Sans-IO.

Instants are on the event loop's clock [s]. Commands are computed for the instant at which they act,
``Vehicle.acting_delay_s`` after they leave.
"""

import math
from collections.abc import Callable

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
    FlightLimits,
    FlightProfile,
    GainSchedule,
    GainSet,
    LimitInput,
    blind_descent_limit_s,
    calm_gains,
    clamp_command,
    make_controller,
    plan_bring_down,
    plan_model_descent,
)
from groundstation.core.geometry import ZERO, Quat, Vec3, heading
from groundstation.core.health import PoseHealth
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
from groundstation.core.pilot.vehicle_state import VehicleState
from groundstation.core.trajectory import Reference, Trajectory
from groundstation.core.vehicle import ActuatorCommand, Vehicle
from links.core import Command, Segment

EXCITATION_DELAY_S = 0.25
"""Time without tones after the first climb [s]: the law settles first. Chosen."""
SPARSE_S = 0.07
"""Mean interval of poses above which calm gains are used [s]: between poses errors grow without
correction. Chosen; poses that may take off are at most 0.05 s apart."""
GROUND_EFFECT_SHARE = 0.95
"""Thrust that hovers just off the floor, as a share of that far above it [-]: ground effect carries
the rest. Chosen."""
LAST_COMMAND_S = 0.5
"""Duration of the last command where commands are too late [s]: the autopilot is requested to land
meanwhile. Chosen."""


class Pilot:
    """Pipeline of one vehicle from pose to command. The caller owns time, wires and the mission."""

    def __init__(
        self,
        vehicle: Vehicle,
        config: ControllerConfig,
        coast_s: float,
        floor_z_m: float,
        record: Callable[[FlightEvent | Tick], None] = ignore,
        clock: Callable[[], float] = lambda: 0.0,
        health: Callable[[float, float], PoseHealth] = PoseHealth,
        *,
        follows_poses: bool = False,
    ) -> None:
        """Begin before the first pose.

        Args:
            vehicle: the configured vehicle.
            config: the controller's configuration.
            coast_s: longest time for which one pose is used [s].
            floor_z_m: down component of a vehicle at rest on the floor [m, NED].
            record: takes each input and output of the pilot, stamped by ``clock``.
            clock: returns the event loop's time [s].
            health: makes the monitor of the poses from mass [kg] and g [m/s²].
            follows_poses: whether a command leaves at each pose (:class:`VehicleState`).

        Raises:
            ConfigError: a controller of the user's own can't be loaded.
        """
        self._vehicle, self._gravity = vehicle, config.gravity
        self._record, self._clock = record, clock
        self._coast, self._floor = coast_s, floor_z_m
        self._controller = make_controller(config, vehicle)
        # In the provable form the observer estimates the disturbance itself.
        takes_b_hat = config.composite != "provable"
        self._observer_source = (
            self._controller if takes_b_hat and isinstance(self._controller, Adaptive) else None
        )
        """Our law, whose b̂ drives the observer; None where none does."""
        self._certificate = CertificateMonitor(vehicle, config)
        self._gains = GainSchedule(config)
        self._profile = TRACKING
        self._limits = FlightLimits(vehicle, config)
        self.state = VehicleState(vehicle, config, floor_z_m, health, follows_poses=follows_poses)
        """State of the vehicle, and health of its poses."""
        self._is_climbing = self._may_have_contact = False
        self._last_s: float | None = None
        """Instant of the newest command by the law; None before it, and after an idle one."""
        self._followed: tuple[Trajectory, float] | None = None
        """Trajectory that is followed, and the instant of its time 0."""

    @property
    def certificate(self) -> Certificate | None:
        """V and its bound so far, for screens."""
        return self._certificate.reading()

    def estimate_state(self, pose: Pose) -> None:
        """Estimate the state at one pose, and the health of the poses."""
        self._record(PoseRecord(pose))
        if self.state.add_pose(pose):
            self._certificate.set_noise(self.state.noise_m, self.state.received.mean_s)

    def take_autopilot_attitude(self, time_s: float, attitude: Quat) -> None:
        """Use the autopilot's own ``attitude`` at ``time_s``, converted to the axes of the poses,
        once the attitude of the poses has failed; before that, ignore it.
        """
        state, last = self.state, self.state.newest_pose
        if (
            last is None
            or time_s <= last.time_s
            or not state.is_blind
            or state.health.is_attitude_usable
        ):
            return
        self._switch("autopilot_attitude", time_s, *attitude)
        state.replace_attitude(last, time_s, attitude)

    def follow(self, trajectory: Trajectory, start_s: float) -> None:
        """Make ``trajectory`` the reference; its time 0 is at ``start_s``.

        Without a :meth:`lift_off` before, the vehicle is in the air, and is released now.
        """
        self._record(TrajectoryRecord(start_s))
        if not self.state.is_released:
            self.state.release()
        self._followed = trajectory, start_s
        self._certificate.restart()

    def set_gain(self, name: str, value: float) -> None:
        """Set one gain of our own controller to ``value``; the caller changes it in small steps."""
        self._switch(f"{GAIN}{name}", value)
        if self._gains.set_gain(name, value):
            self._apply_gains()

    def use_profile(self, profile: FlightProfile) -> None:
        """Fly by ``profile`` from now on."""
        # The recording has is_holding twice: for the gains, and for the tones.
        is_holding, is_transit = float(profile is not TRACKING), float(profile is TRANSIT)
        self._switch("ease", is_holding, is_holding, is_transit)
        self._profile = profile
        self._is_climbing = self._is_climbing and profile is TRANSIT
        self.state.estimator.set_landing(profile is TRANSIT and not self._is_climbing)

    def _switch(self, what: str, *values: float) -> None:
        """Record a request by its name in recordings, ``what``, with ``values``
        (:class:`SwitchRecord`).
        """
        self._record(SwitchRecord(self._clock(), what, values))

    def _apply_gains(self) -> None:
        """Hand the present gains to our controller and its certificate."""
        gains = self._gains.gains
        assert isinstance(self._controller, Adaptive) and gains is not None, "it has these gains"
        self._controller.set_gains(gains)
        self._certificate.set_gains(gains)

    def set_ground_contact(self, may_have_contact: bool) -> None:
        """Keep the vehicle level while ground contact is possible."""
        if may_have_contact != self._may_have_contact:
            self._switch("touch", float(may_have_contact))
            self._may_have_contact = may_have_contact

    def set_uplink_lost(self, is_lost: bool) -> None:
        """Freeze adaptation and limit commands while the uplink is lost."""
        if is_lost == self.state.is_uplink_lost:
            return
        self._switch("listen", float(is_lost))
        self.state.set_uplink_lost(is_lost)

    def set_autopilot_agreement(self, agrees: bool | None) -> None:
        """Set whether the autopilot's own attitude agrees with the poses.

        None if that is not known.
        """
        if agrees != self.state.health.autopilot_agrees:
            self._switch("agreement", -1.0 if agrees is None else float(agrees))
            self.state.health.set_autopilot_agreement(agrees)

    def pause_response(self, paused: bool) -> None:
        """Pause the comparison of poses with commands while the link stalls: lost commands have no
        effect.
        """
        if paused != self.state.is_paused:
            self._switch("pause", float(paused))
            self.state.pause_response(paused)

    def set_on_floor(self) -> None:
        """Freeze the estimate of the thrust scale: the floor carries the vehicle."""
        self._switch("stand")
        self.state.estimator.freeze_effectiveness()

    def lift_off(self, time_s: float, hover_share: float, climb_m_s: float) -> Reference:
        """Begin to fly: the vehicle has left the floor. Return its motion at the instant at which a
        command that leaves now acts.

        Args:
            time_s: present instant.
            hover_share: estimated hover thrust as a share of the weight [-].
            climb_m_s: climb speed [m/s].
        """
        self._switch("lift", time_s, hover_share, climb_m_s)
        state = self.state
        # A vehicle below its weight may be light, or in stronger ground effect. Limits allow for
        # the latter; the model, by which it comes down without poses, would let a light one rise.
        most = max(hover_share, GROUND_EFFECT_SHARE)
        hovers = min(hover_share / GROUND_EFFECT_SHARE, most)
        disturbance = state.estimator.lift_off(climb_m_s, hovers)
        if isinstance(self._controller, Adaptive):
            self._controller.begin(disturbance)
        state.is_released = self._is_climbing = True
        # A vehicle that leans against a horizontal disturbance needs more thrust to hover.
        north, east, _ = disturbance
        hover_n = most * self._vehicle.mass_kg * math.hypot(self._gravity, north, east)
        state.trust_from_here(disturbance)
        state.health.lift_off(most, climb_m_s)
        motion = state.estimator.predict(time_s + self._vehicle.acting_delay_s).motion
        self._limits.first_climb.lift_off(time_s, hover_n, motion.position[2])
        return Reference(motion.position, motion.velocity, yaw_rad=heading(motion.attitude))

    def descend(self, sink_m_s: float, *, blind: bool = False, extra_coast_s: float = 0.0) -> float:
        """Begin a failsafe descent, or change it.

        Args:
            sink_m_s: commanded sink rate [m/s].
            blind: whether position and velocity are the model's.
            extra_coast_s: time by which one pose may be used longer from now on [s]; only the first
                call counts.

        Returns:
            Longest duration of the descent, if it is blind [s]. The height for it is the larger one
            of two: the present one by the model, and the last one before the poses were suspect.
        """
        self._switch("descend", sink_m_s, float(blind), extra_coast_s)
        state = self.state
        before = state.trusted_before()
        if state.descent is None:
            self._coast += extra_coast_s
        state.descend(before, sink_m_s, blind=blind, at_s=self._last_s or 0.0)
        self._certificate.restart()
        motion = state.estimator.motion or before.motion
        height_m = self._floor - min(motion.position[2], before.motion.position[2])
        return blind_descent_limit_s(height_m, -motion.velocity[2], self._gravity)

    def idle(self, time_s: float, thrust_n: float) -> Command:
        """Return a command of ``thrust_n`` [N] and zero rates on the floor, stamped with the newest
        pose; its bring-down switches the motors off.
        """
        drive = ActuatorCommand(thrust_n, (0.0, 0.0, 0.0))
        self.state.add_command(time_s, drive)
        self._last_s = None
        command = self._command(drive, OFF if thrust_n > 0.0 else ())
        self._record(IdleRecord(time_s, thrust_n, command))
        return command

    def compute_command(self, time_s: float) -> Tick:
        """Compute the command for a frame that leaves at ``time_s``.

        Needs a pose and a trajectory.
        """
        state = self.state
        pose, descent, followed = state.newest_pose, state.descent, self._followed
        assert pose is not None and followed is not None, "a command needs pose and trajectory"
        trajectory, start_s = followed
        acting_s = time_s + self._vehicle.acting_delay_s
        estimate = state.estimator.predict(acting_s)
        flight_time = acting_s - start_s
        reference = trajectory.at(flight_time)
        if self._gains.use(self._choose_gains()):
            self._apply_gains()
        if descent is not None:
            reference = Reference(estimate.motion.position, (0.0, 0.0, descent.sink_m_s))
        toneless = state.tones.take_out(estimate, heading(estimate.motion.attitude))
        # An interval of 0 freezes adaptation: the effect of the last commands is not known.
        interval = 0.0 if self._last_s is None or state.is_uplink_lost else time_s - self._last_s
        self._last_s = time_s
        decide = self._decide if descent is None else descent.decide
        decision = decide(toneless, reference, interval)
        now = LimitInput(
            time_s,
            self._limits.first_climb.lifted_s,
            pose.position_ned[2],
            estimate,
            state.mean_disturbance.value or ZERO,
            is_uplink_lost=state.is_uplink_lost,
            may_have_contact=self._may_have_contact,
        )
        limits = self._profile.limits if descent is None else DESCENT_LIMITS
        drive = self._limits.apply(limits, decision.drive, now)
        if descent is None and self._limits.first_climb.has_lifted_off:
            state.suspect_new_disturbance(time_s, estimate)
        decision = decision._replace(drive=self._excite(time_s, drive))
        state.add_command(time_s, decision.drive, reference)
        if self._observer_source is not None:
            state.estimator.drive(self._observer_source.b_hat)
        mean = state.mean_disturbance.add(estimate, interval, is_suspect=state.health.is_suspect)
        if descent is not None and descent.blind:
            mean = descent.mean_disturbance  # from before the poses failed
        parts = self._bring_down(estimate, decision.drive, pose.time_s + self._coast - time_s, mean)
        certificate = self._certificate.evaluate(time_s, toneless.motion, decision)
        command = self._command(decision.drive, parts)
        tick = Tick(time_s, flight_time, pose, estimate, reference, decision, command, certificate)
        self._record(tick)
        return tick

    def _choose_gains(self) -> GainSet | None:
        """Return the present gain set: that of the profile, unless the poses are far apart or
        suspect.
        """
        if self.state.received.apart_s > SPARSE_S:
            return calm_gains
        return self._profile.suspect_gains if self.state.are_poses_doubted else self._profile.gains

    def _decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """Return the command of the law for the instant of ``estimate``, at which the later one of
        thrust and rates acts.
        """
        law, sooner_s = self._controller, self._vehicle.sooner_s
        if sooner_s == 0.0 or not isinstance(law, Adaptive):
            return law.decide(estimate, reference, interval_s)
        sooner = self.state.estimator.predict(estimate.time_s - sooner_s)
        sooner = self.state.tones.take_out(sooner, heading(sooner.motion.attitude))
        return law.decide_apart(sooner, estimate, reference, interval_s)

    def _excite(self, time_s: float, drive: ActuatorCommand) -> ActuatorCommand:
        """Return ``drive`` with excitation tones, where they are needed and the law leaves room for
        them: not before the first climb is over, and so never in a flight that began in the air.
        """
        settled = self._limits.first_climb.find_climbed_s(time_s) > EXCITATION_DELAY_S
        is_excited = self.state.descent is not None or self._profile.is_excited
        level = (
            SUSPECT_LEVEL
            if self.state.health.is_suspect or self.state.is_blind
            else float(is_excited)
        )
        tones = self.state.tones
        is_possible = settled and not self.state.is_uplink_lost and tones.has_room(drive)
        tones.set_level(time_s, level if is_possible else 0.0)
        thrust, rates = tones.add_to(drive, time_s)
        if drive.thrust >= self._vehicle.thrust_max_n:
            thrust = drive.thrust  # the tone would only take from it
        return clamp_command(self._vehicle, thrust, rates)[0]

    def last_command(self, time_s: float, hold_s: float) -> Command:
        """Return the last command where commands are too late: zero rates, slightly less than hover
        thrust.

        It is sent at ``time_s`` and valid for ``hold_s`` [s], so that it reaches the link's next
        frame. The same thrust is held in place of a bring-down, which would come late, too, and
        brake a vehicle that does not fall.
        """
        self._switch("let_go", hold_s)
        pose = self.state.newest_pose
        assert pose is not None, "a flight has poses"
        estimate = self.state.estimator.predict(time_s + self._vehicle.acting_delay_s)
        thrust = UPLINK_LOST_SHARE * self._limits.uplink.find_hover_n(estimate)
        still = (0.0, 0.0, 0.0)
        parts = (Segment(LAST_COMMAND_S, thrust, still),)
        command = Command(thrust, still, pose.id, pose.time_s, time_s + hold_s, parts)
        self._record(IdleRecord(time_s, thrust, command))
        return command

    def plan_open_loop_descent(self, time_s: float, hold_s: float) -> Command:
        """Return the last command where neither poses nor autopilot are usable: open loop down on
        the model.

        Times are as in :meth:`last_command`; the descent is its bring-down.
        """
        self._switch("surrender", hold_s)
        pose, vehicle, before = self.state.newest_pose, self._vehicle, self.state.trusted_before()
        assert pose is not None, "a flight has poses"
        motion = self.state.reckoning.reckon(before, time_s + vehicle.acting_delay_s)
        first, *rest = plan_model_descent(
            motion, vehicle, mass_kg=vehicle.mass_kg / before.effectiveness, gravity=self._gravity,
            disturbance=before.disturbance, height_m=self._floor - motion.position[2],
        )  # fmt: skip
        command = Command(
            first.thrust_n, first.rates_rad_s, pose.id, pose.time_s, time_s + hold_s, tuple(rest)
        )
        self._record(IdleRecord(time_s, command.thrust_n, command))
        return command

    def _command(self, drive: ActuatorCommand, parts: tuple[Segment, ...]) -> Command:
        """Return ``drive`` with the deadline of the newest pose, and its bring-down ``parts``."""
        pose = self.state.newest_pose
        assert pose is not None, "a command needs a pose"
        return Command(
            drive.thrust, drive.rates, pose.id, pose.time_s, pose.time_s + self._coast, parts
        )

    def _bring_down(
        self, now: Estimate, drive: ActuatorCommand, held_s: float, disturbance: Vec3
    ) -> tuple[Segment, ...]:
        """Return the bring-down after ``drive``, which is held from ``now`` for ``held_s`` [s] if
        no other follows.
        """
        if held_s <= 0.0:
            return ()
        vehicle, motion = self._vehicle, now.motion
        mass = vehicle.mass_kg / now.effectiveness
        motion = self.state.reckoning.propagate(motion, drive, held_s, mass, disturbance)
        return plan_bring_down(
            motion,
            vehicle,
            mass_kg=mass,
            gravity=self._gravity,
            disturbance=disturbance,
            height_m=self._floor - motion.position[2],
        )
