"""Take-off: thrust rises for a moment, and stays on only where the poses answer to it. Sans-IO.

No law flies on the floor, where position does not answer to thrust and adaptation would learn the floor's push as
wind. Whether the poses are this vehicle's, and whether its mass is right, is not known before it moves: so thrust is
raised quickly and not far, and what is not seen to move gets no time to gather energy. :class:`LiftOff` has what is
believed of the poses meanwhile.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import Annotated, NamedTuple, Protocol

import msgspec

from groundstation.core.geometry import Vec3, angle_deg, third_column
from groundstation.core.messages import Pose, Sentence, notice
from groundstation.core.safety.geofence import Fence
from groundstation.core.vehicle import Vehicle

SHARES = tuple(0.5 + 0.05 * k for k in range(23))
"""Hover thrust of the hypotheses, as shares of the told weight [-]."""
SPREAD = 0.2
"""How well a told weight, and the thrust that lifts it, are known, 1σ [-]."""
STEP_S = 0.01
"""Longest step of the hypotheses [s]."""
MOVES = math.log(20.0)
"""Logarithm of the odds from which on it moves [-]: 20 to 1."""
FLIES = math.log(10_000.0)
"""Logarithm of the odds from which on it flies [-]: 10,000 to 1."""
HEIGHT_M = 0.015
"""Least height of a vehicle that flies [m]: legs spring by less."""
WANDERING_M = 0.35
"""The same where poses come with a velocity [m]: an autopilot's accelerometers feel a lift before the floor lets go."""
CLIMBING = 1.1
"""Thrust until then, as a share of what seems to hover [-]."""
RUSHES_M_S = 1.0
"""No more than what hovers is told once it climbs so fast [m/s]: a floor that held it has let go of it late."""
LEAST_NOISE_M = 0.0003
"""No pose is believed to less [m]: legs and floor give way as thrust relieves them."""
LEAST_M2_S = 1e-6
"""Least wander of a height [m²/s]: 1 mm in 1 s."""
LEAST_FELT_M2_S = 2.5e-5
"""The same where poses come with a velocity [m²/s]: 5 mm in 1 s."""
SPEED_NOISE_M_S = 0.05
"""Noise of such a velocity, 1 sigma [m/s]."""
LEAST_M2_S3 = 1e-4
"""Least wander of such a velocity [m²/s³]: 1 cm/s in 1 s."""
FITS_M = 0.02
"""Nothing flies whose newest height is farther than this, beside noise, from where the thrust would have it [m]."""
JUMP_M = 0.1
"""Distance of a height from every hypothesis that no vehicle on its floor has [m]."""
JUMPS = 2
"""Poses in a row at such a distance that end the take-off [-]: one may be an outlier."""


class StandingWander(NamedTuple):
    """How what is measured of a vehicle that stands wanders, as the variance of random walks."""

    aside_m2_s: float
    """Of its place sideways, on the worse axis [m²/s]."""
    height_m2_s: float
    """Of its height [m²/s]."""
    climb_m2_s3: float
    """Of its speed upwards [m²/s³]."""


class _Walks:
    """A measurement less what each hypothesis says, as a random walk and white noise: what is the walk?"""

    def __init__(self, count: int, walk: float, noise: float) -> None:
        """Variance of the ``walk`` per second, and of the ``noise``."""
        self._walk, self._noise = walk, noise
        self._variance = noise
        self._values = [0.0] * count

    def update(self, elapsed_s: float, off: list[float]) -> tuple[list[float], float]:
        """Take one more, ``elapsed_s`` after the last [s]; returns steps from what was expected, and their variance."""
        variance = self._variance + self._walk * elapsed_s
        total = variance + self._noise
        gain = variance / total
        self._variance = (1.0 - gain) * variance
        steps = [one - value for one, value in zip(off, self._values, strict=True)]
        self._values = [value + gain * step for value, step in zip(self._values, steps, strict=True)]
        return steps, total

    def begin(self, off: list[float]) -> None:
        """The measurement has moved its zero."""
        self._values = off


class LiftOff:
    """What thrust must do to a vehicle of this weight, held against what the poses show: has it left the floor?

    One hypothesis says that it stands, the others that it rises as the thrust told so far makes a vehicle rise which
    hovers at 0.5, 0.55, ... 1.6 of the told weight: p¨ = g (T / (s W) - 1), never below the floor, T behind what was
    told by its lag. Under each, what is left of the measured height is a random walk (as much as was measured before
    arming) and white noise, and a filter of one state gives its likelihood. So thrust near the weight, height above its
    own wander and an acceleration that fits are one number: the logarithm of the odds that it flies. The hypotheses
    together also tell what thrust hovers and how fast it climbs, before any law needs to know.

    Times are on the event loop's clock [s], heights are above where it stood [m].
    """

    def __init__(
        self,
        stands: Pose,
        down_m: float,
        weight_n: float,
        lag_s: float,
        gravity: float,
        wander: StandingWander,
        noise_m: float,
    ) -> None:
        """Begin with a vehicle that ``stands``, at ``down_m`` [m, NED] on the mean; thrust lags by ``lag_s`` [s].

        ``noise_m`` is the poses' white noise [m].
        """
        self._floor, self._weight, self._lag, self._gravity = down_m, weight_n, lag_s, gravity
        self.felt = felt = stands.velocity_ned is not None
        """Whether the poses come with a velocity, as an autopilot's own estimate does."""
        self._height_m = 0.0
        self._climb: float | None = None
        self._least_m = WANDERING_M if felt else HEIGHT_M
        self._resets = stands.reset_count
        self._at = stands.time_s
        self._thrust: float | None = None
        self._told: deque[tuple[float, float]] = deque()
        n = len(SHARES)
        self._paths, self._speeds = [0.0] * n, [0.0] * n
        # The last hypothesis is that it stands.
        least_m2_s = LEAST_FELT_M2_S if felt else LEAST_M2_S
        self._height = _Walks(n + 1, max(wander.height_m2_s, least_m2_s), max(noise_m, LEAST_NOISE_M) ** 2)
        self._speed = _Walks(n + 1, max(wander.climb_m2_s3, LEAST_M2_S3), SPEED_NOISE_M_S**2)
        self._stood_m_s = 0.0 if stands.velocity_ned is None else -stands.velocity_ned[2]
        prior = [math.exp(-0.5 * ((s - 1.0) / SPREAD) ** 2) for s in SHARES]
        self._logs = [math.log(p / sum(prior)) for p in prior] + [0.0]
        self._fits = False
        self._jumps = 0

    def add_command(self, acting_s: float, thrust_n: float) -> None:
        """``thrust_n`` [N] is told from ``acting_s`` on."""
        self._told.append((acting_s, thrust_n))

    def pose(self, pose: Pose) -> None:
        """Take one more pose."""
        elapsed = pose.time_s - self._at
        if elapsed <= 0.0:
            return
        self._advance(pose.time_s)
        height = self._height_m = self._floor - pose.position_ned[2]
        off = [height - path for path in (*self._paths, 0.0)]
        if pose.reset_count != self._resets:  # the source has moved its origin, not the vehicle
            self._resets = pose.reset_count
            self._height.begin(off)
            return
        steps, variance = self._height.update(elapsed, off)
        self._weigh(steps, variance)
        spread = 4.0 * math.sqrt(variance)
        self._fits = abs(self._mean(steps[:-1])) < FITS_M + spread
        self._jumps = self._jumps + 1 if min(map(abs, steps)) > JUMP_M + spread else 0
        if pose.velocity_ned is not None:
            self._climb = -pose.velocity_ned[2]
            gained = self._climb - self._stood_m_s
            self._weigh(*self._speed.update(elapsed, [gained - speed for speed in (*self._speeds, 0.0)]))

    def _weigh(self, steps: list[float], variance: float) -> None:
        self._logs = [log - 0.5 * step * step / variance for log, step in zip(self._logs, steps, strict=True)]

    @property
    def jumps(self) -> bool:
        """Whether its height does what no thrust explains."""
        return self._jumps >= JUMPS

    @property
    def moves(self) -> bool:
        """Whether something answers to the thrust."""
        return self._odds > MOVES

    @property
    def flies(self) -> bool:
        """Whether it has left the floor."""
        return self._odds > FLIES and self._fits and self._mean(self._paths) > self._least_m

    @property
    def climbs(self) -> bool:
        """Whether it is seen in the air, all odds for it, though where thrust would have it is still too low for that.

        Of poses that come with a velocity alone: what wanders there may have told the hover thrust a little wrong.
        """
        return self.felt and self._odds > FLIES and self._fits and self._height_m > self._least_m

    @property
    def patience_s(self) -> float:
        """How long after it began to move it must fly [s]."""
        return 0.25 + 2.0 * math.sqrt(2.0 * self._least_m / (0.25 * self._gravity))

    @property
    def hover_share(self) -> float:
        """The thrust that seems to hover, as a share of the weight [-]."""
        return self._mean(SHARES)

    @property
    def climbing_share(self) -> float:
        """The thrust that it is to climb with until it is known to fly, as a share of the weight [-]."""
        return self.hover_share * (1.0 if self.climb_m_s > RUSHES_M_S else CLIMBING)

    @property
    def climb_m_s(self) -> float:
        """How fast it climbs at the newest pose, as that says or else as the hypotheses have it [m/s]."""
        return self._mean(self._speeds) if self._climb is None else self._climb

    @property
    def thrust_n(self) -> float:
        """What the rotors gave at the newest pose, by their lag [N]."""
        return self._thrust or 0.0

    @property
    def _odds(self) -> float:
        best = max(self._logs[:-1])
        return best + math.log(sum(math.exp(log - best) for log in self._logs[:-1])) - self._logs[-1]

    def _mean(self, values: Sequence[float]) -> float:
        """Over the hypotheses that it rises."""
        best = max(self._logs[:-1])
        weights = [math.exp(log - best) for log in self._logs[:-1]]
        return sum(w * value for w, value in zip(weights, values, strict=True)) / sum(weights)

    def _advance(self, until_s: float) -> None:
        """Let every hypothesis rise until then."""
        told, g = self._told, self._gravity
        while self._at < until_s - 1e-9:
            while len(told) > 1 and told[1][0] <= self._at + 1e-9:
                told.popleft()
            h = min(until_s - self._at, STEP_S)
            if len(told) > 1:
                h = min(h, max(told[1][0] - self._at, 1e-6))
            target = told[0][1] if told and told[0][0] <= self._at + 1e-9 else 0.0
            before = target if self._thrust is None else self._thrust
            keep = math.exp(-h / self._lag) if self._lag > 0.0 else 0.0
            self._thrust = target + (before - target) * keep
            lift = 0.5 * (before + self._thrust) / self._weight
            for k, share in enumerate(SHARES):
                a, v = g * (lift / share - 1.0), self._speeds[k]
                height = self._paths[k] + h * (v + 0.5 * h * a)
                rests = height <= 0.0
                self._paths[k], self._speeds[k] = (0.0, 0.0) if rests else (height, v + h * a)
            self._at += h


SURE_SHARE = 0.6
"""Share of the weight that thrust reaches within ``spool_s``, and that lifts nothing [-]."""
NEAR_SHARE = 0.9
"""From this share of the weight on it may lift [-]: from here time is counted."""
NEAR_S = 0.1
"""How long thrust rises from the first share to the second [s]."""
RISE_S = 0.15
"""Time in which the rotors come from there to the limit [s]; what is told is earlier by their lag."""
SHORTEST_S = 0.05
"""Shortest such time that is told [s]."""
WATCHED_S = 0.3
"""Time after ``NEAR_SHARE`` within which something must move [s]."""
TOLD_SHARE = 1.3
"""Largest thrust, as a share of the weight as configured [-]."""
MEASURED_SHARE = 1.1
"""Largest thrust, as a share of the hover thrust as measured [-]."""
LEAST_SHARE = 0.75
"""Least thrust, as a share of the wanted one, while the rotors of a vehicle that moves still give too much [-]."""
REST_POSES = 50
"""Poses whose mean is the place of a vehicle that stands [-]."""
WANDER_S = 0.5
"""Length of one span over which its place wanders [s]."""
WANDERS = 12
"""Spans that are kept [-]."""
TIPPED_DEG = 6.0
"""Largest lean on the floor from how it stood [deg]."""
SLIPPED_M = 0.05
"""Largest way aside on the floor, beside wander and wind [m]."""
STEP_M = 0.03
"""Largest way aside from one pose to the next, beside noise and wind [m]: another body is a vehicle's size away."""
WIND_M_S2 = 5.0
"""Acceleration aside by wind that is granted as thrust takes the weight from the floor [m/s²]."""
LIGHT_S = 0.2
"""Time before ``SURE_SHARE`` from which on that wind is granted [s]."""


class TakeoffConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the vehicle leaves the floor. Config section ``[takeoff]``."""

    height_m: Annotated[
        float,
        msgspec.Meta(
            ge=0.2, le=20.0, description="Height above the floor at which it holds before and after the trajectory [m]."
        ),
    ] = 1.0
    spool_s: Annotated[
        float,
        msgspec.Meta(ge=0.2, le=10.0, description="Time in which the rotors are brought up to 60 % of the weight [s]."),
    ] = 1.0
    thrust_limit: Annotated[
        Annotated[float, msgspec.Meta(ge=1.0, le=2.0)] | None,
        msgspec.Meta(
            description="Largest thrust before it has left the floor, as a share of its weight [-]. "
            "Without it: 1.3, or 1.1 of vehicle.hover_n where that was measured; a "
            "larger one lets a vehicle that is not seen jump higher."
        ),
    ] = None
    climb_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=5.0, description="Fastest speed of the climb [m/s].")] = 0.5
    hold_s: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=600.0,
            description="How long it holds, measuring its hover thrust, before it goes on to the trajectory [s].",
        ),
    ] = 3.0
    transit_m_s: Annotated[
        float,
        msgspec.Meta(
            gt=0.0,
            le=20.0,
            description="Fastest speed of the ways onto the trajectory and back [m/s]; where it "
            "begins faster, it is met at its own.",
        ),
    ] = 0.5
    transit_m_s2: Annotated[
        float,
        msgspec.Meta(
            gt=0.0,
            le=20.0,
            description="Largest acceleration of these ways, of stopping, and up to 2 of the climb [m/s²].",
        ),
    ] = 1.0


class ThrustLimitConfig(Protocol):
    """What the limit of the thrust rests on; see :class:`groundstation.settings.settings.Config`."""

    @property
    def takeoff(self) -> TakeoffConfig:
        """How it takes off."""
        ...

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle as told."""
        ...

    @property
    def weight_n(self) -> float:
        """Its weight as told [N]."""
        ...


def usual_limit_n(told: ThrustLimitConfig) -> float:
    """The largest thrust [N] before the floor is left, where ``takeoff.thrust_limit`` does not say more."""
    vehicle = told.vehicle
    most = TOLD_SHARE * told.weight_n if vehicle.hover_n is None else MEASURED_SHARE * vehicle.hover_n
    return min(most, vehicle.thrust_max_n)


def limit_n(told: ThrustLimitConfig) -> float:
    """The largest thrust [N] before the floor is left."""
    share = told.takeoff.thrust_limit
    return usual_limit_n(told) if share is None else min(share * told.weight_n, told.vehicle.thrust_max_n)


class Spool:
    """Thrust on the floor as a function of time. Times are on the event loop's clock [s]."""

    def __init__(
        self, weight_n: float, most_n: float, spool_s: float, idle_n: float, start_s: float, lag_s: float
    ) -> None:
        """Begin at ``start_s`` [s] with ``idle_n`` [N]; thrust is never told to be above ``most_n`` [N].

        ``lag_s`` is how far thrust lags behind what is told [s].
        """
        self.most_n = most_n
        self._rise = max(RISE_S - lag_s, SHORTEST_S)
        self._idle = min(idle_n, most_n)
        self._sure = min(max(SURE_SHARE * weight_n, idle_n), most_n)
        self._near = min(max(NEAR_SHARE * weight_n, self._sure), most_n)
        self._start = start_s
        self.sure_s = start_s + spool_s
        """Until then thrust lifts nothing."""
        self.near_s = self.sure_s + NEAR_S
        """From then on it may."""

    def thrust_n(self, time_s: float) -> float:
        """Thrust to command at ``time_s`` [N]."""
        if time_s < self.sure_s:
            x = max(time_s - self._start, 0.0) / (self.sure_s - self._start)
            return self._idle + (self._sure - self._idle) * x * x * (3.0 - 2.0 * x)
        if time_s < self.near_s:
            return self._sure + (self._near - self._sure) * (time_s - self.sure_s) / NEAR_S
        return min(self._near + (self.most_n - self._near) * (time_s - self.near_s) / self._rise, self.most_n)


class StandingPoses:
    """Poses of a vehicle that stands, and how far they wander."""

    def __init__(self) -> None:
        self.poses: deque[Pose] = deque(maxlen=REST_POSES)
        """The newest of them."""
        self._spans: deque[Pose] = deque(maxlen=WANDERS + 1)

    def stands(self, pose: Pose) -> None:
        """Take a pose of a vehicle whose motors don't lift."""
        moved = bool(self.poses) and self.poses[-1].reset_count != pose.reset_count  # the source has moved its origin
        if moved:
            self.poses.clear()
        self.poses.append(pose)
        if moved or not self._spans or pose.time_s - self._spans[-1].time_s >= WANDER_S:
            self._spans.append(pose)

    @property
    def place_ned(self) -> Vec3:
        """Where it stands [m]. Needs a pose."""
        n = len(self.poses)
        north, east, down = (sum(pose.position_ned[axis] for pose in self.poses) / n for axis in range(3))
        return north, east, down

    @property
    def wander(self) -> StandingWander:
        """How what is measured of it wanders."""
        spans = list(self._spans)
        pairs = [(a, b) for a, b in zip(spans, spans[1:], strict=False) if a.reset_count == b.reset_count]
        if not pairs:
            return StandingWander(0.0, 0.0, 0.0)
        elapsed = spans[-1].time_s - spans[0].time_s
        if len(pairs) < len(spans) - 1:  # from one origin to another nothing has wandered
            elapsed = sum(b.time_s - a.time_s for a, b in pairs)
        north, east, down = (
            sum((b.position_ned[axis] - a.position_ned[axis]) ** 2 for a, b in pairs) / elapsed for axis in range(3)
        )
        climbs = [b.velocity_ned[2] - a.velocity_ned[2] for a, b in pairs if a.velocity_ned and b.velocity_ned]
        return StandingWander(max(north, east), down, sum(climb * climb for climb in climbs) / elapsed)

    def leaps(self, before: Pose, pose: Pose, light_s: float, noise_m: float) -> Sentence | None:
        """Find what the step from one pose to the next shows that no vehicle on its floor does; None for nothing.

        ``light_s`` is as below, ``noise_m`` the white noise of its poses [m].
        """
        elapsed = pose.time_s - before.time_s
        if pose.reset_count != before.reset_count or elapsed <= 0.0:
            return None  # not comparable
        step = math.dist(pose.position_ned[:2], before.position_ned[:2])
        wanders = 4.0 * math.sqrt(2.0 * noise_m * noise_m + self.wander.aside_m2_s * elapsed)
        if step <= STEP_M + wanders + WIND_M_S2 * light_s * elapsed:
            return None
        return notice("takeoff.leaps", step_m=step)

    def find_disturbance(self, pose: Pose, place_ned: Vec3, light_s: float) -> Sentence | None:
        """Find what ``pose`` shows that no vehicle on its floor does; it stood at ``place_ned`` [m]. None for nothing.

        ``light_s`` is for how long thrust has taken so much of its weight that wind may move it [s].
        """
        stood = self.poses[-1]
        if pose.reset_count != stood.reset_count:
            return None  # not comparable
        (x, y, z), (u, v, w) = third_column(stood.attitude), third_column(pose.attitude)
        tilt = angle_deg(x * u + y * v + z * w)
        if not tilt <= TIPPED_DEG:
            return notice("takeoff.tips", tilt_deg=tilt, limit_deg=TIPPED_DEG)
        aside = math.dist(pose.position_ned[:2], place_ned[:2])
        limit = SLIPPED_M + 4.0 * math.sqrt(self.wander.aside_m2_s) + 0.5 * WIND_M_S2 * light_s * light_s
        if not aside <= limit:
            return notice("takeoff.slides", aside_m=aside, limit_m=limit)
        return None


class SpoolUp:
    """One vehicle's spool-up, from arming until it flies or its motors go off again."""

    def __init__(
        self,
        standing: StandingPoses,
        spool: Spool,
        vehicle: Vehicle,
        weight_n: float,
        gravity: float,
        noise_m: float,
    ) -> None:
        """Begin with a vehicle that stands; ``noise_m`` is its poses' white noise [m]."""
        self._standing = standing
        self._spool = spool
        self._vehicle = vehicle
        self._weight = weight_n
        self._gravity = gravity
        self._noise = noise_m
        self.place_ned = standing.place_ned
        """Where it stood [m]."""
        self._newest = standing.poses[-1]
        self._leaps: Sentence | None = None
        self._lift: LiftOff | None = None
        self._moved_s: float | None = None
        self._climbs = False
        """Whether it was seen in the air as patience ended."""
        self._told: list[tuple[float, float]] = []
        """What was told before any pose could show that it lifts: from when on [s], thrust [N]."""

    @property
    def flies(self) -> LiftOff | None:
        """What is known of its climb, once it has left the floor."""
        return self._lift if self._lift is not None and (self._lift.flies or self._climbs) else None

    def pose(self, pose: Pose) -> None:
        """Take one more pose."""
        light_s = self._light_s(pose.time_s)
        self._leaps = self._leaps or self._standing.leaps(self._newest, pose, light_s, self._noise)
        moved, self._newest = pose.reset_count != self._newest.reset_count, pose
        if self._lift is not None:
            self._lift.pose(pose)
        elif pose.time_s < self._spool.sure_s:
            self._standing.stands(pose)
            if moved:
                self.place_ned = self._standing.place_ned
        else:
            standing, vehicle = self._standing, self._vehicle
            down, wander, stood = standing.place_ned[2], standing.wander, standing.poses[-1]
            lag = vehicle.thrust_lag_s
            self._lift = LiftOff(stood, down, self._weight, lag, self._gravity, wander, self._noise)
            for acting_s, thrust_n in self._told:
                self._lift.add_command(acting_s, thrust_n)
            self._lift.pose(pose)

    def _light_s(self, now_s: float) -> float:
        """For how long thrust has taken so much of the weight that wind may move the vehicle [s]."""
        return max(now_s - self._spool.sure_s + LIGHT_S, 0.0)

    def thrust_n(self, now_s: float) -> float:
        """Thrust to command now [N]."""
        lift, spool = self._lift, self._spool
        thrust = spool.thrust_n(now_s)
        if lift is not None and self._moves:
            self._moved_s = now_s if self._moved_s is None else self._moved_s
            wanted = lift.climbing_share * self._weight
            thrust = min(max(2.0 * wanted - lift.thrust_n, LEAST_SHARE * wanted), spool.most_n)
        acting_s = now_s + self._vehicle.command_delay_s + self._vehicle.thrust_delay_s
        if lift is None:
            self._told.append((acting_s, thrust))
        else:
            lift.add_command(acting_s, thrust)
        return thrust

    @property
    def _moves(self) -> bool:
        """Whether it is seen to move, or was, by the vehicle's own estimate: a floor may hold what that has felt."""
        lift = self._lift
        return lift is not None and (lift.moves or (lift.felt and self._moved_s is not None))

    def fault(self, now_s: float, pose: Pose, coast_s: float, fence: Fence | None) -> Sentence | None:
        """Why the motors must go off, by the newest pose; None where they need not."""
        spool, lift = self._spool, self._lift
        if now_s - pose.time_s > coast_s:
            return notice("takeoff.no_pose", age_ms=1e3 * (now_s - pose.time_s))
        if fence is not None and fence.room_m(pose.position_ned) < 0.0:
            return notice("takeoff.fence", outside_m=-fence.room_m(pose.position_ned))
        why = self._leaps or self._standing.find_disturbance(pose, self.place_ned, self._light_s(now_s))
        if why is not None:
            return why
        if lift is not None and lift.jumps:
            return notice("takeoff.jumps")
        if not self._moves and now_s >= spool.near_s + WATCHED_S:
            percent = 100.0 * spool.most_n / self._weight
            return notice("takeoff.no_motion", thrust_n=spool.most_n, percent=percent)
        if lift is not None and self._moved_s is not None and now_s - self._moved_s > lift.patience_s:
            self._climbs = lift.climbs
            if self._climbs:
                return None  # to stop the motors now would be to let it fall
            return notice("takeoff.stuck")
        return None
