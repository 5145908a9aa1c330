"""Mission executive: gives each state of the mission its reference, and ends it. Sans-IO.

The caller owns time and wires.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import msgspec

from groundstation.core.control import HOLDING, TRACKING, TRANSIT
from groundstation.core.geometry import Quat, Vec3, third_column
from groundstation.core.messages import Others, Pose, Sentence, Tick, Waypoint, notice
from groundstation.core.mission import FINAL, IN_AIR, TABLE, Event, Mission, State
from groundstation.core.pilot import Pilot
from groundstation.core.safety import (
    Escalation,
    Failure,
    Fence,
    GuardAction,
    GuardFinding,
    Guards,
    HealthState,
    Hover,
    Monitors,
    PoseHealth,
    Separation,
    Spool,
    SpoolUp,
    StandingPoses,
    Touchdown,
    limit_n,
)
from groundstation.core.trajectory import Blend, Chain, Hold, Limits, Reference, Trajectory, blend, run_in, stop
from groundstation.flight.descent_means import DescentMeans, Means
from groundstation.settings import Config
from links.core import IN_TIME, Attitude, Command, CommandLink

LAST_CHANCE_S = 0.004
"""The next command leaves this long before the deadline of the one before [s]."""
AT_REST_M_S = 0.02
"""A reference slower than this is not braked before the next leg [m/s]."""
FAST_M_S2 = 2.0
"""Deceleration after a lift-off faster than the climb speed, and largest acceleration of a climb
[m/s²]: just off the floor thrust allows no more."""
BLOWN_M_S = 0.1
"""Above this horizontal speed at lift-off, wind has moved the vehicle and it is braked [m/s]."""
HALTS_M_S2 = 3.0
"""Deceleration of that braking [m/s²]."""
HALTS_PER_S = 3.5
"""Deceleration per m/s of an autopilot's own speed estimate, at most [1/s]: 0.3 m/s may be its
wander."""
ASTRAY_M = 0.3
"""Deviation from the reference above which a landing begins at the vehicle's own position [m]: a vehicle that
is held below its reference would shoot up when released."""
SILENT_S = 0.15
"""Shortest silence of a vehicle's telemetry after which it may not receive commands either [s]."""
SILENTS = 2.5
"""Shortest such silence as a multiple of its usual telemetry interval [-]."""
LOST_S = 3.0
"""After this long a silence only the telemetry counts as lost [s]."""
USUAL_S = 0.02
"""Initial value of the usual telemetry interval [s]."""
USUAL = 0.1
"""Weight of each interval in its running mean [-]."""
UNHEARD_S = 0.15
"""Acknowledgements overdue for this long: the uplink is assumed down [s]."""
DEAF_S = 0.5
"""Acknowledgements overdue for this long: the operator is informed, and the vehicle descends [s]."""
LAST_PERIODS = 2.5
"""The last command is valid for this many periods: it must reach the next frame of a pacer."""
LEAST_HEIGHT_M = 0.3
"""Lowest height that goto accepts [m]."""
SEEN_M = 0.005
"""A point this close to the fence is reported as on it [m]."""
LOOKS = 40
"""Number of points at which a leg is checked before it is flown [-]: less than a millisecond."""
LONGER_S = 10.0
"""Time allowed for a landing in addition to the way down [s]."""
LONGER = 2.0
"""Factor on the time of that way at its slowest speed [-]."""
DESCENT_M_S = 0.5
"""Sink rate of the failsafe descent [m/s]: ArduPilot's own landing (LAND_SPEED); 4 s from a height of 2 m."""
DISARMED_HEIGHT_M = 0.2
"""An autopilot that disarms below this height during a descent has detected the landing [m]."""


class Leg(NamedTuple):
    """A reference, and when its time 0 is."""

    trajectory: Trajectory
    start_s: float
    """On the event loop's clock [s]."""


PROFILES = {State.TRACKING: TRACKING, State.HOLD: HOLDING}
"""Flight profile of each state but those in transit."""


class MissionMove(NamedTuple):
    """An event of the mission, and why."""

    event: Event
    reason: Sentence
    fault: bool = False
    """Whether it ends the flight early."""


class Clearance:
    """Obstacles to a point and to the way there: floor, fence, other vehicles, speed limit."""

    def __init__(self, config: Config, others: Others | None) -> None:
        """``others`` are vehicles to keep away from."""
        self._floor_z_m, self._max_speed_m_s = config.flight.floor_z_m, config.limits.max_speed_m_s
        self.fence = None if config.fence is None else Fence(config.fence, config.flight.floor_z_m)
        """Space that is left only to be braked in; None for all of it."""
        self.separation = None if others is None else Separation(config.separation, others)
        """Distances to the other vehicles; None where there are none."""

    def find_obstacle(self, place: Vec3) -> Sentence | None:
        """Describe the obstacle to a stay at ``place``; None where there is none."""
        height = self._floor_z_m - place[2]
        if not (math.isfinite(sum(place)) and height >= LEAST_HEIGHT_M):
            side = "above" if height >= 0.0 else "below"
            return notice("goto.height", height_m=abs(height), side=side, limit_m=LEAST_HEIGHT_M)
        room = math.inf if self.fence is None else self.fence.room_m(place)
        if room > 0.0:
            return None
        return notice("goto.on_fence") if room > -SEEN_M else notice("goto.outside", outside_m=-room)

    def find_way_out(self, leg: Leg, now_s: float) -> Sentence | None:
        """Describe the obstacle on the way of ``leg``, braking included; None without one."""
        separation, max_speed_m_s = self.separation, self._max_speed_m_s
        if separation is not None and separation.config.unknown != "warn" and (lost := separation.unknown(now_s)):
            return notice("goto.unseen", names=", ".join(lost))
        way = leg.trajectory
        begin_s, steps = now_s - leg.start_s, LOOKS
        for n in range(steps + 1):
            at = way.at(begin_s * (1.0 - n / steps))
            if self.fence is not None and not self.fence.braking_room_m(at.position_ned, at.velocity_ned) > 0.0:
                return notice("goto.braking")
            if max_speed_m_s is not None and math.hypot(*at.velocity_ned) > max_speed_m_s:
                return notice("goto.speed", limit_m_s=max_speed_m_s)
            near = None if separation is None else separation.nearest(at.position_ned, at.velocity_ned, now_s)
            if near is not None and near.room_m <= 0.0:
                return notice("goto.near", name=near.name)
        return None


class Course:
    """References of the mission's states: climb, hold, onto and along the trajectory, back, down."""

    def __init__(self, config: Config, others: Others | None = None) -> None:
        """``others`` are vehicles to keep away from."""
        self.clearance = Clearance(config, others)
        """Obstacles to points and legs."""
        self.down_by_s = math.inf
        """Time by which a way down must have reached the floor [s]."""
        self.trajectory = config.trajectory.build()
        """The configured trajectory."""
        self.home: Vec3 | None = None
        """Position of the take-off, NED [m]; None for a flight that starts in the air."""
        self.waits = False
        """Whether a hold lasts until a request ends it."""
        self.touchdown = Touchdown(config.weight_n)
        """Detection of the landing."""
        self._config = config
        takeoff = config.takeoff
        self._transit = Limits(takeoff.transit_m_s, takeoff.transit_m_s2)
        self._climb = Limits(takeoff.climb_m_s, min(takeoff.transit_m_s2, FAST_M_S2))
        self._points: tuple[Waypoint, ...] = ()
        self._reached = 0
        self._weighs = False
        self._hover = Hover()

    def plan(self, points: tuple[Waypoint, ...]) -> None:
        """Set the points of the next goto, to be flown one after the other."""
        self._points, self._reached = points, 0

    @property
    def target(self) -> Sentence:
        """Description of the next point."""
        north, east, down = self._points[self._reached].place_ned
        which = f", {self._reached + 1} of {len(self._points)}" if len(self._points) > 1 else ""
        height = self._config.flight.floor_z_m - down
        return notice("goto.target", north_m=north, east_m=east, height_m=height, which=which)

    def arrive(self) -> bool:
        """Count a reached point; return whether another one follows."""
        self._reached += 1
        return self._reached < len(self._points)

    def leg(self, event: Event, state: State, now: Reference, time_s: float) -> Leg:
        """Return the leg from the motion ``now`` at ``time_s`` [s] into ``state``."""
        match state:
            case State.TAKEOFF:
                climb = self._climb
                if math.hypot(*now.velocity_ned) > climb.speed_m_s:
                    climb = Limits(climb.speed_m_s, FAST_M_S2)
                return self._rise(None, self._halt_aside(now), now, climb, time_s)
            case State.TRACKING:
                return _leg(self.entry(now), self.trajectory, time_s)
            case State.MOVING:
                return self._to_point(now, time_s)
            case State.RETURNING:
                return self._rise(self.home, self._halt(now), now, self._transit, time_s)
            case State.LANDING:
                return self._down(now, time_s)
            case _:
                self.waits, self._hover = event in (Event.HOLD, Event.ARRIVED), Hover()
                self._weighs = not self.waits
                return Leg(stop(now, self._transit), time_s)

    def entry(self, now: Reference) -> list[Blend]:
        """Return the ways from ``now`` onto the beginning of the trajectory, which is met at its own velocity."""
        ways = self._halt(now)
        begin = run_in(self.trajectory.at(0.0), self._transit)
        return [*ways, blend(_end(ways, now), begin.at(0.0), self._transit), begin]

    def over(self, state: State, tick: Tick, *, uplink_ok: bool) -> MissionMove | None:
        """Return the move that ends ``state``; None while it goes on.

        A vehicle without uplink may fly on while a landing commands its thrust: only poses at rest show
        that it has landed.
        """
        if state in (State.LANDING, State.DESCENT):
            touched = self._has_touched_down(state, tick, uplink_ok)
            return MissionMove(Event.TOUCHDOWN, notice("mission.touched_down")) if touched else None
        if not uplink_ok:
            return None
        if state is State.HOLD:
            return self._check_hover(tick)
        if state is State.TRACKING:
            return self._check_duration(tick)
        if tick.flight_time_s < 0.0:
            return None
        if state is State.TAKEOFF:
            return MissionMove(Event.CLIMBED, notice("mission.at_height"))
        if state is State.MOVING:
            return MissionMove(Event.ARRIVED, notice("mission.there", target=self.target))
        return MissionMove(Event.HOME, notice("mission.home")) if state is State.RETURNING else None

    def _has_touched_down(self, state: State, tick: Tick, uplink_ok: bool) -> bool:
        motion = tick.estimate.motion
        down = motion.position[2]
        height, behind = self._config.flight.floor_z_m - down, tick.reference.position_ned[2] - down
        if state is State.DESCENT:
            behind = math.inf
        pose_m, sinks_m_s = self._config.flight.floor_z_m - tick.pose.position_ned[2], tick.reference.velocity_ned[2]
        at_rest = self.touchdown.is_at_rest_by_poses(tick.pose, pose_m, sinks_m_s)
        thrust_n, sinking_m_s = tick.command.thrust_n, motion.velocity[2]
        lift_n = motion.thrust * third_column(motion.attitude)[2]
        landed = self.touchdown.update(tick.time_s, thrust_n, lift_n, sinking_m_s, height, behind, sinks_m_s)
        return at_rest or (landed and uplink_ok)

    def _check_hover(self, tick: Tick) -> MissionMove | None:
        """After the climb: on to the trajectory, or land if the hover thrust does not fit the vehicle."""
        hold_s, weight = self._config.takeoff.hold_s, self._config.weight_n
        if tick.flight_time_s > 0.5 * hold_s:  # the climb has died away
            self._hover.add(tick.command.thrust_n)
        hover = self._hover.thrust_n
        if not self._weighs or tick.flight_time_s < hold_s or hover is None:
            return None
        self.touchdown, self._weighs = Touchdown(hover), False
        low, high = self._config.vehicle.hover_range
        percent = 100.0 * hover / weight
        if low <= hover / weight <= high:
            hovers = notice("mission.hovers", hover_n=hover, percent=percent)
            return None if self.waits else MissionMove(Event.TRACK, hovers)
        why = notice("mission.hover_thrust", hover_n=hover, percent=percent, low=100.0 * low, high=100.0 * high)
        return MissionMove(Event.LAND, why, fault=True)

    def _check_duration(self, tick: Tick) -> MissionMove | None:
        duration = self._config.flight.duration_s
        if duration is None or tick.flight_time_s < duration:
            return None
        back = Event.LAND if self.home is None else Event.RETURN
        return MissionMove(back, notice("mission.flown", duration_s=duration))

    def _halt(self, now: Reference) -> list[Blend]:
        """Brake to rest; empty if ``now`` is at rest."""
        return [stop(now, self._transit)] if math.hypot(*now.velocity_ned) > AT_REST_M_S else []

    def _halt_aside(self, now: Reference) -> list[Blend]:
        """Brake the horizontal motion of a climb that wind has moved; nothing opposed the wind on the floor."""
        north, east, climb = now.velocity_ned
        speed = math.hypot(north, east)
        if speed <= BLOWN_M_S:
            return []
        hardest = min(HALTS_M_S2, HALTS_PER_S * speed) if self._config.pose.by_autopilot else HALTS_M_S2
        halt = stop(msgspec.structs.replace(now, velocity_ned=(north, east, 0.0)), Limits(1.0, hardest))
        north, east, down = halt.at(halt.duration_s).position_ned
        place = (north, east, down + climb * halt.duration_s)
        return [Blend(now, Reference(place, (0.0, 0.0, climb), yaw_rad=now.yaw_rad), halt.duration_s)]

    def _rise(self, place: Vec3 | None, ways: list[Blend], now: Reference, limits: Limits, time_s: float) -> Leg:
        """After ``ways`` from ``now``, go to rest at the take-off height above ``place`` (None: above their end)."""
        north, east, _ = place or _end(ways, now).position_ned
        return self._to_rest((north, east, self._config.flight.floor_z_m - self._config.takeoff.height_m),
                             _end(ways, now).yaw_rad, ways, now, limits, time_s)  # fmt: skip

    def _to_point(self, now: Reference, time_s: float) -> Leg:
        """Go straight to the next point, from rest to rest."""
        ways, point = self._halt(now), self._points[self._reached]
        yaw = _end(ways, now).yaw_rad if point.yaw_deg is None else math.radians(point.yaw_deg)
        return self._to_rest(point.place_ned, yaw, ways, now, self._transit, time_s)

    def _to_rest(
        self, place: Vec3, yaw: float, ways: list[Blend], now: Reference, limits: Limits, time_s: float
    ) -> Leg:
        last = blend(_end(ways, now), Reference(place, yaw_rad=yaw), limits)
        return _leg([*ways, last], Hold(place, yaw), time_s)

    def _down(self, now: Reference, time_s: float) -> Leg:
        """Brake, then sink without a step of the speed; slowly from the approach height on, and through the floor."""
        landing, flight = self._config.landing, self._config.flight
        ways = self._halt(now)
        now = _end(ways, now)
        slow, low = (0.0, 0.0, landing.touchdown_m_s), flight.floor_z_m - landing.approach_m
        north, east, down = now.position_ned
        if down < low - landing.approach_m:
            limits = Limits(flight.descent_m_s, self._transit.acceleration_m_s2)
            last = blend(now, Reference((north, east, low), slow, yaw_rad=now.yaw_rad), limits)
        else:  # near the floor: only accelerate to that speed
            here = run_in(Reference(now.position_ned, slow, yaw_rad=now.yaw_rad), self._transit)
            way = now.position_ned[2] - here.position_at(0.0)[2]
            last = Blend(now, Reference((north, east, down + way), slow, yaw_rad=now.yaw_rad), here.duration_s)
        on = Blend(last.at(last.duration_s), last.at(last.duration_s + 1.0), 1.0)  # continues at that speed
        return _leg([*ways, last], on, time_s)


def _leg(ways: list[Blend], last: Trajectory, time_s: float) -> Leg:
    return Leg(Chain(ways, last), time_s + sum(way.duration_s for way in ways))


def _end(ways: list[Blend], now: Reference) -> Reference:
    """Return the reference at the end of ``ways`` from ``now``."""
    return ways[-1].at(ways[-1].duration_s) if ways else now


class CommandUplink:
    """Whether commands reach the vehicle, and whether its telemetry stalls. Times are on the loop's clock [s]."""

    def __init__(self, link: CommandLink) -> None:
        self._link = link
        self._heard_s, self._usual_s = -math.inf, USUAL_S
        self.is_down = False
        """Whether the vehicle acknowledged nothing for so long that the uplink is assumed down."""
        self.is_late = False
        """Whether commands arrive too late."""

    def update(self, now_s: float) -> Sentence | None:
        """Check once a frame whether acknowledgements are overdue or late.

        Return why commands can't fly the vehicle although its telemetry arrives; None if they reach it in time.
        """
        autopilot = self._link.autopilot
        overdue_s, late_s = IN_TIME if autopilot is None else autopilot.arrival(now_s)
        self.is_down, self.is_late = overdue_s > UNHEARD_S, late_s > 0.0
        if self.is_late:
            return notice("fault.late_commands", late_ms=1e3 * late_s)
        return notice("fault.unanswered", overdue_ms=1e3 * overdue_s) if overdue_s > DEAF_S else None

    def take_telemetry(self, now_s: float) -> None:
        """Take the time of a telemetry message."""
        since_s, self._heard_s = now_s - self._heard_s, now_s
        if since_s < LOST_S:
            self._usual_s += USUAL * (since_s - self._usual_s)

    def is_stalled(self, now_s: float) -> bool:
        """Whether the telemetry is silent for longer than usual, but not lost."""
        return max(SILENT_S, SILENTS * self._usual_s) < now_s - self._heard_s < LOST_S


class MissionExecutive:
    """The mission of one flight, with the pilot that flies it. Times are on the event loop's clock [s]."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        pilot: Pilot,
        say: Callable[..., None],
        on_state: Callable[[State, Sentence], None],
        on_failure: Callable[[], None],
        others: Others | None,
        monitors: Monitors,
    ) -> None:
        """Take the parts.

        Args:
            config: the flight's.
            link: the command link; only read.
            pilot: flies the references.
            say: takes a sentence for the operator, and the kind of its :class:`Notice`.
            on_state: called as a state begins, with the reason.
            on_failure: called when the poses are no longer used, before the last command leaves.
            others: vehicles to keep away from.
            monitors: makes the guards.
        """
        self._config = config
        self._pilot = pilot
        self._link = link
        self._means = DescentMeans(pilot, link)
        self._uplink = CommandUplink(link)
        self._say = say
        self._on_state = on_state
        self._on_failure = on_failure
        self.mission = Mission()
        """State, and its reason."""
        self.standing = StandingPoses()
        """Poses before take-off."""
        self.tick: Tick | None = None
        """The newest command of the controller that left."""
        self.fault: Sentence | None = None
        """Cause of an early landing that nobody requested; None without one."""
        self.failure: Failure | None = None
        """Failure of the poses or of the uplink that ends the flight; None without one."""
        self.started_s: float | None = None
        """Start of the trajectory [s]; None before it is known."""
        self._warned = ""
        self._health = HealthState.OK
        self._course = Course(config, others)
        self._spooling: SpoolUp | None = None
        self._guards: Guards | None = None
        if config.flight.start == "floor":  # a vehicle held in the air starts with an error, and nobody beneath it
            clearance = self._course.clearance
            self._guards = monitors.guards(
                config.guards, clearance.fence, config.vehicle, lambda: link.period_s, clearance.separation,
                config.flight.floor_z_m, config.controller.gravity, config.flight.coast_s,
            )  # fmt: skip
        self._escalation = Escalation(config.guards.lasting_s)

    @property
    def state(self) -> State:
        """State of the flight."""
        return self.mission.state

    @property
    def low(self) -> bool:
        """Whether the autopilot may have detected a landing: by the last estimate, the vehicle is at the floor."""
        floor = self._config.flight.floor_z_m
        return self.tick is not None and floor - self.tick.estimate.motion.position[2] < DISARMED_HEIGHT_M

    @property
    def at_floor(self) -> bool:
        """Whether the newest pose shows the vehicle on the floor, or nearly."""
        pose = self._pilot.newest_pose
        return pose is not None and self._config.flight.floor_z_m - pose.position_ned[2] < DISARMED_HEIGHT_M

    def go(self, event: Event, reason: Sentence, now_s: float, *, fault: bool = False, blind: bool = False) -> None:
        """Move by ``event``, and begin the reference of the new state.

        ``fault``: it ends the flight early. ``blind``: a descent must not use the estimated speed.

        Raises:
            IllegalMove: it is not possible now.
        """
        if fault:
            self.fault = self.fault or reason
        before = self.state
        state = self.mission.on(event, reason)
        if state is before:
            if event is Event.HOLD:  # the hold after a climb no longer ends by itself
                self._course.waits = True
            return
        self._on_state(state, reason)
        self._course.down_by_s = now_s + self._way_down_s() if state in (State.LANDING, State.DESCENT) else math.inf
        if state in FINAL or state not in IN_AIR:
            return
        if self._spooling is not None and self._spooling.lift_off is None:  # still on the floor: nothing to fly
            self.go(Event.TOUCHDOWN, notice("mission.still_on_floor"), now_s)
        elif state is State.DESCENT:
            if self._spooling is not None:  # it has left the floor since the newest pose
                self._climb_away(now_s)
            rest = 0.0 if self._guards is None else self._config.guards.level_s
            self._descend(now_s, blind=blind, rest_s=rest)
        elif event is Event.ARMED:
            self._spool_up(now_s)
        elif event is Event.AIRBORNE:
            self._follow(Leg(self._course.trajectory, now_s))
        else:
            if event is Event.TRACK:
                self._escalation.reset()
            self._follow(self._course.leg(event, state, *self._motion(now_s)))

    def _way_down_s(self) -> float:
        """Return the longest plausible duration of the way down from here [s]."""
        pose, flight = self._pilot.newest_pose, self._config.flight
        height_m = 0.0 if pose is None else max(flight.floor_z_m - pose.position_ned[2], 0.0)
        return LONGER_S + LONGER * height_m / min(flight.descent_m_s, self._config.landing.touchdown_m_s)

    def move(self, points: tuple[Waypoint, ...], why: str, now_s: float) -> Sentence | None:
        """Begin to fly to ``points``; return the obstacle, or None. Points are checked now, each leg before it."""
        for number, point in enumerate(points, 1):
            if refusal := self._course.clearance.find_obstacle(point.place_ned):
                place = list(point.place_ned)
                return notice("goto.point", number=number, count=len(points), place=place, why=refusal)
        self._course.plan(points)
        leg = self._course.leg(Event.GOTO, State.MOVING, *self._motion(now_s))
        if refusal := self._course.clearance.find_way_out(leg, now_s):
            return notice("goto.way", target=self._course.target, why=refusal)
        self.go(Event.GOTO, notice("mission.goto", target=self._course.target, why=why), now_s)
        return None

    def _go_on(self, arrived: MissionMove, now_s: float) -> None:
        """At a point: on to the next one if its leg is free, else hold here."""
        if not self._course.arrive():
            self.go(arrived.event, arrived.reason, now_s)
            return
        leg = self._course.leg(Event.GOTO, State.MOVING, *self._motion(now_s))
        if refusal := self._course.clearance.find_way_out(leg, now_s):
            self.go(Event.HOLD, notice("mission.not_to_point", target=self._course.target, why=refusal), now_s)
            return
        self._say(notice("mission.to_point", target=self._course.target), kind="course")
        self._follow(leg)

    def command(self, now_s: float) -> tuple[Command, Tick | None]:
        """Return the command of this frame, and the tick of the controller; None without one, as on the floor."""
        spooling, pose = self._spooling, self._pilot.newest_pose
        if spooling is not None and spooling.lift_off is not None:
            self._climb_away(now_s)
            spooling = None
        if spooling is None:
            if self._is_too_late(now_s):
                return self._pilot.last_command(now_s, LAST_PERIODS * self._link.period_s), None
            if self._answer_failure(now_s):
                if self._means.chosen is Means.FLOOR:
                    return self._pilot.idle(now_s, 0.0), None
                return self._pilot.surrender(now_s, LAST_PERIODS * self._link.period_s), None
            self._ensure_pose(now_s)
            tick = self._pilot.tick(now_s)
            return tick.command, tick
        assert pose is not None, "poses showed it on the floor"
        coast_s = self._config.flight.coast_s - LAST_CHANCE_S - 1e-3
        why = self._uplink.update(now_s) or spooling.fault(now_s, pose, coast_s, self._course.clearance.fence)
        if why is not None:
            self.go(Event.LAND, why, now_s, fault=True)
            return self._pilot.idle(now_s, 0.0), None
        return self._pilot.idle(now_s, spooling.thrust_n(now_s)), None

    def left(self, now_s: float) -> None:
        """A command has left; if it was the last one, commands end with it."""
        if self._means.ends_commands and self.failure is not None:
            self.go(Event.ABORT, self.failure.reason, now_s, fault=True)

    def _is_too_late(self, now_s: float) -> bool:
        """Whether commands end as they arrive too late; while none arrive, gains are calm and adaptation is frozen."""
        why = self._uplink.update(now_s)
        self._pilot.set_uplink_lost(self._uplink.is_down)
        if not self._uplink.is_down:
            return False
        if why and self._uplink.is_late:
            self.failure = Failure("link.late", notice("fault.late_commands_end", why=why))
            self._means.chosen = Means.NOTHING
            return True
        if why and self.state is not State.DESCENT:
            self.go(Event.DESCEND, why, now_s, fault=True)
        return False

    def _answer_failure(self, now_s: float) -> bool:
        """After a failure of the poses, come down by what still responds; return whether commands end."""
        health = self._pilot.health
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
            self._on_failure()
        if self._means.ends_commands:
            self.failure = self.failure._replace(reason=notice("fault.poses_model", reason=reason))
        elif means is Means.POSITION:
            if self.state not in (State.LANDING, State.DESCENT):
                self.go(Event.LAND, notice("fault.poses_land", reason=reason), now_s, fault=True)
        elif self.state is not State.DESCENT:
            whose = "their attitude" if means is Means.ATTITUDE else "the autopilot's attitude"
            why = notice("fault.poses_descend", reason=reason, whose=whose)
            self.go(Event.DESCEND, why, now_s, fault=True, blind=True)
        elif not self._pilot.is_blind:
            self._descend(now_s, blind=True)
        return self._means.ends_commands

    def _report_health(self, health: PoseHealth) -> None:
        """Report that the response of the poses is tested, and that it is normal again."""
        before, self._health = self._health, health.state
        if self._health is before or self._health is HealthState.FAILED:
            return
        suspect = self._health is HealthState.SUSPECT
        self._say(notice(health.reason_id if suspect else "pose.answers"), kind="suspicion" if suspect else "news")

    def _descend(self, now_s: float, *, blind: bool, rest_s: float = 0.0) -> None:
        height_m = self._pilot.descend(DESCENT_M_S, blind=blind, rest_s=rest_s)
        self._means.limit_blind_descent(now_s, height_m)

    def observe(self, tick: Tick) -> None:
        """Take a command of the controller that has left: apply the guards, and end the state if it is over."""
        self.tick = tick
        finding = None if self._guards is None else self._guards.check_command(tick, self.state)
        if finding is None or finding.step is GuardAction.WARN:
            warning = None if finding is None else finding.reason.as_warning()
            if warning is not None and warning.text != self._warned:
                self._say(warning)
            self._warned = "" if warning is None else warning.text
        else:
            self._answer(finding, tick.time_s)
        move = self._course.over(self.state, tick, uplink_ok=not self._uplink.is_down) or self._find_overtime(tick)
        self._pilot.set_ground_contact(self.state is State.LANDING and self._course.touchdown.may_have_contact)
        if move is not None and move.event is Event.ARRIVED:
            self._go_on(move, tick.time_s)
        elif move is not None:
            self.go(move.event, move.reason, tick.time_s, fault=move.fault)

    def _find_overtime(self, tick: Tick) -> MissionMove | None:
        """End a way down that takes so long that the floor is not where it is configured."""
        if not tick.time_s > self._course.down_by_s:
            return None
        why = notice("fault.no_floor")
        if self.state is State.LANDING:
            return MissionMove(Event.DESCEND, why, fault=True)
        return MissionMove(Event.ABORT, notice("fault.no_floor_end", why=why), fault=True)

    def link(self, now_s: float) -> None:
        """Examine the status of the link."""
        status = self._link.status
        if status.taken and self.mission.allows(Event.TAKEN_OVER):
            self.go(Event.TAKEN_OVER, notice("fault.taken", mode=status.taken), now_s, fault=True)
        elif self._guards is not None and self.state in IN_AIR:
            self._answer(self._guards.check_link(status, now_s), now_s)

    def _ensure_pose(self, now_s: float) -> None:
        """If no frame is left before the newest pose is too old for a command, descend on the model."""
        pose, coast = self._pilot.newest_pose, self._config.flight.coast_s
        guarded = self._guards is not None and self._config.guards.level_s > 0.0
        if guarded and pose is not None and now_s - pose.time_s > coast - LAST_CHANCE_S - 1e-3:
            why = notice("fault.pose_gap", age_ms=(now_s - pose.time_s) * 1e3)
            self._answer(GuardFinding(GuardAction.DESCEND, why, blind=True), now_s)

    def _answer(self, finding: GuardFinding | None, now_s: float) -> None:
        """Take the step that a guard requests, or the next possible one after it."""
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
                    self._say(answer.reason.as_warning())
                return

    def pose(self, pose: Pose) -> None:
        """Take a pose."""
        if self._spooling is not None:
            self._spooling.add_pose(pose)
        elif self.tick is None:
            self.standing.add(pose)

    def attitude(self, attitude: Attitude, in_poses: Quat | None, now_s: float) -> None:
        """Take the autopilot's attitude; ``in_poses`` is the same in the axes of the poses, if known."""
        if attitude.rates_rad_s is not None:  # by radio, a stall of the telemetry does not concern commands
            self._uplink.take_telemetry(now_s)
        if in_poses is not None:
            self._means.take_attitude(attitude, in_poses, now_s)

    def _spool_up(self, now_s: float) -> None:
        """The motors turn: raise the thrust until the vehicle leaves the floor."""
        config, vehicle = self._config, self._config.vehicle
        weight, takeoff = config.weight_n, config.takeoff
        most, idle = limit_n(takeoff, vehicle, weight), config.flight.idle_thrust * weight
        spool = Spool(weight, most, takeoff.spool_s, idle, now_s, vehicle.thrust_lag_s)
        gravity, noise_m = config.controller.gravity, self._pilot.noise_m
        self._spooling = SpoolUp(self.standing, spool, vehicle, weight, gravity, noise_m)
        self._course.home = self._spooling.place_ned

    def _climb_away(self, now_s: float) -> None:
        """Climb off the floor; from now on it flies by poses."""
        self._say(notice("mission.off_floor"))
        self._follow(self._course.leg(Event.ARMED, State.TAKEOFF, *self._motion(now_s)))

    def _motion(self, now_s: float) -> tuple[Reference, float]:
        """Return the motion that the next leg begins with, and its time [s]."""
        spooling, self._spooling = self._spooling, None
        climb = None if spooling is None else spooling.lift_off
        if climb is not None:  # it has just left the floor
            motion = self._pilot.lift_off(now_s, climb.hover_share, climb.climb_m_s)
            return motion, now_s + self._config.vehicle.acting_delay_s
        assert self.tick is not None, "it flies"
        reference, here = self.tick.reference, self.tick.estimate.motion
        if self.state is State.LANDING and math.dist(reference.position_ned, here.position) > ASTRAY_M:
            reference = Reference(here.position, here.velocity, yaw_rad=reference.yaw_rad)
        return reference, self.tick.estimate.time_s

    def _follow(self, leg: Leg) -> None:
        self._pilot.use_profile(PROFILES.get(self.state, TRANSIT))
        self._pilot.follow(leg.trajectory, leg.start_s)
        if self.state is State.TRACKING:
            self.started_s = leg.start_s
