"""Phases: what is flown from one move of the mission to the next. Sans-IO.

A phase owns its reference, its profile (gain set, limits and tones), and the test by which it ends.
The spool-up before all others has no reference
(:class:`groundstation.core.safety.takeoff.SpoolUp`), nor has the failsafe descent.
"""

import math
from typing import NamedTuple

from groundstation.core.control import HOLDING, TRACKING, TRANSIT, FlightProfile
from groundstation.core.messages import Sentence, Tick, Waypoint, notice
from groundstation.core.mission import Event
from groundstation.core.safety import Touchdown
from groundstation.core.trajectory import Reference
from groundstation.flight.controller.course import Course, Leg
from groundstation.settings import Config
from links.text import to_percent


class MissionMove(NamedTuple):
    """An event of the mission, and why."""

    event: Event
    reason: Sentence
    fault: bool = False
    """Whether it ends the flight early."""


class FlightPhase:
    """One phase with a reference. Times are on the event loop's clock [s]."""

    profile: FlightProfile = TRANSIT
    """Gain set, limits and tones."""

    def __init__(self, leg: Leg) -> None:
        self.leg = leg
        """Reference, and the instant of its time 0."""

    def find_end(self, tick: Tick, *, uplink_ok: bool) -> MissionMove | None:
        """Return the move that ends the phase; None while it goes on.

        ``tick`` is a command that has left. Without ``uplink_ok`` the vehicle may not have received
        it.
        """
        raise NotImplementedError


class TransitPhase(FlightPhase):
    """A leg to rest: the climb to the take-off height, or the way back over the place of take-off.

    Time 0 of the leg is its end: before it, its time is negative.
    """

    def __init__(self, leg: Leg, arrival: MissionMove) -> None:
        """``arrival`` is the move at the end of the leg."""
        super().__init__(leg)
        self._arrival = arrival

    def find_end(self, tick: Tick, *, uplink_ok: bool) -> MissionMove | None:
        """Return the arrival at the end of the leg; see :class:`FlightPhase`."""
        return self._arrival if uplink_ok and tick.flight_time_s >= 0.0 else None


class GoToPhase(TransitPhase):
    """A leg to a point, one of several that are flown to one after the other."""

    def __init__(
        self,
        course: Course,
        now: Reference,
        time_s: float,
        points: tuple[Waypoint, ...],
        index: int = 0,
    ) -> None:
        """Plan the leg to the point ``index`` of ``points``, from the motion ``now`` at ``time_s``
        [s].
        """
        which = f", {index + 1} of {len(points)}" if len(points) > 1 else ""
        self.target = course.describe(points[index], which)
        """Description of the point."""
        arrival = MissionMove(Event.ARRIVED, notice("mission.there", target=self.target))
        super().__init__(course.go_to(points[index], now, time_s), arrival)
        self._course, self._points, self._index = course, points, index

    def begin_next(self, now: Reference, time_s: float) -> "GoToPhase | None":
        """Return the phase to the next point from the motion ``now``; None after the last one."""
        index = self._index + 1
        return (
            GoToPhase(self._course, now, time_s, self._points, index)
            if index < len(self._points)
            else None
        )


class HoldPhase(FlightPhase):
    """Stay at one place: after the climb until the hover thrust has been measured, otherwise until
    a request ends the phase.
    """

    profile = HOLDING

    def __init__(self, config: Config, course: Course, leg: Leg, *, waits: bool) -> None:
        """``waits``: no hover thrust is measured, and a request ends the phase."""
        super().__init__(leg)
        self._config, self._course = config, course
        self._waits = waits
        self._thrusts_n: list[float] | None = None if waits else []
        """Commanded thrusts, whose mean is the hover thrust [N]; None where it is not measured, or
        has been."""

    def wait_for_request(self) -> None:
        """Stay until a request ends this phase."""
        self._waits = True

    def find_end(self, tick: Tick, *, uplink_ok: bool) -> MissionMove | None:
        """Go on to the trajectory, or land if the hover thrust does not fit the vehicle.

        See :class:`FlightPhase`.
        """
        hold_s, weight = self._config.takeoff.hold_s, self._config.weight_n
        thrusts = self._thrusts_n
        if not uplink_ok or thrusts is None:
            return None
        # In the first half the thrust still brakes the climb.
        if tick.flight_time_s > 0.5 * hold_s:
            thrusts.append(tick.command.thrust_n)
        if tick.flight_time_s < hold_s or not thrusts:
            return None
        hover = sum(thrusts) / len(thrusts)
        self._course.touchdown, self._thrusts_n = Touchdown(hover), None
        low, high = self._config.vehicle.hover_range
        percent = to_percent(hover / weight)
        if low <= hover / weight <= high:
            hovers = notice("mission.hovers", hover_n=hover, percent=percent)
            return None if self._waits else MissionMove(Event.TRACK, hovers)
        why = notice(
            "mission.hover_thrust",
            hover_n=hover,
            percent=percent,
            low=to_percent(low),
            high=to_percent(high),
        )
        return MissionMove(Event.LAND, why, fault=True)


class TrackPhase(FlightPhase):
    """Fly along the trajectory, for the configured time."""

    profile = TRACKING

    def __init__(self, leg: Leg, duration_s: float | None, end: Event) -> None:
        """``end`` is the event after ``duration_s`` on the trajectory [s], a return or a landing.

        Without ``duration_s`` only a request ends the phase.
        """
        super().__init__(leg)
        self._duration_s, self._end = duration_s, end

    def find_end(self, tick: Tick, *, uplink_ok: bool) -> MissionMove | None:
        """Return the configured end after the duration; see :class:`FlightPhase`."""
        duration = self._duration_s
        if not uplink_ok or duration is None or tick.flight_time_s < duration:
            return None
        return MissionMove(self._end, notice("mission.flown", duration_s=duration))


class LandPhase(FlightPhase):
    """Sink under full control until the vehicle is on the floor."""

    def __init__(self, course: Course, leg: Leg, over_by_s: float) -> None:
        """``over_by_s``: instant after which the floor is not where it is configured [s]."""
        super().__init__(leg)
        self._course, self._over_by_s = course, over_by_s

    def find_end(self, tick: Tick, *, uplink_ok: bool) -> MissionMove | None:
        """Stop the motors on the floor, or descend where there is none.

        See :class:`FlightPhase`.
        """
        behind_m = tick.reference.position_ned[2] - tick.estimate.motion.position[2]
        if self._course.detect_touchdown(tick, behind_m, uplink_ok=uplink_ok):
            return MissionMove(Event.TOUCHDOWN, notice("mission.touched_down"))
        if tick.time_s <= self._over_by_s:
            return None
        return MissionMove(Event.DESCEND, notice("fault.no_floor"), fault=True)


class DescentPhase:
    """Failsafe descent: level and down, without a reference, until the vehicle is on the floor."""

    def __init__(self, course: Course, over_by_s: float) -> None:
        """``over_by_s``: instant after which there is no floor where it is configured [s]."""
        self._course, self._over_by_s = course, over_by_s

    def find_end(self, tick: Tick, *, uplink_ok: bool) -> MissionMove | None:
        """Stop the motors on the floor, or end the commands where there is none.

        See :class:`FlightPhase`.
        """
        if self._course.detect_touchdown(tick, math.inf, uplink_ok=uplink_ok):
            return MissionMove(Event.TOUCHDOWN, notice("mission.touched_down"))
        if tick.time_s <= self._over_by_s:
            return None
        return MissionMove(
            Event.ABORT, notice("fault.no_floor_end", why=notice("fault.no_floor")), fault=True
        )
