"""Take-off: thrust rises for a moment, and stays on only if the poses respond to it. Sans-IO.

The control law does not run on the floor: there position does not respond to thrust, and adaptation
would learn the floor's force as wind. Before the vehicle moves it is not known whether the poses
are its own, and whether its mass is right. So thrust rises quickly to a low limit, and goes off
again soon if no pose moves: a vehicle that flies without poses of its own has no time to gain
speed. :class:`LiftOff` finds the hover thrust from the poses, :class:`Spool` the thrust over time,
:class:`SpoolUp` combines both.

Each constant says what it must satisfy; tests/unit/groundstation/core/safety/test_liftoff.py flies
them.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec

from groundstation.core.estimation import SIGNIFICANT
from groundstation.core.geometry import Vec3, angle_deg, subtract, third_column
from groundstation.core.messages import ROUNDING_S, Pose, Sentence, notice
from groundstation.core.safety.geofence import Fence
from groundstation.core.vehicle import Vehicle
from links.text import to_ms, to_percent

SHARES = tuple(0.5 + 0.025 * k for k in range(45))
"""Hover thrusts whose climb is predicted, 0.5 to 1.6 of the configured weight [-]: more than
``vehicle.hover_range`` on either side; between two of them the climb is nearly linear."""
STEP_S = 0.01
"""Longest integration step of these climbs [s]: the mean lift of a step is off by (h/τ)²/12 of its
change, 0.3 % at a lag of 50 ms."""
LEG_TRAVEL_M = 0.015
"""Largest travel of springing landing legs, and so the least height of a flying vehicle [m]: legs
of rubber or foam spring back by some millimetres."""
WANDERING_M = 0.35
"""Least height of a flying vehicle whose poses have a velocity [m].

An autopilot's own estimate rises before the vehicle does: its accelerometers measure the thrust
while the vehicle is still on the floor. Half and double: a vehicle that its floor releases late
rises by 0.35 m and 0.80 m, not 0.44 m (`groundstation-sim dev faults paper --fault "late floor: own
estimate" --state start`).
"""
CLIMBING = 1.1
"""Thrust from the first motion until the vehicle counts as flying, as a share of the estimated
hover thrust [-]; where the hover thrust was measured, it is also the limit of the thrust before.
0.1 g lifts it by ``LEG_TRAVEL_M`` in 0.18 s, and by ``WANDERING_M`` in 0.85 s, well within
:attr:`LiftOff.patience_s`."""
RUSHES_M_S = 1.0
"""Climb speed from which that thrust is the hover thrust only [m/s]: the floor of ArduPilot's SITL
releases a vehicle late, which is this fast then. 0.1 g gives it only after 1 s and 0.5 m, where it
has long been flying."""
LEAST_NOISE_M = 0.0003
"""Least noise that a height is given, 1σ [m], as of a tracker: legs and floor yield as thrust
relieves them."""
LEAST_WANDER_M2_S = 1e-6
"""Least random walk of a height [m²/s]: 1 mm in 1 s. Twelve differences at rest may show less than
they have."""
SPEED_NOISE_M_S = 0.05
"""Noise of a pose's velocity, 1σ [m/s]: more than a GPS receiver's 0.02, as vibration comes on
top."""
AGREE_S = 0.1
"""Time after which a hover thrust must still predict the motion [s]: five poses at 50 Hz."""
FITS_M = 0.02
"""Largest distance of a flying vehicle's height from that prediction, and least one above the climb
of the lightest vehicle that is a jump, noise apart [m]: little more than ``LEG_TRAVEL_M``, by which
springing legs lift it."""
MOVING = 2.5
"""Least motion that counts as such [standard deviations]: one in 160 poses at rest shows it, and
sets the thrust near hover for that moment."""
JUMPS = 2
"""Poses in a row that show what no thrust explains, and so end the take-off [-]: a single one may
be an outlier."""
PATIENCE_S = 0.25
"""Time granted between first motion and flight, beside that of a slow climb to the flying height
[s]: two lags of the slowest rotors (0.11 s), as thrust falls to ``CLIMBING`` meanwhile."""
SLOW_CLIMB = 1.0 / 16.0
"""Acceleration of that slow climb, as a share of gravity [-]: less than the 0.1 that ``CLIMBING``
gives, as the hover thrust may be estimated 3 % too low."""


class StandingWander(NamedTuple):
    """Random walks of the positions of a vehicle at rest: growth of their variances."""

    aside_m2_s: float
    """Walk of the horizontal position, on the worse axis [m²/s]."""
    height_m2_s: float
    """Walk of the height [m²/s]."""


def find_least_height(*, has_velocity: bool) -> float:
    """Return the least height of a flying vehicle [m].

    ``has_velocity``: whether its poses have a velocity.
    """
    return WANDERING_M if has_velocity else LEG_TRAVEL_M


class StandingPoses:
    """Poses of a vehicle at rest, and their wander."""

    def __init__(self) -> None:
        self.poses: deque[Pose] = deque(maxlen=REST_POSES)
        """Newest poses at rest."""
        self._spans: deque[Pose] = deque(maxlen=WANDERS + 1)
        """Poses ``WANDER_S`` apart."""

    def add(self, pose: Pose) -> None:
        """Take a pose of the vehicle while its motors can't lift it."""
        # The source has moved its origin.
        moved = bool(self.poses) and self.poses[-1].reset_count != pose.reset_count
        if moved:
            self.poses.clear()
        self.poses.append(pose)
        if moved or not self._spans or pose.time_s - self._spans[-1].time_s >= WANDER_S:
            self._spans.append(pose)

    @property
    def place_ned(self) -> Vec3:
        """Mean position at rest [m]. There must be a pose."""
        axes = zip(*(pose.position_ned for pose in self.poses), strict=True)
        north, east, down = (sum(coordinates) / len(self.poses) for coordinates in axes)
        return north, east, down

    @property
    def wander(self) -> StandingWander:
        """Random walks of the measurements at rest; all 0 before the second pose that counts."""
        spans = self._find_spans_at_rest()
        pairs = [
            (a, b) for a, b in zip(spans, spans[1:], strict=False) if a.reset_count == b.reset_count
        ]
        if not pairs:
            return StandingWander(0.0, 0.0)
        elapsed = spans[-1].time_s - spans[0].time_s
        if len(pairs) < len(spans) - 1:  # from one origin to another nothing has wandered
            elapsed = sum(b.time_s - a.time_s for a, b in pairs)
        axes = zip(*(subtract(b.position_ned, a.position_ned) for a, b in pairs), strict=True)
        north, east, down = (sum(step**2 for step in steps) / elapsed for steps in axes)
        return StandingWander(max(north, east), down)

    def _find_spans_at_rest(self) -> list[Pose]:
        """Return the poses ``WANDER_S`` apart since somebody has moved the vehicle.

        That step is longer than all later ones explain; at least two of them must tell.
        """
        spans = list(self._spans)
        steps_m = [
            math.dist(a.position_ned, b.position_ned) if a.reset_count == b.reset_count else 0.0
            for a, b in zip(spans, spans[1:], strict=False)
        ]
        for k in range(len(steps_m) - 3, -1, -1):
            later_m = steps_m[k + 1 :]
            usual_m = math.sqrt(sum(step_m**2 for step_m in later_m) / len(later_m))
            if steps_m[k] > STEP_M + SIGNIFICANT * usual_m:
                return spans[k + 1 :]
        return spans

    def find_leap(
        self, before: Pose, pose: Pose, light_s: float, noise_m: float
    ) -> Sentence | None:
        """Return the fault of a step between two poses that is too long for a vehicle on its floor.

        None without one.

        ``light_s`` is as in :meth:`find_disturbance`, ``noise_m`` the white noise of the poses, 1σ
        [m].
        """
        elapsed = pose.time_s - before.time_s
        if pose.reset_count != before.reset_count or elapsed <= 0.0:
            return None  # not comparable
        step = math.dist(pose.position_ned[:2], before.position_ned[:2])
        chance = SIGNIFICANT * math.sqrt(2.0 * noise_m * noise_m + self.wander.aside_m2_s * elapsed)
        if step <= STEP_M + chance + WIND_M_S2 * light_s * elapsed:
            return None
        return notice("takeoff.leaps", step_m=step)

    def find_disturbance(self, pose: Pose, place_ned: Vec3, light_s: float) -> Sentence | None:
        """Return the fault of a vehicle that tips over or slides on the floor; None without one.

        Args:
            pose: its newest pose.
            place_ned: its place at rest [m].
            light_s: time since thrust relieves the floor so much that wind may move the vehicle
                [s].
        """
        at_rest = self.poses[-1]
        if pose.reset_count != at_rest.reset_count:
            return None  # not comparable
        (x, y, z), (u, v, w) = third_column(at_rest.attitude), third_column(pose.attitude)
        tilt = angle_deg(x * u + y * v + z * w)
        if not tilt <= TIPPED_DEG:
            return notice("takeoff.tips", tilt_deg=tilt, limit_deg=TIPPED_DEG)
        aside = math.dist(pose.position_ned[:2], place_ned[:2])
        # The wander of 1 s: a spool-up takes about so long.
        limit = (
            SLIPPED_M
            + SIGNIFICANT * math.sqrt(self.wander.aside_m2_s)
            + 0.5 * WIND_M_S2 * light_s * light_s
        )
        if not aside <= limit:
            return notice("takeoff.slides", aside_m=aside, limit_m=limit)
        return None


class SpringingLegs:
    """Position of a vehicle that stands on springing legs or on a soft floor, as a line over its
    thrust: thrust relieves them, and they lift it long before it flies.
    """

    def __init__(self) -> None:
        self._count, self._thrust_n, self._down_m = 0, 0.0, 0.0
        """Number of poses, and the means of thrust and position."""
        self._square_n2 = self._product_nm = 0.0
        """Sums of the thrust's squares, and of its products with the position, from these means."""

    def add(self, thrust_n: float, down_m: float) -> None:
        """Take the position ``down_m`` [m, NED] of a standing vehicle that gives ``thrust_n``
        [N].
        """
        self._count += 1
        more_n, lower_m = thrust_n - self._thrust_n, down_m - self._down_m
        self._thrust_n += more_n / self._count
        self._down_m += lower_m / self._count
        self._square_n2 += more_n * (thrust_n - self._thrust_n)
        self._product_nm += more_n * (down_m - self._down_m)

    @property
    def rise_m_per_n(self) -> float:
        """Rise for thrust [m/N]; below 0 where noise or wander lets it sink."""
        return -self._product_nm / self._square_n2 if self._square_n2 > 0.0 else 0.0

    @property
    def unrelieved_down_m(self) -> float:
        """Position without thrust [m, NED]."""
        return self._down_m + self.rise_m_per_n * self._thrust_n


class PredictedClimbs:
    """Climbs by the commands so far, one for each hover thrust of ``SHARES``.

    Until thrust exceeds its hover thrust s W a vehicle stands on the floor; then it rises by
    p¨ = g (T / (s W) - 1), where T follows the commands by its lag. So height and speed are the
    less, the larger s is.
    """

    def __init__(self, begun_s: float, weight_n: float, lag_s: float, gravity: float) -> None:
        """Begin on the floor at ``begun_s`` [s].

        Configured weight [N], time constant of the thrust [s], g [m/s²].
        """
        self.time_s, self.gravity, self.weight_n = begun_s, gravity, weight_n
        self._lag = lag_s
        self.heights_m, self.speeds_m_s = [0.0] * len(SHARES), [0.0] * len(SHARES)
        """Height above the floor and climb speed for each share, at ``time_s``."""
        self._thrust: float | None = None
        self._commands: deque[tuple[float, float]] = deque()

    @property
    def thrust_n(self) -> float:
        """Modelled thrust at ``time_s`` [N]."""
        return self._thrust or 0.0

    def add_command(self, acting_s: float, thrust_n: float) -> None:
        """Take the command ``thrust_n`` [N], which acts from ``acting_s`` on."""
        self._commands.append((acting_s, thrust_n))

    def advance(self, until_s: float) -> None:
        """Integrate all climbs until ``until_s``; a step ends where a command begins."""
        commands, g = self._commands, self.gravity
        while self.time_s < until_s - ROUNDING_S:
            while len(commands) > 1 and commands[1][0] <= self.time_s + ROUNDING_S:
                commands.popleft()
            h = min(until_s - self.time_s, STEP_S)
            if len(commands) > 1:
                h = min(h, commands[1][0] - self.time_s)
            acts = bool(commands) and commands[0][0] <= self.time_s + ROUNDING_S
            target = commands[0][1] if acts else 0.0
            before = target if self._thrust is None else self._thrust
            keep = math.exp(-h / self._lag) if self._lag > 0.0 else 0.0
            self._thrust = target + (before - target) * keep
            lift = 0.5 * (before + self._thrust) / self.weight_n
            for k, share in enumerate(SHARES):
                a, v = g * (lift / share - 1.0), self.speeds_m_s[k]
                height = self.heights_m[k] + h * (v + 0.5 * h * a)
                self.heights_m[k], self.speeds_m_s[k] = (
                    (0.0, 0.0) if height <= 0.0 else (height, v + h * a)
                )
            self.time_s += h


def _find_share(moved: float, predicted: Sequence[float]) -> float:
    """Return the hover share by which thrust so far has ``moved`` the vehicle.

    The largest one where no thrust explains a motion yet. ``predicted``: the same motion for each
    of ``SHARES``.
    """
    for k in range(1, len(SHARES)):
        above, below = predicted[k - 1], predicted[k]
        if below < moved and below < above:
            x = max((above - moved) / (above - below), 0.0)
            return SHARES[k - 1] + x * (SHARES[k] - SHARES[k - 1])
    return SHARES[-1]


def _interpolate(share: float, values: Sequence[float]) -> float:
    """Return the value for a hover ``share``; ``values`` are those of ``SHARES``."""
    x = (share - SHARES[0]) / (SHARES[1] - SHARES[0])
    k = min(int(x), len(SHARES) - 2)
    return values[k] + (x - k) * (values[k + 1] - values[k])


class LiftOff:
    """Hover thrust and climb of a vehicle that leaves the floor, by the motion that its poses show.

    The measured height gives the hover thrust: the one of :class:`PredictedClimbs` by which thrust
    so far explains it. In an autopilot's own estimate, whose height wanders, the measured speed
    gives it. The vehicle flies if it is higher than noise, wander and legs explain, and moves as
    the hover thrust of a moment before predicts.

    Times are on the event loop's clock [s], heights are above the place at rest [m].
    """

    def __init__(
        self,
        standing: StandingPoses,
        legs: SpringingLegs,
        climbs: PredictedClimbs,
        noise_m: float,
    ) -> None:
        """Begin with the vehicle at rest.

        Args:
            standing: its poses at rest.
            legs: how thrust so far has lifted it there.
            climbs: what the commands so far predict.
            noise_m: white noise of its poses, 1σ [m].
        """
        at_rest, wander = standing.poses[-1], standing.wander
        self._climbs, self._floor = climbs, standing.place_ned[2]
        self.has_velocity = at_rest.velocity_ned is not None
        """Whether the poses have a velocity, as an autopilot's own estimate does."""
        self.hover_share = SHARES[-1]
        """Hover thrust by the newest pose, as a share of the configured weight [-]; the largest one
        while the vehicle is on the floor."""
        self.climb_m_s = 0.0
        """Climb speed at the newest pose [m/s]: the pose's own, or else that by its height."""
        self.is_flying = False
        """Whether the vehicle has left the floor, and is not too light to fly by the controller."""
        self._rest_m_s = 0.0 if at_rest.velocity_ned is None else -at_rest.velocity_ned[2]
        self._wander_m2_s = max(wander.height_m2_s, LEAST_WANDER_M2_S)
        self._noise_m2 = max(noise_m, LEAST_NOISE_M) ** 2
        self._legs_m_per_n = self._find_legs(legs, wander)
        """Rise by springing legs for thrust [m/N]."""
        if self._legs_m_per_n > 0.0:
            self._floor = legs.unrelieved_down_m
        self._height_m = self._chance_m = 0.0
        """Height of the newest pose, and what noise and wander explain of it, 1σ [m]."""
        self._moved = self._chance = 0.0
        """Motion that gives the hover thrust, and its error, 1σ: height [m], or speed [m/s]."""
        self._resets, self._begun_s = at_rest.reset_count, at_rest.time_s
        self._found: deque[tuple[float, float]] = deque()
        """Instants [s] and hover shares [-] of the poses of ``AGREE_S``."""
        self._jumps = self._light_poses = 0

    def _find_legs(self, legs: SpringingLegs, wander: StandingWander) -> float:
        """Return how far ``legs`` lift the vehicle for thrust [m/N]; 0 without springing ones.

        They count if they have lifted it by more than noise and wander explain when thrust is
        ``SURE_SHARE``.
        """
        sure_n = SURE_SHARE * self._climbs.weight_n
        rise_m = legs.rise_m_per_n * sure_n
        # Two poses differ by their noise, too. The wander of 1 s: a spool-up takes about so long.
        wander_m2 = max(wander.height_m2_s - 2.0 * self._noise_m2 / WANDER_S, 0.0)
        chance_m = math.sqrt(self._noise_m2 + wander_m2)
        if self.has_velocity or rise_m <= MOVING * chance_m:
            return 0.0
        return min(rise_m, LEG_TRAVEL_M) / sure_n

    def add_pose(self, pose: Pose) -> None:
        """Take one more pose."""
        climbs = self._climbs
        if pose.time_s <= climbs.time_s:
            return
        climbs.advance(pose.time_s)
        if pose.reset_count != self._resets:  # the source has moved its origin, not the vehicle
            self._resets = pose.reset_count
            self._floor = pose.position_ned[2] + self._height_m + self._legs_m
            if pose.velocity_ned is not None:
                self._rest_m_s = -pose.velocity_ned[2] - self._moved
            return
        self._measure(pose)
        predicted = climbs.speeds_m_s if self.has_velocity else climbs.heights_m
        self.hover_share = _find_share(self._moved, predicted)
        if not self.has_velocity:
            self.climb_m_s = _interpolate(self.hover_share, climbs.speeds_m_s)
        is_predicted = self._is_as_predicted(pose.time_s, predicted)
        chance_m = SIGNIFICANT * self._chance_m
        least_m = WANDERING_M if self.has_velocity else LEG_TRAVEL_M + chance_m
        is_off = self.is_moving and self._height_m > least_m
        is_light = is_off and self.hover_share <= SURE_SHARE
        self._light_poses = self._light_poses + 1 if is_light else 0
        self.is_flying = is_off and is_predicted and not is_light
        has_jumped = self._height_m > climbs.heights_m[0] + FITS_M + chance_m
        self._jumps = self._jumps + 1 if has_jumped else 0

    @property
    def _legs_m(self) -> float:
        """Height by springing legs [m]."""
        return self._legs_m_per_n * self._climbs.thrust_n

    def _measure(self, pose: Pose) -> None:
        """Take height and motion of ``pose``."""
        self._height_m = self._floor - pose.position_ned[2] - self._legs_m
        elapsed_s = pose.time_s - self._begun_s
        self._chance_m = math.sqrt(self._noise_m2 + self._wander_m2_s * elapsed_s)
        self._moved, self._chance = self._height_m, self._chance_m
        if pose.velocity_ned is not None:
            self.climb_m_s = -pose.velocity_ned[2]
            self._moved, self._chance = self.climb_m_s - self._rest_m_s, SPEED_NOISE_M_S

    def _is_as_predicted(self, time_s: float, predicted: Sequence[float]) -> bool:
        """Whether the motion is as the hover share of ``AGREE_S`` before predicts."""
        found = self._found
        found.append((time_s, self.hover_share))
        while len(found) > 1 and found[1][0] <= time_s - AGREE_S:
            found.popleft()
        since_s, share = found[0]
        fits = FITS_M / AGREE_S if self.has_velocity else FITS_M
        off = abs(self._moved - _interpolate(share, predicted))
        return since_s <= time_s - AGREE_S and off < fits + SIGNIFICANT * self._chance

    @property
    def has_jumped(self) -> bool:
        """Whether the height jumps as no thrust explains."""
        return self._jumps >= JUMPS

    @property
    def is_too_light(self) -> bool:
        """Whether the vehicle is off the floor, and thrust of ``SURE_SHARE`` lifts it.

        No vehicle that may fly is so light for its thrust. One pose may be an outlier, as with
        ``JUMPS``.
        """
        return self._light_poses >= JUMPS

    @property
    def is_moving(self) -> bool:
        """Whether the poses respond to the thrust: they rise, and thrust explains it."""
        return self._moved > MOVING * self._chance and self.hover_share < SHARES[-1]

    @property
    def patience_s(self) -> float:
        """Longest time from the first motion until flight [s]."""
        least_m = find_least_height(has_velocity=self.has_velocity)
        return PATIENCE_S + math.sqrt(2.0 * least_m / (SLOW_CLIMB * self._climbs.gravity))

    @property
    def climbing_share(self) -> float:
        """Climb thrust until the vehicle counts as flying, as a share of the configured weight
        [-].
        """
        return self.hover_share * (1.0 if self.climb_m_s > RUSHES_M_S else CLIMBING)


SURE_SHARE = 0.6
"""Thrust at the end of ``spool_s``, as a share of the configured weight [-]: it lifts no vehicle
that may fly, as ``vehicle.hover_range`` begins at 0.7."""
NEAR_SHARE = 0.9
"""Thrust from which the vehicle may lift, as a share of the configured weight [-]: ``WATCHED_S``
begins here. A vehicle that is lighter than that moves earlier."""
NEAR_S = 0.1
"""Time in which thrust rises from ``SURE_SHARE`` to ``NEAR_SHARE`` [s]: as quickly as the slowest
rotors follow (a lag of 0.11 s), as friction no longer holds the vehicle against wind."""
WATCHED_S = 0.3
"""Time after ``NEAR_SHARE`` within which the poses must show a motion [s]: a vehicle whose poses
are another body's stays below 0.8 m and 3 m/s by it (docs/explanation/safety.md)."""
RISE_S = 0.5 * WATCHED_S
"""Time in which true thrust rises from ``NEAR_SHARE`` to its limit [s]; the command takes the
rotors' lag less. The other half of ``WATCHED_S`` is left to see a motion. Double, no vehicle that
hovers at 1.15 of its weight lifts off; half, 11 of 12 that hover at 1.25 do, not none (``spooled``
of test_liftoff.py), but without poses of its own a vehicle jumps higher."""
SHORTEST_S = 0.05
"""Least time of that rise in the command, where the lag is longer [s]: two frames of 22 ms, as a
step is no rise."""
CONFIGURED_SHARE = 1.3
"""Limit of the thrust, as a share of the configured weight [-]: one whose poses are another body's
accelerates by 0.3 g at most, and one that needs more does not take off
(docs/explanation/safety.md)."""
LEAST_SHARE = 0.75
"""Least thrust command of a moving vehicle, as a share of the wanted thrust [-], while the rotors
still give more: a vehicle that is lifted less than modelled falls at 0.2 g at most."""
REST_POSES = 50
"""Poses whose mean is the place of a vehicle at rest [-]: the mean has a seventh of their noise."""
WANDER_S = 0.5
"""Time between two poses whose difference measures the wander [s]: about as long as a lift-off
takes, over which the wander counts."""
WANDERS = 12
"""Differences that are kept [-]: 6 s, as the wander of an autopilot's estimate changes; it is known
to 20 % (1σ)."""
TIPPED_DEG = 6.0
"""Largest tilt on the floor from the attitude at rest [deg]: springing legs at one side of a small
vehicle give 6 (``LEG_TRAVEL_M`` over 0.15 m)."""
SLIPPED_M = 0.05
"""Largest horizontal distance on the floor from the place at rest, wander and wind apart [m]: legs
that tip by ``TIPPED_DEG`` move a marker that is 0.3 m high by 3 cm."""
STEP_M = 0.03
"""Largest horizontal distance from one pose to the next, noise and wind apart [m]: poses that
change to another body's jump by more than the size of the smallest vehicle."""
WIND_M_S2 = 5.0
"""Largest horizontal acceleration by wind while thrust relieves the floor [m/s²]: half of g.
Chosen."""
LIGHT_S = 0.2
"""Time before the end of ``spool_s`` at which that wind begins to count [s]: at its default, thrust
is half of the weight then."""


Transit = Annotated[float, msgspec.Meta(ge=0.02, le=20.0)]
"""A speed [m/s] or an acceleration [m/s²] of a transit: a larger one is in centimetres, and with
less a metre takes a minute."""


class TakeoffConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Take-off, and speeds of the transits. Config section ``[takeoff]``."""

    height_m: Annotated[
        float,
        msgspec.Meta(
            ge=0.2,
            le=20.0,
            description="Height above the floor of the hold before and after the trajectory [m].",
        ),
    ] = 1.0
    spool_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.2, le=10.0, description="Time in which thrust rises to 60 % of the weight [s]."
        ),
    ] = 1.0
    thrust_limit: Annotated[
        Annotated[float, msgspec.Meta(ge=1.0, le=2.0)] | None,
        msgspec.Meta(
            description="Largest thrust before lift-off, as a share of the weight [-]. Without it: "
            "1.3, or 1.1 of vehicle.hover_n where that was measured. The larger it is, the higher "
            "a vehicle without true poses jumps."
        ),
    ] = None
    climb_m_s: Annotated[
        float, msgspec.Meta(ge=0.02, le=5.0, description="Largest speed of the climb [m/s].")
    ] = 0.5
    hold_s: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=600.0,
            description="Duration of the hold in which the hover thrust is measured, before the "
            "trajectory [s].",
        ),
    ] = 3.0
    transit_m_s: Annotated[
        Transit,
        msgspec.Meta(
            description="Largest speed of the transits onto the trajectory and back [m/s]; a "
            "trajectory that begins faster is entered at its own speed."
        ),
    ] = 0.5
    transit_m_s2: Annotated[
        Transit,
        msgspec.Meta(
            description="Largest acceleration of these transits and of stopping [m/s²]; of the "
            "climb, too, but there at most 2."
        ),
    ] = 1.0


def usual_limit_n(vehicle: Vehicle, weight_n: float) -> float:
    """Largest thrust before lift-off without ``takeoff.thrust_limit`` [N].

    ``weight_n`` is the configured weight.
    """
    most = CONFIGURED_SHARE * weight_n if vehicle.hover_n is None else CLIMBING * vehicle.hover_n
    return min(most, vehicle.thrust_max_n)


def limit_n(takeoff: TakeoffConfig, vehicle: Vehicle, weight_n: float) -> float:
    """Largest thrust before lift-off [N]; ``weight_n`` is the configured weight."""
    share = takeoff.thrust_limit
    return (
        usual_limit_n(vehicle, weight_n)
        if share is None
        else min(share * weight_n, vehicle.thrust_max_n)
    )


class Spool:
    """Thrust command on the floor as a function of time.

    Times are on the event loop's clock [s].
    """

    def __init__(
        self,
        weight_n: float,
        most_n: float,
        spool_s: float,
        idle_n: float,
        start_s: float,
        lag_s: float,
    ) -> None:
        """Begin at ``start_s`` [s] with ``idle_n`` [N]; no command exceeds ``most_n`` [N].

        ``lag_s`` is the time constant of the thrust [s].
        """
        self.most_n = most_n
        self._rise = max(RISE_S - lag_s, SHORTEST_S)
        self._idle = min(idle_n, most_n)
        self._sure = min(max(SURE_SHARE * weight_n, idle_n), most_n)
        self._near = min(max(NEAR_SHARE * weight_n, self._sure), most_n)
        self._start = start_s
        self.sure_s = start_s + spool_s
        """Instant until which thrust can't lift the vehicle."""
        self.near_s = self.sure_s + NEAR_S
        """Instant from which thrust may lift the vehicle."""

    def thrust_n(self, time_s: float) -> float:
        """Thrust to command at ``time_s`` [N]."""
        if time_s < self.sure_s:
            x = max(time_s - self._start, 0.0) / (self.sure_s - self._start)
            # Smooth at both ends.
            return self._idle + (self._sure - self._idle) * x * x * (3.0 - 2.0 * x)
        if time_s < self.near_s:
            return self._sure + (self._near - self._sure) * (time_s - self.sure_s) / NEAR_S
        return min(
            self._near + (self.most_n - self._near) * (time_s - self.near_s) / self._rise,
            self.most_n,
        )


class SpoolUp:
    """One spool-up: from arming until the vehicle flies or its motors go off again."""

    def __init__(
        self,
        standing: StandingPoses,
        spool: Spool,
        vehicle: Vehicle,
        weight_n: float,
        gravity: float,
        noise_m: float,
    ) -> None:
        """Begin with a vehicle at rest; ``noise_m`` is the white noise of its poses, 1σ [m]."""
        self._standing = standing
        self._spool = spool
        self._vehicle = vehicle
        self._weight = weight_n
        self._noise = noise_m
        self.place_ned = standing.place_ned
        """Place at rest [m], by the source's origin while thrust can't lift the vehicle."""
        self._newest = standing.poses[-1]
        self._leap: Sentence | None = None
        """First fault of two successive poses."""
        self._wander = standing.wander
        """Wander of the poses while the motors could not lift the vehicle."""
        self._risen_poses = 0
        """Number of the newest poses that show the vehicle off the floor, before thrust may lift
        it."""
        self._climbs = PredictedClimbs(self._newest.time_s, weight_n, vehicle.thrust_lag_s, gravity)
        self._legs = SpringingLegs()
        self._lift: LiftOff | None = None
        """Lift-off as the poses show it; None before thrust can lift the vehicle."""
        self._moved_s: float | None = None
        """Time of the first command since the vehicle moves [s]; None while it does not."""

    @property
    def lift_off(self) -> LiftOff | None:
        """Estimated hover thrust and climb, once the vehicle has left the floor; None before."""
        return self._lift if self._lift is not None and self._lift.is_flying else None

    def add_pose(self, pose: Pose) -> None:
        """Take one more pose."""
        light_s = self._light_s(pose.time_s)
        self._leap = self._leap or self._standing.find_leap(
            self._newest, pose, light_s, self._noise
        )
        moved, self._newest = pose.reset_count != self._newest.reset_count, pose
        standing = self._standing
        if self._lift is None and pose.time_s < self._spool.sure_s:
            standing.add(pose)
            if moved:
                self.place_ned, self._legs = standing.place_ned, SpringingLegs()
            self._risen_poses = self._risen_poses + 1 if self._has_risen(pose) else 0
            self._climbs.advance(pose.time_s)
            self._legs.add(self._climbs.thrust_n, pose.position_ned[2])
            return
        if self._lift is None:
            self._lift = LiftOff(standing, self._legs, self._climbs, self._noise)
        self._lift.add_pose(pose)

    def _has_risen(self, pose: Pose) -> bool:
        """Whether ``pose`` is above the floor by more than legs and noise explain."""
        # The wander of 1 s: a spool-up takes about so long.
        variance = 2.0 * self._noise * self._noise + self._wander.height_m2_s
        least_m = find_least_height(has_velocity=pose.velocity_ned is not None)
        height_m = self.place_ned[2] - pose.position_ned[2]
        return height_m > least_m + SIGNIFICANT * math.sqrt(variance)

    def _light_s(self, now_s: float) -> float:
        """Time since thrust relieves the floor so much that wind may move the vehicle [s]."""
        return max(now_s - self._spool.sure_s + LIGHT_S, 0.0)

    def compute_thrust_n(self, now_s: float) -> float:
        """Return the thrust to command now [N]; the predicted climbs count on it."""
        lift, spool = self._lift, self._spool
        thrust = spool.thrust_n(now_s)
        if lift is None or not self._is_moving:
            self._moved_s = None
        else:
            self._moved_s = now_s if self._moved_s is None else self._moved_s
            wanted = lift.climbing_share * self._weight
            # A lead by the rotors' present error: they reach ``wanted`` sooner.
            lead_n = wanted - self._climbs.thrust_n
            thrust = min(max(wanted + lead_n, LEAST_SHARE * wanted), spool.most_n)
        acting_s = now_s + self._vehicle.command_delay_s + self._vehicle.thrust_delay_s
        self._climbs.add_command(acting_s, thrust)
        return thrust

    @property
    def _is_moving(self) -> bool:
        """Whether the vehicle moves.

        An autopilot's own estimate that has moved once counts for good: it may level off while the
        vehicle is still on the floor.
        """
        lift = self._lift
        return lift is not None and (
            lift.is_moving or (lift.has_velocity and self._moved_s is not None)
        )

    def find_fault(
        self, now_s: float, pose: Pose, coast_s: float, fence: Fence | None
    ) -> Sentence | None:
        """Return why the motors must go off, by the newest pose; None if they may stay on."""
        spool, lift = self._spool, self._lift
        if now_s - pose.time_s > coast_s:
            return notice("takeoff.no_pose", age_ms=to_ms(now_s - pose.time_s))
        if fence is not None and fence.room_m(pose.position_ned) < 0.0:
            return notice("takeoff.fence", outside_m=-fence.room_m(pose.position_ned))
        why = self._leap or self._standing.find_disturbance(
            pose, self.place_ned, self._light_s(now_s)
        )
        if why is not None:
            return why
        if lift is not None and lift.has_jumped:
            return notice("takeoff.jumps")
        if self._risen_poses >= JUMPS or (lift is not None and lift.is_too_light):
            return notice("takeoff.too_light", percent=to_percent(SURE_SHARE))
        if not self._is_moving and now_s >= spool.near_s + WATCHED_S:
            percent, age_ms = to_percent(spool.most_n / self._weight), to_ms(now_s - pose.time_s)
            return notice(
                "takeoff.no_motion", thrust_n=spool.most_n, percent=percent, age_ms=age_ms
            )
        if (
            lift is not None
            and self._moved_s is not None
            and now_s - self._moved_s > lift.patience_s
        ):
            return notice("takeoff.stuck")
        return None
