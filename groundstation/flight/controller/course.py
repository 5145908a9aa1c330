"""Course: legs from the reference of now to rest, to places and down, and the obstacles on them.

Sans-IO.
"""

import math
from typing import NamedTuple

import msgspec

from groundstation.core.geometry import Vec3, third_column
from groundstation.core.messages import Others, Sentence, Tick, Waypoint, notice
from groundstation.core.safety import NEAR_M, Fence, Separation, Touchdown
from groundstation.core.trajectory import (
    Blend,
    Chain,
    Hold,
    Limits,
    Reference,
    Trajectory,
    blend,
    run_in,
    stop,
)
from groundstation.settings import Config

AT_REST_M_S = 0.02
"""Speed up to which a reference counts as at rest, and is not braked before the next leg [m/s]: a
blend takes over such a speed within millimetres."""
CLIMB_M_S2 = 2.0
"""Largest acceleration of a climb, and deceleration after a lift-off that is faster than the climb
speed [m/s²]: the first climb has 1.2 of the hover thrust, 2 m/s² (``FIRST_CLIMB_SHARE``)."""
DRIFT_M_S = 0.1
"""Above this horizontal speed at lift-off, wind has moved the vehicle and it is braked [m/s]."""
DRIFT_BRAKING_M_S2 = 3.0
"""Deceleration of that braking [m/s²]: less than the tilt limit of the first climb allows (5.7)."""
DRIFT_BRAKING_PER_S = 3.5
"""Largest deceleration by an autopilot's own estimate, per m/s of its speed [1/s]: its speed may be
wrong by 0.3 m/s, which is then braked by 1 m/s² only."""
CHECKED_INTERVALS = 40
"""Intervals between the points at which a leg is checked before it is flown [-]: every 10 cm of a
leg of 4 m."""


class Leg(NamedTuple):
    """A reference, and the instant of its time 0."""

    trajectory: Trajectory
    start_s: float
    """Instant of its time 0, on the event loop's clock [s]. A chain of blends ends there: until
    then its time is negative. Other references begin there."""


class Clearance:
    """Obstacles to points (floor, fence) and to legs (fence, speed limit, and the other vehicles as
    they fly now).
    """

    def __init__(self, config: Config, others: Others | None) -> None:
        """``others`` are vehicles to keep away from."""
        self._floor_z_m, self._max_speed_m_s = config.flight.floor_z_m, config.limits.max_speed_m_s
        self.fence = None if config.fence is None else Fence(config.fence, config.flight.floor_z_m)
        """Geofence; None without one."""
        self.separation = None if others is None else Separation(config.separation, others)
        """Distances to the other vehicles; None where there are none."""

    def find_obstacle(self, place: Vec3) -> Sentence | None:
        """Describe the obstacle to a stay at ``place``; None where there is none."""
        height = self._floor_z_m - place[2]
        if not (math.isfinite(sum(place)) and height >= NEAR_M):
            side = "above" if height >= 0.0 else "below"
            return notice("goto.height", height_m=abs(height), side=side, limit_m=NEAR_M)
        room = math.inf if self.fence is None else self.fence.room_m(place)
        return None if room > 0.0 else notice("goto.outside", outside_m=abs(room))

    def find_leg_obstacle(self, leg: Leg, now_s: float) -> Sentence | None:
        """Describe why ``leg`` must not be flown, braking included; None if it is free."""
        separation, max_speed_m_s = self.separation, self._max_speed_m_s
        if (
            separation is not None
            and separation.config.unknown != "warn"
            and (lost := separation.unknown(now_s))
        ):
            return notice("goto.unseen", names=", ".join(lost))
        way = leg.trajectory
        begin_s, steps = now_s - leg.start_s, CHECKED_INTERVALS
        for n in range(steps + 1):
            at = way.at(begin_s * (1.0 - n / steps))
            if (
                self.fence is not None
                and not self.fence.braking_room_m(at.position_ned, at.velocity_ned) > 0.0
            ):
                return notice("goto.braking")
            if max_speed_m_s is not None and math.hypot(*at.velocity_ned) > max_speed_m_s:
                return notice("goto.speed", limit_m_s=max_speed_m_s)
            near = (
                None
                if separation is None
                else separation.nearest(at.position_ned, at.velocity_ned, now_s)
            )
            if near is not None and near.room_m <= 0.0:
                return notice("goto.near", name=near.name)
        return None


class Course:
    """Legs of one flight, each from the reference of now.

    Times are on the event loop's clock [s].
    """

    def __init__(self, config: Config, others: Others | None = None) -> None:
        """``others`` are vehicles to keep away from."""
        self.clearance = Clearance(config, others)
        """Obstacles to points and legs."""
        self.trajectory = config.trajectory.build()
        """The configured trajectory."""
        self.home: Vec3 | None = None
        """Position of the take-off, NED [m]; None for a flight that starts in the air.

        Set at each pose of the spool-up: it follows an origin that moves while the vehicle stands.
        In flight it keeps its numbers, as fence, trajectory and targets do: an estimate that has
        drifted, and is put right, moves to where they are true.
        """
        self._config = config
        self.touchdown = Touchdown(config.weight_n)
        """Detection of the landing."""
        self.believes_height = True
        """Whether the commands use the height of the poses; set at each command."""
        takeoff = config.takeoff
        self._transit = Limits(takeoff.transit_m_s, takeoff.transit_m_s2)

    def climb(self, now: Reference, time_s: float) -> Leg:
        """Climb to the take-off height from the motion ``now`` at the lift-off."""
        takeoff = self._config.takeoff
        is_fast = math.hypot(*now.velocity_ned) > takeoff.climb_m_s
        limits = Limits(
            takeoff.climb_m_s, CLIMB_M_S2 if is_fast else min(takeoff.transit_m_s2, CLIMB_M_S2)
        )
        return self._rise(None, self._halt_aside(now), now, limits, time_s)

    def entry(self, now: Reference) -> list[Blend]:
        """Return the blends from ``now`` to the begin of the trajectory, which they meet at its own
        velocity.
        """
        ways = self._halt(now)
        begin = run_in(self.trajectory.at(0.0), self._transit)
        return [*ways, blend(_find_end(ways, now), begin.at(0.0), self._transit), begin]

    def track(self, now: Reference, time_s: float) -> Leg:
        """Fly onto the trajectory, and along it."""
        return _chain(self.entry(now), self.trajectory, time_s)

    def hold(self, now: Reference, time_s: float) -> Leg:
        """Brake to rest, and stay there."""
        return Leg(stop(now, self._transit), time_s)

    def go_to(self, point: Waypoint, now: Reference, time_s: float) -> Leg:
        """Go straight to ``point``, from rest to rest."""
        ways = self._halt(now)
        yaw = _find_end(ways, now).yaw_rad if point.yaw_deg is None else math.radians(point.yaw_deg)
        return self._go_to(point.place_ned, yaw, ways, now, self._transit, time_s)

    def describe(self, point: Waypoint, which: str) -> Sentence:
        """Describe ``point`` for the operator; ``which`` of several it is."""
        height_m = self._config.flight.floor_z_m - point.down_m
        return notice(
            "goto.target",
            north_m=point.north_m,
            east_m=point.east_m,
            height_m=height_m,
            which=which,
        )

    def go_home(self, now: Reference, time_s: float) -> Leg:
        """Go to rest above the position of the take-off."""
        return self._rise(self.home, self._halt(now), now, self._transit, time_s)

    def land(self, now: Reference, time_s: float) -> Leg:
        """Brake, then sink without a step of the speed, through the floor.

        From twice the approach height on it slows down, and is slow from the approach height on.
        """
        landing, flight = self._config.landing, self._config.flight
        ways = self._halt(now)
        now = _find_end(ways, now)
        slow, low = (0.0, 0.0, landing.touchdown_m_s), flight.floor_z_m - landing.approach_m
        north, east, down = now.position_ned
        if down < low - landing.approach_m:
            limits = Limits(flight.descent_m_s, self._transit.acceleration_m_s2)
            last = blend(now, Reference((north, east, low), slow, yaw_rad=now.yaw_rad), limits)
        else:  # near the floor: only accelerate to that speed
            here = run_in(Reference(now.position_ned, slow, yaw_rad=now.yaw_rad), self._transit)
            way = now.position_ned[2] - here.position_at(0.0)[2]
            last = Blend(
                now,
                Reference((north, east, down + way), slow, yaw_rad=now.yaw_rad),
                here.duration_s,
            )
        # Continues at that speed.
        on = Blend(last.at(last.duration_s), last.at(last.duration_s + 1.0), 1.0)
        return _chain([*ways, last], on, time_s)

    def detect_touchdown(self, tick: Tick, behind_m: float, *, uplink_ok: bool) -> bool:
        """Take one command of a way down, ``behind_m`` [m] above its reference.

        Return whether it has touched down.

        A vehicle without uplink may fly on while a landing commands its thrust: only poses at rest
        show that it has landed. Poses whose height is not believed show it only where the model
        is near the floor, too: a mirrored height stands at the floor's when the vehicle is high.
        """
        motion, commanded_m_s = tick.estimate.motion, tick.reference.velocity_ned[2]
        floor_z_m = self._config.flight.floor_z_m
        height_m = floor_z_m - motion.position[2]
        pose_height_m = floor_z_m - tick.pose.position_ned[2]
        at_rest = self.touchdown.detect_rest(tick.pose, pose_height_m, commanded_m_s)
        thrust_n, sink_m_s = tick.command.thrust_n, motion.velocity[2]
        lift_n = motion.thrust * third_column(motion.attitude)[2]
        landed = self.touchdown.update(
            tick.time_s, thrust_n, lift_n, sink_m_s, height_m, behind_m, commanded_m_s
        )
        is_low = self.believes_height or height_m < NEAR_M
        return (at_rest and is_low) or (landed and uplink_ok)

    def _halt(self, now: Reference) -> list[Blend]:
        """Brake to rest; empty if ``now`` is at rest."""
        return [stop(now, self._transit)] if math.hypot(*now.velocity_ned) > AT_REST_M_S else []

    def _halt_aside(self, now: Reference) -> list[Blend]:
        """Brake the horizontal motion of a climb that wind has moved.

        Nothing opposed the wind on the floor.
        """
        north, east, down_m_s = now.velocity_ned
        speed = math.hypot(north, east)
        if speed <= DRIFT_M_S:
            return []
        hardest = DRIFT_BRAKING_M_S2
        if self._config.pose.by_autopilot:
            hardest = min(hardest, DRIFT_BRAKING_PER_S * speed)
        halt = stop(
            msgspec.structs.replace(now, velocity_ned=(north, east, 0.0)), Limits(1.0, hardest)
        )
        north, east, down = halt.at(halt.duration_s).position_ned
        place = (north, east, down + down_m_s * halt.duration_s)
        return [
            Blend(now, Reference(place, (0.0, 0.0, down_m_s), yaw_rad=now.yaw_rad), halt.duration_s)
        ]

    def _rise(
        self, place: Vec3 | None, ways: list[Blend], now: Reference, limits: Limits, time_s: float
    ) -> Leg:
        """After ``ways`` from ``now``, go to rest at the take-off height above ``place`` (None:
        above their end).
        """
        north, east, _ = place or _find_end(ways, now).position_ned
        return self._go_to((north, east,
            self._config.flight.floor_z_m - self._config.takeoff.height_m),
                             _find_end(ways, now).yaw_rad, ways, now, limits, time_s)  # fmt: skip

    def _go_to(
        self,
        place: Vec3,
        yaw: float,
        ways: list[Blend],
        now: Reference,
        limits: Limits,
        time_s: float,
    ) -> Leg:
        """After ``ways`` from ``now``, go straight to rest at ``place``."""
        last = blend(_find_end(ways, now), Reference(place, yaw_rad=yaw), limits)
        return _chain([*ways, last], Hold(place, yaw), time_s)


def _chain(ways: list[Blend], last: Trajectory, time_s: float) -> Leg:
    return Leg(Chain(ways, last), time_s + sum(way.duration_s for way in ways))


def _find_end(ways: list[Blend], now: Reference) -> Reference:
    """Return the reference at the end of ``ways`` from ``now``."""
    return ways[-1].at(ways[-1].duration_s) if ways else now
