"""Guards: one table of limits that end a flight early, looked at with every command. Sans-IO.

Beyond a limit follows one step of hold → land → failsafe descent. What lasts on after its answer is
answered by the next step, up to the last one of its row: no landing ends an empty battery.
``GUARDS`` is the table; `groundstation check --limits` and docs/reference/guards.md are made from it.
"""

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Annotated, NamedTuple, Protocol

import msgspec

from groundstation.core.geometry import angle_deg, third_column
from groundstation.core.messages import NOTICES, Estimate, Pose, Sentence, notice
from groundstation.core.mission import State
from groundstation.core.safety.geofence import Fence, Near, Separation
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import GRAVITY, Vehicle
from links.core import Command, LinkStatus


class GuardAction(IntEnum):
    """Steps that may follow, in the order of escalation."""

    WARN = 0
    HOLD = 1
    LAND = 2
    DESCEND = 3


class GuardFinding(NamedTuple):
    """A limit that is passed."""

    step: GuardAction
    reason: Sentence
    blind: bool = False
    """True where the estimate of the speed is not to be believed."""
    most: GuardAction = GuardAction.DESCEND
    """Last step that follows where it lasts on."""


class Since:
    """Time for which each of several conditions has held, by name. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}

    def lasts(self, name: str, so: bool, now_s: float, for_s: float) -> bool:
        """Whether the condition holds and has held at every look for at least ``for_s`` [s]."""
        if not so:
            self._since.pop(name, None)
            return False
        return now_s - self._since.setdefault(name, now_s) >= for_s - 1e-9


LONGEST_STEP_S = 0.1
"""Longest time between two commands that counts for a share [s]: a pause is no oscillation."""


class RecentTime:
    """Time for which a condition held of late, breaks included: older time is forgotten exponentially."""

    def __init__(self, memory_s: float) -> None:
        """``memory_s``: time constant of forgetting [s]."""
        self._memory_s = memory_s
        self._at_s, self._held_s = -math.inf, 0.0

    def add(self, so: bool, now_s: float) -> float:
        """Take one look; return the time for which it held of late [s]."""
        elapsed, self._at_s = now_s - self._at_s, now_s
        self._held_s *= math.exp(-elapsed / self._memory_s)
        if so:
            self._held_s += min(elapsed, LONGEST_STEP_S)
        return self._held_s


class Escalation:
    """Turns findings into steps: each no gentler than the last, the next one where its cause lasts on."""

    def __init__(self, lasting_s: float) -> None:
        self._lasting = lasting_s
        self._step = GuardAction.WARN
        self._at_s = -math.inf

    def answer(self, finding: GuardFinding, now_s: float) -> GuardFinding | None:
        """Return what to do now about ``finding``; None where the last answer is still at work."""
        if finding.step > self._step:
            answer = finding
        elif self._step < finding.most and now_s - self._at_s > self._lasting:
            answer = finding._replace(step=GuardAction(self._step + 1), reason=finding.reason.as_lasting())
        else:
            return None
        self._step, self._at_s = answer.step, now_s
        return answer

    def reset(self) -> None:
        """Begin anew: the operator has sent it on."""
        self._step, self._at_s = GuardAction.WARN, -math.inf


Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]
Share = Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]


class GuardsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits in flight. Config section ``[guards]``; docs/explanation/safety.md has what follows beyond each."""

    level_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=0.75,
            description="How long it descends on the model after `flight.coast_s` without a pose; "
            "then the link brings it down [s].",
        ),
    ] = 0.25
    tilt_deg: Annotated[
        float, msgspec.Meta(gt=0.0, le=90.0, description="Largest tilt [deg]; the law asks for 80 at most.")
    ] = 80.0
    tilt_s: Annotated[Seconds, msgspec.Meta(description="How long it may tilt farther [s].")] = 0.1
    oscillation_deg: Annotated[
        float,
        msgspec.Meta(
            gt=0.0,
            le=90.0,
            description="Largest angle between the tilt and what reference and wind ask for [deg]; "
            "a push by 8 m/s² comes to 35.",
        ),
    ] = 40.0
    oscillation_s: Annotated[
        Share, msgspec.Meta(description="How long of about the last second it may be farther off [s].")
    ] = 0.3
    error_m: Annotated[
        float, msgspec.Meta(gt=0.0, le=100.0, description="Largest distance from the reference [m].")
    ] = 1.0
    error_s: Annotated[Seconds, msgspec.Meta(description="How long it may be farther from it [s].")] = 0.3
    speed_m_s: Annotated[
        float, msgspec.Meta(gt=0.0, le=50.0, description="Largest speed beside the reference's [m/s].")
    ] = 2.5
    speed_s: Annotated[Seconds, msgspec.Meta(description="How long it may be faster [s].")] = 0.1
    thrust_limit_s: Annotated[
        Seconds, msgspec.Meta(description="How long the thrust may be at its upper limit [s].")
    ] = 1.0
    rate_limit_s: Annotated[
        Seconds, msgspec.Meta(description="How long of about the last 2 s a body rate may be at its limit [s].")
    ] = 1.0
    effectiveness: Annotated[
        Share, msgspec.Meta(description="Least thrust scale [-]: all that is known of a battery without telemetry.")
    ] = 0.7
    pose_age: Annotated[
        Share,
        msgspec.Meta(
            description="Largest age of poses on arrival, as a share of `flight.coast_s` [-]: by "
            "older ones no loop is stable."
        ),
    ] = 0.6
    pose_resets: Annotated[
        int,
        msgspec.Meta(
            ge=1, le=1000, description="Largest number of resets of the estimate behind the poses within 5 s."
        ),
    ] = 4
    overruns: Annotated[
        int,
        msgspec.Meta(
            ge=1,
            le=1000,
            description="So many frames that were late by more than one and a half periods, within "
            "the last 100, land it.",
        ),
    ] = 5
    rtt_s: Annotated[
        float,
        msgspec.Meta(
            gt=0.0, le=5.0, description="Longest round trip to the vehicle and back, where the link knows it [s]."
        ),
    ] = 0.2
    battery_share: Annotated[
        float, msgspec.Meta(ge=0.0, le=1.0, description="Charge below which it lands, where the vehicle tells [-].")
    ] = 0.2
    battery_v: Annotated[
        Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | None,
        msgspec.Meta(description="Voltage below which it lands, where the vehicle tells [V]."),
    ] = None
    lasting_s: Annotated[
        Seconds, msgspec.Meta(description="What lasts so long after its answer is answered by the next step [s].")
    ] = 2.0


class GuardInput(Protocol):
    """One command, as the guards look at it; see :class:`groundstation.core.messages.snapshot.Tick`."""

    @property
    def time_s(self) -> float:
        """Instant at which it was computed."""
        ...

    @property
    def pose(self) -> Pose:
        """Newest pose that it rests on."""
        ...

    @property
    def estimate(self) -> Estimate:
        """Estimate that it rests on."""
        ...

    @property
    def reference(self) -> Reference:
        """Motion that is wanted."""
        ...

    @property
    def command(self) -> Command:
        """Command that leaves."""
        ...


FRAMES = 100
"""Number of frames among which late ones are counted."""
LATE_PERIODS = 2.5
"""Periods after the last frame from which on a frame is late [-]."""
RESETS_S = 5.0
"""Time within which resets of the estimate behind the poses are counted [s]."""
UNDER_FLOOR_M = 0.5
"""Depth under the floor that no pose shows [m]: PX4's own height was off by .65 m once in 40 landings."""
AT_LIMIT = 0.999
"""Share of a limit from which on a command is at it [-]: rounding."""
SURE_S = 0.06
"""Time that a distance to others must last [s]: a single pose may be another body's."""
LONG_S = 1.0
"""Time that slow quantities (battery, round trip, thrust scale) must last [s]: single readings jump."""
RATE_MEMORY_S = 2.0
"""Time constant by which time at a rate limit is forgotten [s]: a limit cycle has breaks."""
OSCILLATION_MEMORY_S = 1.0
"""Time constant by which time far off the wanted tilt is forgotten [s]."""


class GuardView:
    """One flight as the guards see it: the newest command, and what is counted over several."""

    def __init__(
        self, config: GuardsConfig, fence: Fence | None, separation: Separation | None, vehicle: Vehicle,
        period_s: Callable[[], float], floor_z_m: float, gravity: float, coast_s: float,
    ) -> None:  # fmt: skip
        """Take the limits and the vehicle; see :class:`Guards`."""
        self.config, self.fence, self.separation, self.vehicle = config, fence, separation, vehicle
        self.period_s, self.floor_z_m, self.gravity, self.coast_s = period_s, floor_z_m, gravity, coast_s
        self.tick: GuardInput
        """Newest command."""
        self.link: LinkStatus | None = None
        """Newest state of the link."""
        self.is_guided = True
        """Whether a reference is followed: a failsafe descent has none."""
        self.late_frames = 0
        """Late frames among the last ``FRAMES``."""
        self.resets = 0
        """Resets of the estimate behind the poses within ``RESETS_S``."""
        self._late: list[int] = []
        self._frames, self._left_s = 0, math.inf
        self._reset_count: int | None = None
        self._reset_s: list[float] = []

    def take(self, tick: GuardInput, *, is_guided: bool) -> None:
        """Take one more command."""
        self.tick, self.is_guided = tick, is_guided
        now_s, left_s = tick.time_s, self._left_s
        self._left_s, self._frames = now_s, self._frames + 1
        if now_s - left_s > LATE_PERIODS * self.period_s():
            self._late.append(self._frames)
        self._late = [frame for frame in self._late if frame > self._frames - FRAMES]
        self.late_frames = len(self._late)
        count = tick.pose.reset_count
        if self._reset_count not in (None, count):
            self._reset_s = [at for at in self._reset_s if now_s - at < RESETS_S] + [now_s]
        self._reset_count, self.resets = count, len(self._reset_s)

    @property
    def tilt_error_deg(self) -> float:
        """Angle between the body's z axis and the push that reference, drag and disturbance ask for [deg]."""
        estimate, k = self.tick.estimate, self.vehicle.drag_per_s
        a, d, v = self.tick.reference.acceleration_ned, estimate.disturbance, estimate.motion.velocity
        x, y, z = (d[i] - k * v[i] - a[i] + (self.gravity if i == 2 else 0.0) for i in range(3))
        p, q, r = third_column(estimate.motion.attitude)
        return angle_deg((x * p + y * q + z * r) / max(math.sqrt(x * x + y * y + z * z), 1e-6))

    def nearest(self) -> Near | None:
        """Other vehicle that leaves least room; None where none is kept away from, or none was seen."""
        if self.separation is None:
            return None
        motion = self.tick.estimate.motion
        return self.separation.nearest(motion.position, motion.velocity, self.tick.time_s)


Numbers = dict[str, object]
"""Numbers of a sentence, by their names in it."""


def _tilt(v: GuardView) -> Numbers | None:
    tilt = angle_deg(third_column(v.tick.estimate.motion.attitude)[2])
    return None if tilt <= v.config.tilt_deg else {"tilt_deg": tilt, "limit_deg": v.config.tilt_deg}


def _oscillation(v: GuardView) -> Numbers | None:
    off, limit = v.tilt_error_deg, v.config.oscillation_deg
    return None if not v.is_guided or off <= limit else {"off_deg": off, "limit_deg": limit}


def _error(v: GuardView) -> Numbers | None:
    off = math.dist(v.tick.estimate.motion.position, v.tick.reference.position_ned)
    return None if not v.is_guided or off <= v.config.error_m else {"error_m": off, "limit_m": v.config.error_m}


def _speed(v: GuardView) -> Numbers | None:
    off = math.dist(v.tick.estimate.motion.velocity, v.tick.reference.velocity_ned)
    beyond = v.is_guided and not off <= v.config.speed_m_s
    return {"speed_m_s": off, "limit_m_s": v.config.speed_m_s} if beyond else None


def _thrust(v: GuardView) -> Numbers | None:
    at_limit = v.is_guided and v.tick.command.thrust_n >= AT_LIMIT * v.vehicle.thrust_max_n
    return {"lasts_s": v.config.thrust_limit_s} if at_limit else None


def _rate(v: GuardView) -> Numbers | None:
    pairs = zip(v.tick.command.rates_rad_s, v.vehicle.rate_limits_deg_s, strict=True)
    at_limit = v.is_guided and any(abs(rate) >= AT_LIMIT * math.radians(limit) for rate, limit in pairs)
    return {"lasts_s": v.config.rate_limit_s} if at_limit else None


def _weak(v: GuardView) -> Numbers | None:
    found, limit = v.tick.estimate.effectiveness, v.config.effectiveness
    return None if not v.is_guided or found >= limit else {"found": 100.0 * found, "limit": 100.0 * limit}


def _fence(v: GuardView) -> Numbers | None:
    room = math.inf if v.fence is None else v.fence.room_m(v.tick.estimate.motion.position)
    return {"outside_m": -room} if room < 0.0 else None


def _braking(v: GuardView) -> Numbers | None:
    motion = v.tick.estimate.motion
    if v.fence is None or v.fence.braking_room_m(motion.position, motion.velocity) >= 0.0:
        return None
    return {"room_m": v.fence.room_m(motion.position), "speed_m_s": math.hypot(*motion.velocity)}


def _separation(v: GuardView) -> Numbers | None:
    near = v.nearest()
    if near is None or v.separation is None or near.distance_m >= v.separation.config.distance_m:
        return None
    return {"distance_m": near.distance_m, "name": near.name, "limit_m": v.separation.config.distance_m}


def _approach(v: GuardView) -> Numbers | None:
    near = v.nearest()
    return None if near is None or near.room_m >= 0.0 else {"distance_m": near.distance_m, "name": near.name}


def _unseen(v: GuardView) -> Numbers | None:
    names = () if v.separation is None else v.separation.unknown(v.tick.time_s)
    if not names or v.separation is None:
        return None
    return {"names": ", ".join(names), "limit_s": v.separation.config.stale_s}


def _pose_age(v: GuardView) -> Numbers | None:
    age, limit = v.tick.pose.arrival_s - v.tick.pose.time_s, v.config.pose_age * v.coast_s
    return None if age <= limit else {"age_ms": 1e3 * age, "limit_ms": 1e3 * limit}


def _pose_resets(v: GuardView) -> Numbers | None:
    return None if v.resets <= v.config.pose_resets else {"count": v.resets, "limit": v.config.pose_resets}


def _under_floor(v: GuardView) -> Numbers | None:
    depth = v.tick.pose.position_ned[2] - v.floor_z_m
    return None if depth <= UNDER_FLOOR_M else {"depth_m": depth, "limit_m": UNDER_FLOOR_M}


def _overruns(v: GuardView) -> Numbers | None:
    return None if v.late_frames < v.config.overruns else {"count": v.late_frames, "limit": v.config.overruns}


def _round_trip(v: GuardView) -> Numbers | None:
    rtt, limit = 0.0 if v.link is None else v.link.rtt_s or 0.0, v.config.rtt_s
    return None if rtt <= limit else {"rtt_ms": 1e3 * rtt, "limit_ms": 1e3 * limit}


def _charge(v: GuardView) -> Numbers | None:
    share, limit = None if v.link is None else v.link.battery_share, v.config.battery_share
    return {"charge": 100.0 * share, "limit": 100.0 * limit} if share is not None and share < limit else None


def _voltage(v: GuardView) -> Numbers | None:
    volts, limit = None if v.link is None else v.link.battery_v, v.config.battery_v
    low = limit is not None and volts is not None and volts < limit
    return {"voltage_v": volts, "limit_v": limit} if low else None


class Guard(NamedTuple):
    """One row of the table."""

    id: str
    """Id of its sentence, ``guard.`` and its name."""
    says: str
    """Limit, in words."""
    key: str
    """Configuration key of the limit."""
    lasts: str | float
    """Time that it must be passed for [s]: a key of ``[guards]``, or the time itself."""
    step: GuardAction
    """Step that follows."""
    most: GuardAction
    """Last step that follows where it lasts on."""
    find: Callable[[GuardView], Numbers | None]
    """Numbers of the sentence where the limit is passed, else None."""
    memory_s: float = 0.0
    """Where breaks count too: time constant by which passed time is forgotten [s]."""


HOLD, LAND, DESCEND = GuardAction.HOLD, GuardAction.LAND, GuardAction.DESCEND
OSC, RATE = OSCILLATION_MEMORY_S, RATE_MEMORY_S
GUARDS: tuple[Guard, ...] = (
    Guard("guard.tilt", "largest tilt", "guards.tilt_deg", "tilt_s", DESCEND, DESCEND, _tilt),
    Guard("guard.oscillation", "tilt beside the wanted one, again and again", "guards.oscillation_deg",
          "oscillation_s", LAND, DESCEND, _oscillation, OSC),
    Guard("guard.error", "largest position error", "guards.error_m", "error_s", LAND, DESCEND, _error),
    Guard("guard.speed", "largest speed beside the reference", "guards.speed_m_s", "speed_s", LAND, DESCEND, _speed),
    Guard("guard.thrust", "thrust at its limit", "vehicle.thrust_max_n", "thrust_limit_s", LAND, DESCEND, _thrust),
    Guard("guard.rate", "a body rate at its limit", "vehicle.rate_limits_deg_s", "rate_limit_s", DESCEND, DESCEND,
          _rate, RATE),
    Guard("guard.weak", "least thrust scale", "guards.effectiveness", LONG_S, LAND, LAND, _weak),
    Guard("guard.fence", "outside the fence", "fence", 0.0, LAND, DESCEND, _fence),
    Guard("guard.braking", "too fast before the fence", "fence.braking_m_s2", 0.0, HOLD, DESCEND, _braking),
    Guard("guard.separation", "distance to another vehicle", "separation.distance_m", SURE_S, LAND, LAND, _separation),
    Guard("guard.approach", "too fast towards another vehicle", "separation.braking_m_s2", SURE_S, HOLD, LAND,
          _approach),
    Guard("guard.unseen", "another vehicle unseen", "separation.stale_s", 0.0, HOLD, HOLD, _unseen),
    Guard("guard.pose_age", "age of poses on arrival", "guards.pose_age", 0.3, LAND, LAND, _pose_age),
    Guard("guard.pose_resets", "resets behind the poses", "guards.pose_resets", 0.0, LAND, DESCEND, _pose_resets),
    Guard("guard.under_floor", "a pose under the floor", "flight.floor_z_m", SURE_S, DESCEND, DESCEND, _under_floor),
    Guard("guard.overruns", "late frames of the last 100", "guards.overruns", 0.0, LAND, DESCEND, _overruns),
    Guard("guard.round_trip", "round trip of the link", "guards.rtt_s", LONG_S, LAND, LAND, _round_trip),
    Guard("guard.charge", "least charge of the battery", "guards.battery_share", LONG_S, LAND, LAND, _charge),
    Guard("guard.voltage", "least voltage of the battery", "guards.battery_v", LONG_S, LAND, LAND, _voltage),
)  # fmt: skip
"""Limits that end a flight early."""


class GuardLimit(NamedTuple):
    """One row of the table with the limit of one configuration."""

    says: str
    """Limit, in words."""
    key: str
    """Configuration key of the limit."""
    limit: object
    """Limit itself; None where there is none, or a section of its own."""
    lasts_s: float
    """Time that it must be passed for [s]."""
    step: str
    """Step that follows."""
    most: str
    """Last step that follows where it lasts on."""
    remedy: str
    """Advice to the operator."""


STEPS = {GuardAction.HOLD: "hold", GuardAction.LAND: "land", GuardAction.DESCEND: "failsafe descent"}
"""Steps in words."""


def list_limits(config: object, guards: GuardsConfig) -> list[GuardLimit]:
    """Return the table with the limits of a flight's whole ``config``, and of its section ``guards``."""
    rows = []
    for guard in GUARDS:
        limit: object = config
        for name in guard.key.split("."):
            limit = getattr(limit, name, None)
        plain = None if isinstance(limit, msgspec.Struct) else limit
        lasts_s = float(getattr(guards, guard.lasts)) if isinstance(guard.lasts, str) else guard.lasts
        remedy = NOTICES[guard.id].remedy
        rows.append(GuardLimit(guard.says, guard.key, plain, lasts_s, STEPS[guard.step], STEPS[guard.most], remedy))
    return rows


UNSEEN_STEPS = {"warn": GuardAction.WARN, "hold": GuardAction.HOLD, "land": GuardAction.LAND}
"""Step that ``separation.unknown`` asks for, after ``separation.unknown_s``; before that it is a warning."""
OF_LINK = ("guard.round_trip", "guard.charge", "guard.voltage")
"""Rows that look at the link, not at the commands."""


class Guards:
    """One flight's limits. Times are on the event loop's clock [s]."""

    def __init__(
        self, config: GuardsConfig, fence: Fence | None, vehicle: Vehicle, period_s: Callable[[], float],
        separation: Separation | None = None, floor_z_m: float = 0.0, gravity: float = GRAVITY,
        coast_s: float = math.inf,
    ) -> None:  # fmt: skip
        """Take the limits; ``period_s`` tells the link's time between two commands [s], asked with each command.

        ``separation`` is from other vehicles; ``floor_z_m`` is the position of a vehicle on the floor [m, NED],
        ``gravity`` the controller's [m/s²], ``coast_s`` how long commands may rest on one pose [s].
        """
        self._view = GuardView(config, fence, separation, vehicle, period_s, floor_z_m, gravity, coast_s)
        self._since = Since()
        self._recent = {guard.id: RecentTime(guard.memory_s) for guard in GUARDS if guard.memory_s > 0.0}

    def see(self, tick: GuardInput, state: State) -> GuardFinding | None:
        """Gravest finding of one command."""
        self._view.take(tick, is_guided=state is not State.DESCENT)
        found = [self._look(guard, tick.time_s) for guard in GUARDS if guard.id not in OF_LINK]
        return max((one for one in found if one is not None), key=lambda one: one.step, default=None)

    def link(self, status: LinkStatus, now_s: float) -> GuardFinding | None:
        """First finding of what the link tells."""
        self._view.link = status
        found = (self._look(guard, now_s) for guard in GUARDS if guard.id in OF_LINK)
        return next((one for one in found if one is not None), None)

    def _look(self, guard: Guard, now_s: float) -> GuardFinding | None:
        numbers = guard.find(self._view)
        for_s = float(getattr(self._view.config, guard.lasts)) if isinstance(guard.lasts, str) else guard.lasts
        if guard.memory_s > 0.0:
            held_s = self._recent[guard.id].add(numbers is not None, now_s)
            # A condition without a break has then been forgotten in part.
            is_over = held_s >= -guard.memory_s * math.expm1(-for_s / guard.memory_s) - 1e-9
        else:
            is_over = self._since.lasts(guard.id, numbers is not None, now_s, for_s)
        step, most = guard.step, guard.most
        if guard.id == "guard.unseen" and self._view.separation is not None:
            config = self._view.separation.config
            lasts = self._since.lasts("unseen long", numbers is not None, now_s, config.unknown_s)
            step = most = UNSEEN_STEPS[config.unknown] if lasts else GuardAction.WARN
        if numbers is None:
            return None
        if guard.id == "guard.separation" and (near := self._view.nearest()) is not None and near.beneath:
            step = most = GuardAction.HOLD  # the one that is lower lands: down upon another would be worse
        return GuardFinding(step, notice(guard.id, **numbers), most=most) if is_over else None
