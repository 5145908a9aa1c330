"""Flight controller: one flight from a pose to a command, and on to the next phase of the mission.

Sans-IO.

A pose goes to the estimator and to its health (:class:`groundstation.core.pilot.Pilot`). At a frame
the mission answers what has failed; then the phase gives the reference, and controller and limits
make the command. After the command has left, the guards judge it, and the mission may move on: the
next phase is what comes back. The caller owns time and wires.
"""

import math
from typing import Protocol

from groundstation.core.health import Failure, HealthState, PoseHealth, PoseLatency, Witness
from groundstation.core.messages import NoticeKind, Others, Pose, Sentence, Tick, Waypoint, notice
from groundstation.core.mission import FINAL, IN_AIR, TABLE, Event, Mission, State
from groundstation.core.pilot import Monitors, Pilot
from groundstation.core.safety import (
    LATE_PERIODS,
    OFF_REFERENCE_M,
    Escalation,
    GuardAction,
    GuardFinding,
    Guards,
    Spool,
    SpoolUp,
    StandingPoses,
    limit_n,
)
from groundstation.core.trajectory import Reference
from groundstation.flight.controller.course import Course, Leg
from groundstation.flight.controller.descent_means import DescentMeans, Means
from groundstation.flight.controller.phases import (
    DescentPhase,
    FlightPhase,
    GoToPhase,
    HoldPhase,
    LandPhase,
    MissionMove,
    TrackPhase,
    TransitPhase,
)
from groundstation.flight.controller.uplink import CommandUplink
from groundstation.settings import Config
from links.core import Attitude, Command, CommandLink
from links.text import to_ms

LAST_CHANCE_S = 0.004
"""If no frame comes earlier, one more command leaves this long before the deadline of the last one
[s], so that the descent on the model begins in time."""
LAST_CHANCE_ROUNDING_S = 1e-3
"""A frame so much earlier counts as that last one [s]: timers are late by this much at most.
Chosen."""
LANDING_MARGIN_S = 10.0
"""Time allowed for a landing in addition to the way down [s]."""
LANDING_FACTOR = 2.0
"""Factor on the time of that way at the slowest speed of a landing [-]."""
DESCENT_M_S = 0.5
"""Sink rate of the failsafe descent [m/s]: ArduPilot's own landing (LAND_SPEED); 4 s from a height
of 2 m."""
DISARMED_HEIGHT_M = 0.2
"""An autopilot that disarms below this height during a descent has detected the landing; one that
will not is stopped by force only below it, as it then falls no farther [m]."""


class FlightListener(Protocol):
    """Callbacks of a flight controller."""

    def say(self, sentence: Sentence, kind: NoticeKind = "news") -> None:
        """Report ``sentence`` to the operator."""

    def on_tick(self, tick: Tick) -> None:
        """Take a command of the law that has left."""

    def on_state(self, state: State, reason: Sentence) -> None:
        """Take the state that begins, and its reason."""

    def on_failure(self) -> None:
        """End all other use of the poses, as they are wrong; called at each frame from then on."""


class FlightController:
    """Controller of one flight: mission, phases, and the pilot that flies them.

    Times are on the loop's clock [s].
    """

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        pilot: Pilot,
        listener: FlightListener,
        others: Others | None,
        monitors: Monitors,
    ) -> None:
        """Take the parts.

        Args:
            config: the flight's.
            link: the command link; only read.
            pilot: flies the references.
            listener: hears of what happens.
            others: vehicles to keep away from.
            monitors: makes the guards.
        """
        self._config = config
        self._pilot = pilot
        self._link = link
        self._means = DescentMeans(pilot, link)
        self._uplink = CommandUplink(link)
        self._listener = listener
        self.mission = Mission()
        """State, and its reason."""
        self.standing = StandingPoses()
        """Poses before take-off."""
        self.witness = Witness()
        """Comparison of the poses with the autopilot's attitude."""
        self._pose_latency = PoseLatency()
        self.tick: Tick | None = None
        """Newest command of the law that has left; none on the floor."""
        self._made: Tick | None = None
        self.fault: Sentence | None = None
        """Cause of an early landing that nobody requested; None without one."""
        self.failure: Failure | None = None
        """Failure of the poses or of the uplink that ends the flight; None without one."""
        self.started_s: float | None = None
        """Start of the trajectory [s]; None before it is known."""
        self._warned = ""
        self._health = HealthState.OK
        self._course = Course(config, others)
        self.phase: SpoolUp | FlightPhase | DescentPhase | None = None
        """Phase that is flown, or was flown last; None before the flight."""
        # Only simulations start in the air; guards and health would end them for the error that
        # they start with.
        self._guards = self._make_guards(monitors) if config.flight.start == "floor" else None
        self._escalation = Escalation(config.guards.lasting_s)

    def _make_guards(self, monitors: Monitors) -> Guards:
        config, link, clearance = self._config, self._link, self._course.clearance
        return monitors.guards(
            config.guards, clearance.fence, config.vehicle, lambda: link.period_s,
            clearance.separation,
            config.flight.floor_z_m, config.controller.gravity, config.flight.coast_s,
        )  # fmt: skip

    @property
    def _usable_s(self) -> float:
        """Age of the newest pose up to which another frame still has a command by it [s]."""
        return self._config.flight.coast_s - LAST_CHANCE_S - LAST_CHANCE_ROUNDING_S

    @property
    def state(self) -> State:
        """State of the flight."""
        return self.mission.state

    @property
    def is_dismissed(self) -> bool:
        """Whether commands have ended other than by a landing."""
        return self.state in FINAL and self.state is not State.LANDED

    @property
    def is_low(self) -> bool:
        """Whether the autopilot may have detected a landing: by the last estimate, the vehicle is
        near the floor.
        """
        floor = self._config.flight.floor_z_m
        return (
            self.tick is not None
            and floor - self.tick.estimate.motion.position[2] < DISARMED_HEIGHT_M
        )

    @property
    def is_at_floor(self) -> bool:
        """Whether the newest pose shows the vehicle near the floor."""
        pose = self._pilot.state.newest_pose
        return (
            pose is not None
            and self._config.flight.floor_z_m - pose.position_ned[2] < DISARMED_HEIGHT_M
        )

    def on_pose(self, pose: Pose) -> None:
        """Take a pose: estimate the state, and the health of the poses."""
        self._pilot.estimate_state(pose)
        if isinstance(self.phase, SpoolUp):
            self.phase.add_pose(pose)
            self._course.home = self.phase.place_ned
        elif self.tick is None:
            self.standing.add(pose)
        self.witness.add_pose(pose)
        if self.tick is None:  # no command waits for it; later it is compared once that has left
            self.witness.pair_up()
        self._pose_latency.add_pose(pose)
        news = (
            None
            if self.is_dismissed
            else self._pilot.state.response.describe_news(self._pose_latency.estimate)
        )
        if news is not None:
            self._listener.say(news.as_warning(), "latency")

    def on_attitude(self, attitude: Attitude, now_s: float) -> None:
        """Take the autopilot's attitude, and compare the poses with it."""
        witness = self.witness
        witness.add_attitude(attitude)
        self._pose_latency.add_attitude(attitude)
        if not self.is_dismissed:
            self._report_disagreement()
        if self.state in IN_AIR:
            self._pilot.set_autopilot_agreement(witness.agrees(now_s))
        in_poses = witness.convert_to_poses(attitude)
        # By radio, a stall of the telemetry does not concern commands.
        if attitude.rates_rad_s is not None:
            self._uplink.take_telemetry(now_s)
        if in_poses is not None:
            self._means.take_attitude(attitude, in_poses, now_s)

    def on_link_status(self, now_s: float) -> None:
        """Examine the status of the link."""
        status = self._link.status
        if status.taken and self.mission.allows(Event.TAKEN_OVER):
            self.go(Event.TAKEN_OVER, notice("fault.taken", mode=status.taken), now_s, fault=True)
        elif self._guards is not None and self.state in IN_AIR:
            self._take_step(self._guards.check_link(status, now_s), now_s)

    def on_frame(self, now_s: float) -> Command:
        """Return the command of this frame."""
        phase, self._made = self.phase, None
        if isinstance(phase, SpoolUp):
            if phase.lift_off is None:
                return self._pilot.idle(now_s, self._spool_thrust_n(phase, now_s))
            self._climb_away(now_s)
        if self._answer_uplink(now_s):
            return self._pilot.last_command(now_s, LATE_PERIODS * self._link.period_s)
        if self._answer_failed_poses(now_s):
            if self._means.chosen is Means.FLOOR:
                return self._pilot.idle(now_s, 0.0)
            return self._pilot.plan_open_loop_descent(now_s, LATE_PERIODS * self._link.period_s)
        self._ensure_pose(now_s)
        self._made = self._pilot.compute_command(now_s)
        return self._made.command

    def on_sent(self, now_s: float) -> None:
        """Take that the command of the frame has left: judge it by the guards, and end its phase if
        it is over.

        The response of the newest pose is checked now, unless it was before.
        """
        self._pilot.state.check_response()
        self.witness.pair_up()
        if self._made is not None:
            self._listener.on_tick(self._made)
            self._judge(self._made)
        if self._means.ends_commands and self.failure is not None:  # it was the last one
            self.go(Event.ABORT, self.failure.reason, now_s, fault=True)

    def _spool_thrust_n(self, spool_up: SpoolUp, now_s: float) -> float:
        """Thrust on the floor [N]; 0 where something is wrong, and the motors go off."""
        pose = self._pilot.state.newest_pose
        assert pose is not None, "a spool-up starts after a pose"
        why = self._uplink.check(now_s) or spool_up.find_fault(
            now_s, pose, self._usable_s, self._course.clearance.fence
        )
        if why is None:
            return spool_up.compute_thrust_n(now_s)
        self.go(Event.LAND, why, now_s, fault=True)
        return 0.0

    def _answer_uplink(self, now_s: float) -> bool:
        """Answer commands that arrive late or not at all; return whether commands end."""
        why = self._uplink.check(now_s)
        self._pilot.set_uplink_lost(self._uplink.is_down)
        if not self._uplink.is_down:
            return False
        if why and self._uplink.is_late:
            self.failure = Failure("link.late", notice("fault.late_commands_end", why=why))
            self._means.end_commands()
            return True
        if why and self.state is not State.DESCENT:
            self.go(Event.DESCEND, why, now_s, fault=True)
        return False

    def _answer_failed_poses(self, now_s: float) -> bool:
        """After a failure of the poses, come down by what still responds.

        Return whether commands end.
        """
        health = self._pilot.state.health
        if self._guards is None:
            return False
        self._pilot.pause_response(self._uplink.is_stalled(now_s))
        self._report_health(health)
        if not health.has_failed:
            return False
        if self.failure is None:
            self.failure = Failure(health.reason_id, notice(health.reason_id))
        reason, means = self.failure.reason, self._means.choose(now_s)
        if means is not Means.POSITION:
            self._listener.on_failure()
        if self._means.ends_commands:
            self.failure = self.failure._replace(reason=self._describe_end(reason, now_s))
        elif means is Means.POSITION:
            if self.state not in (State.LANDING, State.DESCENT):
                self.go(Event.LAND, notice("fault.poses_land", reason=reason), now_s, fault=True)
        elif self.state is not State.DESCENT:
            whose = "their attitude" if means is Means.ATTITUDE else "the autopilot's attitude"
            why = notice("fault.poses_descend", reason=reason, whose=whose)
            self.go(Event.DESCEND, why, now_s, fault=True, blind=True)
        elif not self._pilot.state.is_blind:
            self._descend(now_s, blind=True)
        return self._means.ends_commands

    def _describe_end(self, reason: Sentence, now_s: float) -> Sentence:
        """Describe how the vehicle comes down without commands, after the failure ``reason``."""
        autopilot = self._link.autopilot
        if self._means.chosen is Means.FLOOR:
            return notice("fault.poses_floor", reason=reason)
        if autopilot is not None and autopilot.could_land_by_itself(now_s):
            return notice("fault.poses_autopilot", reason=reason)
        return notice("fault.poses_model", reason=reason)

    def _report_health(self, health: PoseHealth) -> None:
        """Report that the poses are suspect, and that they respond again."""
        before, self._health = self._health, health.state
        if self._health is before or self._health is HealthState.FAILED:
            return
        suspect = self._health is HealthState.SUSPECT
        self._listener.say(
            notice(health.reason_id if suspect else "pose.answers"),
            kind="suspicion" if suspect else "news",
        )

    def _report_disagreement(self) -> None:
        """Report poses that are later than configured, or, while they are used, disagree with the
        own attitude.
        """
        latency, state = self._pose_latency, self.state
        if latency.late_s is not None and (
            news := latency.describe_news(0.5 * (self._link.status.rtt_s or 0.0))
        ):
            self._listener.say(news.as_warning(), "latency")
        if (
            state in IN_AIR
            and state is not State.DESCENT
            and (news := self.witness.describe_news())
        ):
            self._listener.say(news.as_warning())

    def _ensure_pose(self, now_s: float) -> None:
        """If no frame is left before the newest pose is too old for a command, descend on the
        model.
        """
        pose = self._pilot.state.newest_pose
        guarded = self._guards is not None and self._config.guards.level_s > 0.0
        if guarded and pose is not None and now_s - pose.time_s > self._usable_s:
            why = notice("fault.pose_gap", age_ms=to_ms(now_s - pose.time_s))
            self._take_step(GuardFinding(GuardAction.DESCEND, why, blind=True), now_s)

    def _judge(self, tick: Tick) -> None:
        """Apply the guards to a command of the controller, and end its phase if it is over."""
        self.tick = tick
        finding = None if self._guards is None else self._guards.check_command(tick, self.state)
        if finding is None or finding.step is GuardAction.WARN:
            warning = None if finding is None else finding.reason.as_warning()
            if warning is not None and warning.text != self._warned:
                self._listener.say(warning)
            self._warned = "" if warning is None else warning.text
        else:
            self._take_step(finding, tick.time_s)
        phase = self.phase if self.state in IN_AIR else None
        assert not isinstance(phase, SpoolUp), "a spool-up has no tick"
        self._course.believes_height = not self._pilot.state.is_blind
        move = None if phase is None else phase.find_end(tick, uplink_ok=not self._uplink.is_down)
        self._pilot.set_ground_contact(
            isinstance(phase, LandPhase) and self._course.touchdown.may_have_contact
        )
        if move is not None and isinstance(phase, GoToPhase):
            self._go_on(phase, move, tick.time_s)
        elif move is not None:
            self.go(move.event, move.reason, tick.time_s, fault=move.fault)

    def _take_step(self, finding: GuardFinding | None, now_s: float) -> None:
        """Take the step that a guard requests, or the next possible one after it.

        A step that leaves the state as it is changes nothing: a hold while landing, a descent while
        descending.
        """
        answer = None if finding is None else self._escalation.escalate(finding, now_s)
        if answer is None:
            return
        for step, event in (
            (GuardAction.HOLD, Event.HOLD),
            (GuardAction.LAND, Event.LAND),
            (GuardAction.DESCEND, Event.DESCEND),
        ):
            if step >= answer.step and self.mission.allows(event):
                if TABLE[self.state, event] is not self.state:
                    self.go(event, answer.reason, now_s, fault=True, blind=answer.blind)
                elif step is answer.step:
                    self.go(event, answer.reason, now_s, fault=True)
                    self._listener.say(answer.reason.as_warning())
                return

    def go(
        self,
        event: Event,
        reason: Sentence,
        now_s: float,
        *,
        fault: bool = False,
        blind: bool = False,
        phase: FlightPhase | None = None,
    ) -> None:
        """Move by ``event``, and begin the phase of the new state.

        Args:
            event: event of the mission.
            reason: its reason, for the operator.
            now_s: instant of the move.
            fault: it ends the flight early.
            blind: a descent must not use the estimated speed.
            phase: phase of the new state, where it is planned already.

        Raises:
            IllegalMove: it is not possible now.
        """
        if fault:
            self.fault = self.fault or reason
        before = self.state
        state = self.mission.on(event, reason)
        if state is before:
            if event is Event.HOLD and isinstance(self.phase, HoldPhase):
                self.phase.wait_for_request()
            return
        self._listener.on_state(state, reason)
        if state not in IN_AIR:
            return
        spool_up = self.phase if isinstance(self.phase, SpoolUp) else None
        if spool_up is not None and spool_up.lift_off is None:  # still on the floor
            self.go(Event.TOUCHDOWN, notice("mission.still_on_floor"), now_s)
        elif state is State.DESCENT:
            if spool_up is not None:  # a pose has shown the lift-off, and no frame has come since
                self._climb_away(now_s)
            self.phase = DescentPhase(self._course, now_s + self._way_down_s())
            extra_coast_s = 0.0 if self._guards is None else self._config.guards.level_s
            self._descend(now_s, blind=blind, extra_coast_s=extra_coast_s)
        elif event is Event.ARMED:
            self._spool_up(now_s)
        else:
            if event is Event.TRACK:
                self._escalation.reset()
            self._begin(phase or self._plan_phase(event, state, now_s))

    def fly_to(self, points: tuple[Waypoint, ...], why: str, now_s: float) -> Sentence | None:
        """Begin to fly to ``points``; return the obstacle, or None.

        Points are checked now, each leg before it.
        """
        for number, point in enumerate(points, 1):
            if refusal := self._course.clearance.find_obstacle(point.place_ned):
                place = list(point.place_ned)
                return notice(
                    "goto.point", number=number, count=len(points), place=place, why=refusal
                )
        phase = GoToPhase(self._course, *self._motion(now_s), points)
        if refusal := self._course.clearance.find_leg_obstacle(phase.leg, now_s):
            return notice("goto.way", target=phase.target, why=refusal)
        self.go(
            Event.GOTO, notice("mission.goto", target=phase.target, why=why), now_s, phase=phase
        )
        return None

    def _go_on(self, reached: GoToPhase, arrived: MissionMove, now_s: float) -> None:
        """At a point: on to the next one if its leg is free, else hold here."""
        following = reached.begin_next(*self._motion(now_s))
        if following is None:
            self.go(arrived.event, arrived.reason, now_s)
        elif refusal := self._course.clearance.find_leg_obstacle(following.leg, now_s):
            self.go(
                Event.HOLD,
                notice("mission.not_to_point", target=following.target, why=refusal),
                now_s,
            )
        else:
            self._listener.say(notice("mission.to_point", target=following.target), "course")
            self._begin(following)

    def _plan_phase(self, event: Event, state: State, now_s: float) -> FlightPhase:
        """Plan the phase of ``state`` from the present motion."""
        course, config = self._course, self._config
        if state is State.TRACKING:
            back = Event.LAND if course.home is None else Event.RETURN
            leg = (
                Leg(course.trajectory, now_s)
                if event is Event.AIRBORNE
                else course.track(*self._motion(now_s))
            )
            return TrackPhase(leg, config.flight.duration_s, back)
        now, time_s = self._motion(now_s)
        if state is State.LANDING:
            return LandPhase(course, course.land(now, time_s), now_s + self._way_down_s())
        if state is State.RETURNING:
            return TransitPhase(
                course.go_home(now, time_s), MissionMove(Event.HOME, notice("mission.home"))
            )
        return HoldPhase(
            config, course, course.hold(now, time_s), waits=event in (Event.HOLD, Event.ARRIVED)
        )

    def _way_down_s(self) -> float:
        """Return the longest plausible duration of the way down from here [s]."""
        pose, flight = self._pilot.state.newest_pose, self._config.flight
        height_m = 0.0 if pose is None else max(flight.floor_z_m - pose.position_ned[2], 0.0)
        slowest_m_s = min(flight.descent_m_s, self._config.landing.touchdown_m_s)
        return LANDING_MARGIN_S + LANDING_FACTOR * height_m / slowest_m_s

    def _spool_up(self, now_s: float) -> None:
        """The motors turn: raise the thrust until the vehicle leaves the floor."""
        config, vehicle = self._config, self._config.vehicle
        weight, takeoff = config.weight_n, config.takeoff
        most, idle = limit_n(takeoff, vehicle, weight), config.flight.idle_thrust * weight
        spool = Spool(weight, most, takeoff.spool_s, idle, now_s, vehicle.thrust_lag_s)
        gravity, noise_m = config.controller.gravity, self._pilot.state.noise_m
        self.phase = SpoolUp(self.standing, spool, vehicle, weight, gravity, noise_m)

    def _climb_away(self, now_s: float) -> None:
        """Climb off the floor; from now on it flies by poses."""
        self._listener.say(notice("mission.off_floor"))
        arrival = MissionMove(Event.CLIMBED, notice("mission.at_height"))
        self._begin(TransitPhase(self._course.climb(*self._motion(now_s)), arrival))

    def _motion(self, now_s: float) -> tuple[Reference, float]:
        """Return the motion that the next leg begins with, and its time [s].

        It is the reference of now. A landing off its reference begins at the vehicle's own motion:
        a vehicle that is held below its reference would shoot up when released.
        """
        climb = self.phase.lift_off if isinstance(self.phase, SpoolUp) else None
        if climb is not None:  # it has just left the floor
            motion = self._pilot.lift_off(now_s, climb.hover_share, climb.climb_m_s)
            return motion, now_s + self._config.vehicle.acting_delay_s
        assert self.tick is not None, "a flying vehicle has a tick"
        reference, here = self.tick.reference, self.tick.estimate.motion
        if (
            self.state is State.LANDING
            and math.dist(reference.position_ned, here.position) > OFF_REFERENCE_M
        ):
            reference = Reference(here.position, here.velocity, yaw_rad=reference.yaw_rad)
        return reference, self.tick.estimate.time_s

    def _begin(self, phase: FlightPhase) -> None:
        """Fly ``phase`` from now on."""
        self.phase = phase
        self._pilot.use_profile(phase.profile)
        self._pilot.follow(phase.leg.trajectory, phase.leg.start_s)
        if isinstance(phase, TrackPhase):
            self.started_s = phase.leg.start_s

    def _descend(self, now_s: float, *, blind: bool, extra_coast_s: float = 0.0) -> None:
        longest_s = self._pilot.descend(DESCENT_M_S, blind=blind, extra_coast_s=extra_coast_s)
        self._means.end_blind_descent_at(now_s + longest_s)
