"""What is flown in each state of the mission, and when that is over. Sans-IO."""

import math
from typing import NamedTuple

from groundstation.core import Tick
from groundstation.core.geometry import Vec3
from groundstation.core.mission import Event, State
from groundstation.core.safety import Hover, Touchdown
from groundstation.core.trajectory import Blend, Chain, Hold, Limits, Reference, Trajectory, blend, run_in, stopped
from groundstation.settings import Config

AT_REST_M_S = 0.02
"""Slower than this a reference need not be stopped first [m/s]."""
FAST_M_S2 = 2.0
"""What leaves the floor faster than it is to climb may be slowed down so hard, rather than climb too high [m/s²]."""


class Leg(NamedTuple):
    """A reference, and when its time 0 is."""

    trajectory: Trajectory
    start_s: float
    """On the event loop's clock [s]."""


class Move(NamedTuple):
    """An event of the mission, and why."""

    event: Event
    reason: str
    fault: bool = False
    """Whether this is not how the flight was meant to go."""


class Course:
    """One flight's references: climb, hold, onto the trajectory and along it, back, and down."""

    def __init__(self, config: Config) -> None:
        """Nothing is flown yet."""
        self._config = config
        self._trajectory = config.trajectory.build()
        takeoff = config.takeoff
        self._transit = Limits(takeoff.transit_m_s, takeoff.transit_m_s2)
        self._climb = Limits(takeoff.climb_m_s, takeoff.transit_m_s2)
        self._home: Vec3 | None = None
        self._waits = False
        self._hover = Hover()
        self._touchdown = Touchdown(config.weight_n)

    @property
    def home_ned(self) -> Vec3 | None:
        """Where it stood before take-off [m]; None where it started in the air."""
        return self._home

    def stood(self, place_ned: Vec3) -> None:
        """It takes off from here [m]."""
        self._home = place_ned

    def at_once(self, time_s: float) -> Leg:
        """The trajectory from its beginning, wherever the vehicle is: for one that is let go in the air."""
        return Leg(self._trajectory, time_s)

    def leg(self, event: Event, state: State, now: Reference, time_s: float) -> Leg:
        """What is flown from the motion ``now`` on at ``time_s`` [s], as ``event`` leads to ``state``."""
        match state:
            case State.TAKEOFF:
                climb = self._climb
                if math.hypot(*now.velocity_ned) > climb.speed_m_s:
                    climb = Limits(climb.speed_m_s, max(climb.acceleration_m_s2, FAST_M_S2))
                return self._above(now.position_ned, now, time_s, climb, halts=False)
            case State.TRACKING:
                return _leg(self.entry(now), self._trajectory, time_s)
            case State.RETURNING:
                return self._above(self._home, now, time_s, self._transit, halts=True)
            case State.LANDING:
                return self._down(now, time_s)
            case _:
                self._waits, self._hover = event is Event.HOLD, Hover()
                return Leg(stopped(now, self._transit), time_s)

    def entry(self, now: Reference) -> list[Blend]:
        """The ways from ``now`` onto the beginning of the trajectory, which is met in its own motion."""
        ways = self._halt(now)
        begin = run_in(self._trajectory.at(0.0), self._transit)
        at_rest = now if not ways else ways[-1].at(ways[-1].duration_s)
        return [*ways, blend(at_rest, begin.at(0.0), self._transit), begin]

    def over(self, state: State, tick: Tick) -> Move | None:
        """What ends ``state``, by one more command in it; None while it goes on."""
        match state:
            case State.TAKEOFF:
                return Move(Event.CLIMBED, "at height: holding") if tick.flight_time_s >= 0.0 else None
            case State.HOLD:
                return self._hovered(tick)
            case State.TRACKING:
                return self._flown(tick)
            case State.RETURNING:
                return Move(Event.HOME, "over the place of take-off") if tick.flight_time_s >= 0.0 else None
            case State.LANDING | State.DESCENT:
                return Move(Event.TOUCHDOWN, "touched down") if self._felt(state, tick) else None
            case _:
                return None

    def _felt(self, state: State, tick: Tick) -> bool:
        motion = tick.estimate.motion
        down = motion.position[2]
        height, behind = self._config.flight.floor_z_m - down, tick.reference.position_ned[2] - down
        if state is State.DESCENT:
            behind = math.inf
        pose_m, sinks_m_s = self._config.flight.floor_z_m - tick.pose.position_ned[2], tick.reference.velocity_ned[2]
        stands = self._touchdown.stands(tick.pose, pose_m, sinks_m_s)
        felt = self._touchdown.felt(tick.time_s, tick.command.thrust_n, motion.velocity[2], height, behind)
        return stands or felt

    def _hovered(self, tick: Tick) -> Move | None:
        """After the climb: on to the trajectory, or down again where the hover thrust is not this vehicle's."""
        hold_s, weight = self._config.takeoff.hold_s, self._config.weight_n
        if tick.flight_time_s > 0.5 * hold_s:  # the climb has died away
            self._hover.see(tick.command.thrust_n)
        hover = self._hover.thrust_n
        if self._waits or tick.flight_time_s < hold_s or hover is None:
            return None
        self._touchdown = Touchdown(hover)
        low, high = self._config.vehicle.hover_range
        says = f"it hovers at {hover:.4g} N, {100.0 * hover / weight:.0f} % of its weight"
        if low <= hover / weight <= high:
            return Move(Event.TRACK, f"{says}: onto the trajectory")
        return Move(
            Event.LAND,
            f"{says}; vehicle.hover_range allows {100.0 * low:.0f} to {100.0 * high:.0f} %: check mass_kg, "
            "thrust_max_n, battery and propellers",
            fault=True,
        )

    def _flown(self, tick: Tick) -> Move | None:
        duration = self._config.flight.duration_s
        if duration is None or tick.flight_time_s < duration:
            return None
        back = Event.LAND if self._home is None else Event.RETURN
        return Move(back, f"{duration:g} s are flown")

    def _halt(self, now: Reference) -> list[Blend]:
        """To rest, where ``now`` is not."""
        return [stopped(now, self._transit)] if math.hypot(*now.velocity_ned) > AT_REST_M_S else []

    def _above(self, place: Vec3 | None, now: Reference, time_s: float, limits: Limits, *, halts: bool) -> Leg:
        """To rest above ``place``, at the height of the take-off; without one, above where it stops."""
        ways = self._halt(now) if halts else []
        at_rest = now if not ways else ways[-1].at(ways[-1].duration_s)
        north, east, _ = place or at_rest.position_ned
        above = (north, east, self._config.flight.floor_z_m - self._config.takeoff.height_m)
        ways.append(blend(at_rest, Reference(above, yaw_rad=at_rest.yaw_rad), limits))
        return _leg(ways, Hold(above, at_rest.yaw_rad), time_s)

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
