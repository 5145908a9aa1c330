"""Mission executive: moves the mission on: what is flown as a state begins, and what ends it. Sans-IO.

The caller owns time and wires.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import msgspec

from groundstation.core.geometry import Quat, Vec3, third_column
from groundstation.core.messages import Others, Pose, Sentence, Tick, Waypoint, notice
from groundstation.core.mission import FINAL, IN_AIR, TABLE, Event, Mission, State
from groundstation.core.pilot import Pilot
from groundstation.core.safety import (
    MONITORS,
    Escalation,
    Failure,
    Fence,
    GuardAction,
    GuardFinding,
    Guards,
    HealthState,
    Hover,
    Monitors,
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
from links.core import IN_TIME, Arrival, Attitude, Command, LinkStatus

LAST_CHANCE_S = 0.004
"""The next command leaves this long before the deadline of the one before [s]."""
AT_REST_M_S = 0.02
"""Slower than this a reference need not be stopped first [m/s]."""
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
"""A landing begins where the vehicle is, where that is farther from the reference [m]: what holds it below would let it
shoot up to where it should have been."""
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
"""After this long the operator is told, and the commands that may still arrive bring it down
[s]."""
LAST_PERIODS = 2.5
"""The last command holds for so many periods: it must reach the next frame of a pacer, which its own leads."""
LEAST_HEIGHT_M = 0.3
"""A point that is asked for lies at least so high above the floor [m]: whoever wants less lands."""
SEEN_M = 0.005
"""Smaller lengths are not named to the operator [m]."""
LOOKS = 40
"""A leg is looked at in so many places before it is flown: less than a millisecond."""
LONGER_S = 10.0
"""Time allowed for a landing beside the way down at its slowest speed [s]."""
LONGER = 2.0
"""Factor on the time of that way down [-]."""
DESCENT_M_S = 0.5
"""Sink rate of the failsafe descent [m/s]: ArduPilot's own landing (LAND_SPEED); 4 s from a height of 2 m."""
DISARMED_HEIGHT_M = 0.2
"""An autopilot that disarms below this height while we come down has felt the floor [m]."""


class Leg(NamedTuple):
    """A reference, and when its time 0 is."""

    trajectory: Trajectory
    start_s: float
    """On the event loop's clock [s]."""


class MissionMove(NamedTuple):
    """An event of the mission, and why."""

    event: Event
    reason: Sentence
    fault: bool = False
    """Whether this is not how the flight was meant to go."""


class Course:
    """Ways of the mission's states: climb, hold, onto and along the trajectory, back, down."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._trajectory = config.trajectory.build()
        takeoff = config.takeoff
        self._transit = Limits(takeoff.transit_m_s, takeoff.transit_m_s2)
        self._climb = Limits(takeoff.climb_m_s, min(takeoff.transit_m_s2, FAST_M_S2))
        self._home: Vec3 | None = None
        self._points: tuple[Waypoint, ...] = ()
        self._reached = 0
        self._waits = self._weighs = False
        self._hover = Hover()
        self._touchdown = Touchdown(config.weight_n)

    def stood(self, place_ned: Vec3) -> None:
        """Set the place of the take-off, NED [m]."""
        self._home = place_ned

    def plan(self, points: tuple[Waypoint, ...]) -> None:
        """Fly to ``points`` next, one after the other."""
        self._points, self._reached = points, 0

    def wait(self) -> None:
        """Hold until told to go on."""
        self._waits = True

    @property
    def target(self) -> Sentence:
        """Which point it flies to, in words."""
        north, east, down = self._points[self._reached].place_ned
        which = f", {self._reached + 1} of {len(self._points)}" if len(self._points) > 1 else ""
        height = self._config.flight.floor_z_m - down
        return notice("goto.target", north_m=north, east_m=east, height_m=height, which=which)

    def arrive(self) -> bool:
        """Count a reached point; True where another one follows."""
        self._reached += 1
        return self._reached < len(self._points)

    def at_once(self, time_s: float) -> Leg:
        """The trajectory from its beginning, wherever the vehicle is: for one that is let go in the air."""
        return Leg(self._trajectory, time_s)

    def leg(self, event: Event, state: State, now: Reference, time_s: float) -> Leg:
        """Return the way from the motion ``now`` at ``time_s`` [s] into ``state``."""
        match state:
            case State.TAKEOFF:
                climb = self._climb
                if math.hypot(*now.velocity_ned) > climb.speed_m_s:
                    climb = Limits(climb.speed_m_s, FAST_M_S2)
                return self._above(None, now, time_s, climb, self._halt_aside(now))
            case State.TRACKING:
                return _leg(self.entry(now), self._trajectory, time_s)
            case State.MOVING:
                return self._to_point(now, time_s)
            case State.RETURNING:
                return self._above(self._home, now, time_s, self._transit, self._halt(now))
            case State.LANDING:
                return self._down(now, time_s)
            case _:
                self._waits, self._hover = event in (Event.HOLD, Event.ARRIVED), Hover()
                self._weighs = not self._waits
                return Leg(stop(now, self._transit), time_s)

    def entry(self, now: Reference) -> list[Blend]:
        """The ways from ``now`` onto the beginning of the trajectory, which is met in its own motion."""
        ways = self._halt(now)
        begin = run_in(self._trajectory.at(0.0), self._transit)
        at_rest = now if not ways else ways[-1].at(ways[-1].duration_s)
        return [*ways, blend(at_rest, begin.at(0.0), self._transit), begin]

    def over(self, state: State, tick: Tick, *, heard: bool) -> MissionMove | None:
        """Return the move that ends ``state``; None while it goes on, or no command is ``heard``.

        A vehicle that does not hear may fly on while a landing commands its thrust: only poses at
        rest show that it has landed.
        """
        if not heard and state not in (State.LANDING, State.DESCENT):
            return None
        match state:
            case State.TAKEOFF:
                return MissionMove(Event.CLIMBED, notice("mission.at_height")) if tick.flight_time_s >= 0.0 else None
            case State.HOLD:
                return self._check_hover(tick)
            case State.TRACKING:
                return self._check_duration(tick)
            case State.MOVING:
                there = notice("mission.there", target=self.target)
                return MissionMove(Event.ARRIVED, there) if tick.flight_time_s >= 0.0 else None
            case State.RETURNING:
                return MissionMove(Event.HOME, notice("mission.home")) if tick.flight_time_s >= 0.0 else None
            case State.LANDING | State.DESCENT:
                touches = self._touches_down(state, tick, heard)
                return MissionMove(Event.TOUCHDOWN, notice("mission.touched_down")) if touches else None
            case _:
                return None

    @property
    def touches(self) -> bool:
        """Whether the floor may carry it by now."""
        return self._touchdown.touches

    def _touches_down(self, state: State, tick: Tick, heard: bool) -> bool:
        motion = tick.estimate.motion
        down = motion.position[2]
        height, behind = self._config.flight.floor_z_m - down, tick.reference.position_ned[2] - down
        if state is State.DESCENT:
            behind = math.inf
        pose_m, sinks_m_s = self._config.flight.floor_z_m - tick.pose.position_ned[2], tick.reference.velocity_ned[2]
        stands = self._touchdown.stands(tick.pose, pose_m, sinks_m_s)
        thrust_n, sinking_m_s = tick.command.thrust_n, motion.velocity[2]
        lift_n = motion.thrust * third_column(motion.attitude)[2]
        felt = self._touchdown.update(tick.time_s, thrust_n, lift_n, sinking_m_s, height, behind, sinks_m_s)
        return stands or (felt and heard)

    def _check_hover(self, tick: Tick) -> MissionMove | None:
        """After the climb: on to the trajectory, or down again where the hover thrust is not this vehicle's."""
        hold_s, weight = self._config.takeoff.hold_s, self._config.weight_n
        if tick.flight_time_s > 0.5 * hold_s:  # the climb has died away
            self._hover.see(tick.command.thrust_n)
        hover = self._hover.thrust_n
        if not self._weighs or tick.flight_time_s < hold_s or hover is None:
            return None
        self._touchdown, self._weighs = Touchdown(hover), False
        low, high = self._config.vehicle.hover_range
        percent = 100.0 * hover / weight
        if low <= hover / weight <= high:
            hovers = notice("mission.hovers", hover_n=hover, percent=percent)
            return None if self._waits else MissionMove(Event.TRACK, hovers)
        why = notice("mission.hover_thrust", hover_n=hover, percent=percent, low=100.0 * low, high=100.0 * high)
        return MissionMove(Event.LAND, why, fault=True)

    def _check_duration(self, tick: Tick) -> MissionMove | None:
        duration = self._config.flight.duration_s
        if duration is None or tick.flight_time_s < duration:
            return None
        back = Event.LAND if self._home is None else Event.RETURN
        return MissionMove(back, notice("mission.flown", duration_s=duration))

    def _halt(self, now: Reference) -> list[Blend]:
        """To rest, where ``now`` is not."""
        return [stop(now, self._transit)] if math.hypot(*now.velocity_ned) > AT_REST_M_S else []

    def _halt_aside(self, now: Reference) -> list[Blend]:
        """To rest sideways, climbing on, where wind has moved ``now``, which nothing withstood on the floor."""
        north, east, climb = now.velocity_ned
        speed = math.hypot(north, east)
        if speed <= BLOWN_M_S:
            return []
        hardest = min(HALTS_M_S2, HALTS_PER_S * speed) if self._config.pose.by_autopilot else HALTS_M_S2
        halt = stop(msgspec.structs.replace(now, velocity_ned=(north, east, 0.0)), Limits(1.0, hardest))
        north, east, down = halt.at(halt.duration_s).position_ned
        place = (north, east, down + climb * halt.duration_s)
        return [Blend(now, Reference(place, (0.0, 0.0, climb), yaw_rad=now.yaw_rad), halt.duration_s)]

    def _above(self, place: Vec3 | None, now: Reference, time_s: float, limits: Limits, ways: list[Blend]) -> Leg:
        """To rest above ``place``, at the height of the take-off, after ``ways``; without one, above where they end."""
        at_rest = now if not ways else ways[-1].at(ways[-1].duration_s)
        north, east, _ = place or at_rest.position_ned
        above = (north, east, self._config.flight.floor_z_m - self._config.takeoff.height_m)
        ways.append(blend(at_rest, Reference(above, yaw_rad=at_rest.yaw_rad), limits))
        return _leg(ways, Hold(above, at_rest.yaw_rad), time_s)

    def _to_point(self, now: Reference, time_s: float) -> Leg:
        """Straight to the next point, from rest to rest."""
        ways = self._halt(now)
        at_rest = now if not ways else ways[-1].at(ways[-1].duration_s)
        point = self._points[self._reached]
        yaw = at_rest.yaw_rad if point.yaw_deg is None else math.radians(point.yaw_deg)
        ways.append(blend(at_rest, Reference(point.place_ned, yaw_rad=yaw), self._transit))
        return _leg(ways, Hold(point.place_ned, yaw), time_s)

    def _down(self, now: Reference, time_s: float) -> Leg:
        """Stop, then sink without a step of the speed; slowly from the approach height on, and on through the floor."""
        landing, flight = self._config.landing, self._config.flight
        ways = self._halt(now)
        if ways:
            now = ways[-1].at(ways[-1].duration_s)
        slow, low = (0.0, 0.0, landing.touchdown_m_s), flight.floor_z_m - landing.approach_m
        north, east, down = now.position_ned
        if down < low - landing.approach_m:
            limits = Limits(flight.descent_m_s, self._transit.acceleration_m_s2)
            ways.append(blend(now, Reference((north, east, low), slow, yaw_rad=now.yaw_rad), limits))
        else:  # near the floor: only take up the speed
            here = run_in(Reference(now.position_ned, slow, yaw_rad=now.yaw_rad), self._transit)
            way = now.position_ned[2] - here.position_at(0.0)[2]
            ways.append(Blend(now, Reference((north, east, down + way), slow, yaw_rad=now.yaw_rad), here.duration_s))
        end = ways[-1].at(ways[-1].duration_s)
        on = Blend(end, ways[-1].at(ways[-1].duration_s + 1.0), 1.0)  # at that speed, and on and on
        return _leg(ways, on, time_s)


def _leg(ways: list[Blend], last: Trajectory, time_s: float) -> Leg:
    return Leg(Chain(ways, last), time_s + sum(way.duration_s for way in ways))


class Hearing:
    """Monitor of the telemetry's interval and silence. Times are on the loop's clock [s]."""

    def __init__(self) -> None:
        self._heard_s, self._usual_s = -math.inf, USUAL_S

    def hear(self, now_s: float) -> None:
        """Take the time of a telemetry message."""
        since_s, self._heard_s = now_s - self._heard_s, now_s
        if since_s < LOST_S:
            self._usual_s += USUAL * (since_s - self._usual_s)

    def stalls(self, now_s: float) -> float:
        """For how long it has been silent, where that is a link that stalls; else 0 [s]."""
        silent_s = now_s - self._heard_s
        return silent_s if max(SILENT_S, SILENTS * self._usual_s) < silent_s < LOST_S else 0.0


class CommandUplink:
    """Whether commands reach the vehicle. Times are on the loop's clock [s]."""

    def __init__(self, arrival: Callable[[float], Arrival]) -> None:
        """``arrival`` tells whether commands arrive at an instant [s]."""
        self._arrival = arrival
        self.hearing = Hearing()
        """Monitor of the telemetry, which stalls where the radio does."""
        self.unheard = False
        """Whether the vehicle acknowledged nothing for so long that the uplink is assumed down."""
        self.is_late = False
        """Whether commands are heard too late."""

    def look(self, now_s: float) -> Sentence | None:
        """Look once a frame whether acknowledgements are overdue, or late.

        Return why commands can't fly the vehicle though the autopilot is heard; None where they reach it in time.
        """
        overdue_s, late_s = self._arrival(now_s)
        self.unheard, self.is_late = overdue_s > UNHEARD_S, late_s > 0.0
        if self.is_late:
            return notice("fault.late_commands", late_ms=1e3 * late_s)
        return notice("fault.unanswered", overdue_ms=1e3 * overdue_s) if overdue_s > DEAF_S else None


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
        """Describe the obstacle on the way of ``leg``, braking included; None where there is none."""
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


class MissionNews:
    """News of a mission for the operator, each told once for as long as it lasts."""

    def __init__(self, say: Callable[..., None]) -> None:
        """``say`` takes a sentence, and the kind of its :class:`Notice`."""
        self.say = say
        self._warned = ""
        self._health = HealthState.OK

    def warn(self, warning: Sentence | None) -> None:
        """Tell a warning once, for as long as it lasts with these words; None where it is over."""
        if warning is not None and warning.text != self._warned:
            self.say(warning)
        self._warned = "" if warning is None else warning.text

    def tell_health(self, state: HealthState, reason_id: str) -> None:
        """Tell that the poses are asked, and that they answer."""
        before, self._health = self._health, state
        if state is before or state is HealthState.FAILED:
            return
        suspect = state is HealthState.SUSPECT
        self.say(notice(reason_id if suspect else "pose.answers"), kind="suspicion" if suspect else "news")


class MissionExecutive:
    """One flight's mission, with the pilot that flies it. Times are on the event loop's clock [s]."""

    def __init__(
        self,
        config: Config,
        pilot: Pilot,
        period_s: Callable[[], float],
        say: Callable[..., None],
        on_state: Callable[[State, Sentence], None],
        others: Others | None = None,
        *,
        lands_by_own_position: Callable[[float], bool] = lambda now_s: False,
        arrival: Callable[[float], Arrival] = lambda now_s: IN_TIME,
        on_failure: Callable[[], None] = lambda: None,
        monitors: Monitors = MONITORS,
    ) -> None:
        """``say`` takes a sentence, and the kind of its :class:`Notice`, ``on_state`` every state that begins, and why.

        ``period_s`` tells the link's time between two commands [s]; ``others`` are vehicles to keep away from.
        ``lands_by_own_position`` tells whether the autopilot can land by a position of its own at an instant [s],
        ``arrival`` whether commands reach it then.
        ``on_failure`` hears that the poses are not believed any more, before the last command
        leaves. ``monitors`` makes the guards.
        """
        self._config = config
        self._pilot = pilot
        self._period_s = period_s
        self._means = DescentMeans(pilot, lands_by_own_position)
        self._uplink = CommandUplink(arrival)
        self._on_failure = on_failure
        self.failure: Failure | None = None
        """Why the poses, or the commands, have ended the flight; None where they have not."""
        self._down_by_s = math.inf
        self._news = MissionNews(say)
        self._on_state = on_state
        self._mission = Mission()
        self._course = Course(config)
        self._standing = StandingPoses()
        self._spooling: SpoolUp | None = None
        guards = config.guards
        self._guards: Guards | None = None
        self._clearance = clearance = Clearance(config, others)
        if config.flight.start == "floor":  # what is held in the air has an error to begin with, and nobody beneath it
            floor_z_m = config.flight.floor_z_m
            self._guards = monitors.guards(
                guards, clearance.fence, config.vehicle, period_s, clearance.separation, floor_z_m,
                config.controller.gravity, config.flight.coast_s,
            )  # fmt: skip
        self._escalation = Escalation(guards.lasting_s)
        self.tick: Tick | None = None
        """The newest command of the controller that left."""
        self.fault: Sentence | None = None
        """Cause of an early landing that nobody requested; None where there was none."""
        self.started_s: float | None = None
        """When the trajectory starts [s]; None before that is known."""

    @property
    def state(self) -> State:
        """Where the flight stands."""
        return self._mission.state

    @property
    def reason(self) -> Sentence | None:
        """Why it stands there; None before it began."""
        return self._mission.reason

    @property
    def standing(self) -> StandingPoses:
        """The poses before take-off."""
        return self._standing

    @property
    def low(self) -> bool:
        """Whether it was so near the floor when the last command left that an autopilot may have felt it."""
        floor = self._config.flight.floor_z_m
        return self.tick is not None and floor - self.tick.estimate.motion.position[2] < DISARMED_HEIGHT_M

    @property
    def at_floor(self) -> bool:
        """Whether the newest pose shows it on the floor, or nearly."""
        pose = self._pilot.newest_pose
        return pose is not None and self._config.flight.floor_z_m - pose.position_ned[2] < DISARMED_HEIGHT_M

    def allows(self, event: Event) -> bool:
        """Whether ``event`` is possible now."""
        return self._mission.allows(event)

    def go(self, event: Event, reason: Sentence, now_s: float, *, fault: bool = False, blind: bool = False) -> None:
        """Move by ``event``, and begin what is to be flown then; ``fault`` where it is not how it was meant to go.

        ``blind`` where a descent must not believe the estimate of the speed.

        Raises:
            IllegalMove: it is not possible now.
        """
        if fault:
            self.fault = self.fault or reason
        before = self.state
        state = self._mission.on(event, reason)
        if state is before:
            if event is Event.HOLD:  # in the hold after a climb: it does not go on by itself any more
                self._course.wait()
            return
        self._on_state(state, reason)
        self._down_by_s = now_s + self._way_down_s() if state in (State.LANDING, State.DESCENT) else math.inf
        if state in FINAL or state not in IN_AIR:
            return
        if self._spooling is not None and self._spooling.flies is None:  # still on the floor: there is nothing to fly
            self.go(Event.TOUCHDOWN, notice("mission.still_on_floor"), now_s)
        elif state is State.DESCENT:
            if self._spooling is not None:  # off the floor since the newest pose, and no command has told so yet
                self._climb_away(now_s)
            rest = 0.0 if self._guards is None else self._config.guards.level_s
            self._descend(now_s, blind=blind, rest_s=rest)
        elif event is Event.TRACK:
            self._escalation.reset()
            self._follow(self._course.leg(event, state, *self._motion(now_s)))
        elif event is Event.ARMED:
            self._spool_up(now_s)
        elif event is Event.AIRBORNE:
            self._follow(self._course.at_once(now_s))
        else:
            self._follow(self._course.leg(event, state, *self._motion(now_s)))

    def _way_down_s(self) -> float:
        """Return the longest plausible duration of the way down from here [s]."""
        pose, flight = self._pilot.newest_pose, self._config.flight
        height_m = 0.0 if pose is None else max(flight.floor_z_m - pose.position_ned[2], 0.0)
        return LONGER_S + LONGER * height_m / min(flight.descent_m_s, self._config.landing.touchdown_m_s)

    def move(self, points: tuple[Waypoint, ...], why: str, now_s: float) -> Sentence | None:
        """Begin to fly to ``points``; returns why not, or None. Points are looked at now, each leg before it."""
        for number, point in enumerate(points, 1):
            if refusal := self._clearance.find_obstacle(point.place_ned):
                place = list(point.place_ned)
                return notice("goto.point", number=number, count=len(points), place=place, why=refusal)
        self._course.plan(points)
        leg = self._course.leg(Event.GOTO, State.MOVING, *self._motion(now_s))
        if refusal := self._clearance.find_way_out(leg, now_s):
            return notice("goto.way", target=self._course.target, why=refusal)
        self.go(Event.GOTO, notice("mission.goto", target=self._course.target, why=why), now_s)
        return None

    def _go_on(self, arrived: MissionMove, now_s: float) -> None:
        """A point is reached: on to the next one, where its leg is free; else hold here."""
        if not self._course.arrive():
            self.go(arrived.event, arrived.reason, now_s)
            return
        leg = self._course.leg(Event.GOTO, State.MOVING, *self._motion(now_s))
        if refusal := self._clearance.find_way_out(leg, now_s):
            self.go(Event.HOLD, notice("mission.not_to_point", target=self._course.target, why=refusal), now_s)
            return
        self._news.say(notice("mission.to_point", target=self._course.target), kind="course")
        self._follow(leg)

    def command(self, now_s: float) -> tuple[Command, Tick | None]:
        """The command of this frame, and the tick behind it; on the floor there is none."""
        spooling, pose = self._spooling, self._pilot.newest_pose
        if spooling is not None and spooling.flies is not None:
            self._climb_away(now_s)
            spooling = None
        if spooling is None:
            if self._comes_too_late(now_s):
                return self._pilot.let_go(now_s, LAST_PERIODS * self._period_s()), None
            if self._answer_failure(now_s):
                if self._means.chosen is Means.FLOOR:
                    return self._pilot.idle(now_s, 0.0), None
                return self._pilot.surrender(now_s, LAST_PERIODS * self._period_s()), None
            self._ensure_pose(now_s)
            tick = self._pilot.tick(now_s)
            return tick.command, tick
        assert pose is not None, "it stood, by its poses"
        coast_s = self._config.flight.coast_s - LAST_CHANCE_S - 1e-3
        why = self._uplink.look(now_s) or spooling.fault(now_s, pose, coast_s, self._clearance.fence)
        if why is not None:
            self.go(Event.LAND, why, now_s, fault=True)
            return self._pilot.idle(now_s, 0.0), None
        return self._pilot.idle(now_s, spooling.thrust_n(now_s)), None

    def left(self, now_s: float) -> None:
        """A command has left; where it was the last that poses have led to, commands end with it."""
        if self._means.ends_commands and self.failure is not None:
            self.go(Event.ABORT, self.failure.reason, now_s, fault=True)

    def _comes_too_late(self, now_s: float) -> bool:
        """Whether commands end, as they come too late; where none arrive, they are gentle, and nothing is learnt."""
        uplink = self._uplink
        why = uplink.look(now_s)
        self._pilot.listen(uplink.unheard)
        if not uplink.unheard:
            return False
        if why and uplink.is_late:
            self.failure = Failure("link.late", notice("fault.late_commands_end", why=why))
            self._means.end()
            return True
        if why and self.state is not State.DESCENT:
            self.go(Event.DESCEND, why, now_s, fault=True)
        return False

    def _answer_failure(self, now_s: float) -> bool:
        """Come down by what still answers, where the poses have failed; return whether commands end."""
        health = self._pilot.health
        if self._guards is None:
            return False
        self._pilot.pause_response(self._uplink.hearing.stalls(now_s) > 0.0)
        self._news.tell_health(health.state, health.reason_id)
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

    def _descend(self, now_s: float, *, blind: bool, rest_s: float = 0.0) -> None:
        height_m = self._pilot.descend(DESCENT_M_S, blind=blind, rest_s=rest_s)
        self._means.descend_blind(now_s, height_m)

    def observe(self, tick: Tick) -> None:
        """One command of the controller has left: is the state over?"""
        self.tick = tick
        guards = self._guards
        if guards is not None:
            finding = guards.see(tick, self.state)
            if finding is None or finding.step is GuardAction.WARN:
                self._news.warn(None if finding is None else finding.reason.as_warning())
            else:
                self._answer(finding, tick.time_s)
        move = self._course.over(self.state, tick, heard=not self._uplink.unheard) or self._find_overtime(tick)
        self._pilot.touch(self.state is State.LANDING and self._course.touches)
        if move is not None and move.event is Event.ARRIVED:
            self._go_on(move, tick.time_s)
        elif move is not None:
            self.go(move.event, move.reason, tick.time_s, fault=move.fault)

    def _find_overtime(self, tick: Tick) -> MissionMove | None:
        """End a way down that takes so long that the floor is not where it is configured."""
        if not tick.time_s > self._down_by_s:
            return None
        why = notice("fault.no_floor")
        if self.state is State.LANDING:
            return MissionMove(Event.DESCEND, why, fault=True)
        return MissionMove(Event.ABORT, notice("fault.no_floor_end", why=why), fault=True)

    def link(self, status: LinkStatus, now_s: float) -> None:
        """The link has told of itself."""
        if status.taken and self.allows(Event.TAKEN_OVER):
            self.go(Event.TAKEN_OVER, notice("fault.taken", mode=status.taken), now_s, fault=True)
        elif self._guards is not None and self.state in IN_AIR:
            self._answer(self._guards.link(status, now_s), now_s)

    def _ensure_pose(self, now_s: float) -> None:
        """Where no frame is left before the newest pose may not be rested on any longer, come down on the model."""
        pose, coast = self._pilot.newest_pose, self._config.flight.coast_s
        guarded = self._guards is not None and self._config.guards.level_s > 0.0
        if guarded and pose is not None and now_s - pose.time_s > coast - LAST_CHANCE_S - 1e-3:
            why = notice("fault.pose_gap", age_ms=(now_s - pose.time_s) * 1e3)
            self._answer(GuardFinding(GuardAction.DESCEND, why, blind=True), now_s)

    def _answer(self, finding: GuardFinding | None, now_s: float) -> None:
        """Do what a guard asks for, or the next possible step after it."""
        answer = None if finding is None else self._escalation.answer(finding, now_s)
        if answer is None:
            return
        for step, event in (
            (GuardAction.HOLD, Event.HOLD),
            (GuardAction.LAND, Event.LAND),
            (GuardAction.DESCEND, Event.DESCEND),
        ):
            if step >= answer.step and self.allows(event):
                if TABLE[self.state, event] is not self.state:
                    self.go(event, answer.reason, now_s, fault=True, blind=answer.blind)
                elif step is answer.step:
                    self.go(event, answer.reason, now_s, fault=True)
                    self._news.say(answer.reason.as_warning())
                return

    def pose(self, pose: Pose) -> None:
        """One pose has come."""
        if self._spooling is not None:
            self._spooling.pose(pose)
        elif self.tick is None:
            self._standing.stands(pose)

    def hear(self, now_s: float) -> None:
        """The vehicle has told how it turns."""
        self._uplink.hearing.hear(now_s)

    def attitude(self, told: Attitude, in_poses: Quat | None, now_s: float) -> None:
        """Take the autopilot's attitude; ``in_poses`` is the same in the axes of the poses, if known."""
        if in_poses is not None:
            self._means.hear_attitude(told, in_poses, now_s)

    def _spool_up(self, now_s: float) -> None:
        """The motors turn: thrust rises from now on until the floor is left."""
        config, vehicle = self._config, self._config.vehicle
        weight, takeoff = config.weight_n, config.takeoff
        most, idle = limit_n(config), config.flight.idle_thrust * weight
        spool = Spool(weight, most, takeoff.spool_s, idle, now_s, vehicle.thrust_lag_s)
        gravity, noise_m = config.controller.gravity, self._pilot.noise_m
        self._spooling = spooling = SpoolUp(self._standing, spool, vehicle, weight, gravity, noise_m)
        self._course.stood(spooling.place_ned)

    def _climb_away(self, now_s: float) -> None:
        """Climb off the floor; from now on it flies by poses."""
        self._news.say(notice("mission.off_floor"))
        self._follow(self._course.leg(Event.ARMED, State.TAKEOFF, *self._motion(now_s)))

    def _motion(self, now_s: float) -> tuple[Reference, float]:
        """The motion that the next leg begins with, and the instant [s] that it is for."""
        spooling, self._spooling = self._spooling, None
        climb = None if spooling is None else spooling.flies
        if climb is not None:  # it has just left the floor
            motion = self._pilot.lift(now_s, climb.hover_share, climb.climb_m_s)
            return motion, now_s + self._config.vehicle.acting_delay_s
        assert self.tick is not None, "it flies"
        reference, here = self.tick.reference, self.tick.estimate.motion
        if self.state is State.LANDING and math.dist(reference.position_ned, here.position) > ASTRAY_M:
            reference = Reference(here.position, here.velocity, yaw_rad=reference.yaw_rad)
        return reference, self.tick.estimate.time_s

    def _follow(self, leg: Leg) -> None:
        is_limited = self.state not in (State.HOLD, State.TRACKING)
        self._pilot.ease(self.state is not State.TRACKING, is_limited=is_limited)
        self._pilot.follow(leg.trajectory, leg.start_s)
        if self.state is State.TRACKING:
            self.started_s = leg.start_s
