"""Guards: one table of limits that end a flight early, checked with every command. Sans-IO.

Beyond a limit follows one step of hold → land → failsafe descent. A limit that is still exceeded
some time later is followed by the next step, up to the last one of its row: no landing ends an
empty battery. ``GUARDS`` is the table; `groundstation check --limits` and docs/reference/guards.md
are made from it.
"""

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Annotated, NamedTuple

import msgspec

from groundstation.core.geometry import add_scaled, angle_deg, subtract, third_column
from groundstation.core.messages import (
    NOTICES,
    RESETS_S,
    ROUNDING_S,
    Numbers,
    Sentence,
    Tick,
    notice,
)
from groundstation.core.mission import State
from groundstation.core.safety.conditions import RecentTime, Since
from groundstation.core.safety.geofence import Fence, Length, Near, Separation
from groundstation.core.vehicle import GRAVITY, Vehicle
from links.core import LinkStatus
from links.text import to_ms, to_percent


class GuardAction(IntEnum):
    """Steps that may follow, in the order of escalation."""

    WARN = 0
    HOLD = 1
    LAND = 2
    DESCEND = 3


class GuardFinding(NamedTuple):
    """A limit that is exceeded."""

    step: GuardAction
    reason: Sentence
    blind: bool = False
    """Whether the estimate of the speed is not believed."""
    most: GuardAction = GuardAction.DESCEND
    """Last step that follows while the limit stays exceeded."""


class Escalation:
    """Conversion of findings to steps: each no gentler than the last, the next one where a limit,
    the same or another, is exceeded some time after it.
    """

    def __init__(self, lasting_s: float) -> None:
        """``lasting_s``: time after one step from which a finding is followed by the next [s]."""
        self._lasting = lasting_s
        self._step = GuardAction.WARN
        self._at_s = -math.inf
        self._reason_id = ""
        """Id of the sentence of the last step."""

    def escalate(self, finding: GuardFinding, now_s: float) -> GuardFinding | None:
        """Return the finding with the step to take now; None while the last step has its time."""
        if finding.step > self._step:
            escalated = finding
        elif self._step < finding.most and now_s - self._at_s > self._lasting:
            reason = finding.reason
            if reason.id == self._reason_id:
                reason = reason.as_lasting()
            escalated = finding._replace(step=GuardAction(self._step + 1), reason=reason)
        else:
            return None
        self._step, self._at_s, self._reason_id = escalated.step, now_s, finding.reason.id
        return escalated

    def reset(self) -> None:
        """Begin anew: the operator has sent the flight on."""
        self._step, self._at_s = GuardAction.WARN, -math.inf


Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]
Share = Annotated[float, msgspec.Meta(ge=0.01, le=1.0)]
"""A share [-], or a time of at most 1 s [s]."""
Angle = Annotated[float, msgspec.Meta(ge=2.0, le=90.0)]
"""A tilt [deg]; below 2 it was probably meant in radians, of which 90 degrees are 1.6."""
Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]


class GuardsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits in flight. Config section ``[guards]``; docs/explanation/safety.md has what follows
    beyond each.
    """

    level_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=0.75,
            description="Duration of the descent on the model after `flight.coast_s` without a "
            "pose; then the link brings the vehicle down [s].",
        ),
    ] = 0.25
    tilt_deg: Annotated[
        Angle, msgspec.Meta(description="Largest tilt [deg]; the law commands 80 at most.")
    ] = 80.0
    tilt_s: Annotated[Seconds, msgspec.Meta(description="Longest time beyond `tilt_deg` [s].")] = (
        0.1
    )
    oscillation_deg: Annotated[
        Angle,
        msgspec.Meta(
            description="Largest angle between the tilt and that required by reference and wind "
            "[deg]; a push by 8 m/s² comes to 35."
        ),
    ] = 40.0
    oscillation_s: Annotated[
        Share,
        msgspec.Meta(
            description="Longest time beyond `oscillation_deg` within about the last second [s]."
        ),
    ] = 0.3
    error_m: Annotated[
        Length, msgspec.Meta(description="Largest distance from the reference [m].")
    ] = 1.0
    error_s: Annotated[Seconds, msgspec.Meta(description="Longest time beyond `error_m` [s].")] = (
        0.3
    )
    speed_m_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.05, le=50.0, description="Largest velocity relative to the reference's [m/s]."
        ),
    ] = 2.5
    speed_s: Annotated[
        Seconds, msgspec.Meta(description="Longest time beyond `speed_m_s` [s].")
    ] = 0.1
    thrust_limit_s: Annotated[
        Seconds, msgspec.Meta(description="Longest time with thrust at its upper limit [s].")
    ] = 1.0
    rate_limit_s: Annotated[
        Seconds,
        msgspec.Meta(
            description="Longest time with a body rate at its limit within about the last 2 s [s]."
        ),
    ] = 1.5
    effectiveness: Annotated[
        Share,
        msgspec.Meta(
            description="Least thrust scale [-]: the only measure of a battery without telemetry."
        ),
    ] = 0.7
    pose_age: Annotated[
        Share,
        msgspec.Meta(
            description="Largest age of poses on arrival, as a share of `flight.coast_s` [-]: with "
            "older ones no loop is stable."
        ),
    ] = 0.6
    pose_resets: Annotated[
        Count,
        msgspec.Meta(
            description="Largest number of resets of the estimate behind the poses within 5 s."
        ),
    ] = 4
    overruns: Annotated[
        Count,
        msgspec.Meta(
            description="Number of the last 100 frames, each late by more than one and a half "
            "periods, from which the vehicle lands."
        ),
    ] = 5
    rtt_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.001,
            le=5.0,
            description="Longest round trip to the vehicle and back, where the link measures it "
            "[s].",
        ),
    ] = 0.2
    battery_share: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=1.0,
            description="Charge below which the vehicle lands, where it reports that [-].",
        ),
    ] = 0.2
    battery_v: Annotated[
        Annotated[float, msgspec.Meta(ge=0.1, le=1000.0)] | None,
        msgspec.Meta(
            description="Voltage below which the vehicle lands, where it reports that [V]."
        ),
    ] = None
    lasting_s: Annotated[
        Seconds,
        msgspec.Meta(
            description="Time from one step to the next while a limit stays exceeded [s]."
        ),
    ] = 2.0


FRAMES = 100
"""Number of frames among which late ones are counted."""
LATE_PERIODS = 2.5
"""Periods after the last frame, message or stamp of a pose from which the next one is late [-]: one
is missing, and half a period is jitter."""
UNDER_FLOOR_M = 0.5
"""Largest plausible depth of a pose under the floor [m]: in 39 of 40 landings PX4's own height was
within it, and once off by .65 m."""
AT_LIMIT = 0.999
"""Share of a limit from which a command is at it [-]: rounding."""
SURE_S = 0.06
"""Time beyond a limit of a distance that counts [s]: a single pose may be another body's."""
LONG_S = 1.0
"""Time beyond a limit of a slow quantity (battery, round trip, thrust scale) that counts [s]:
single readings jump."""
AGED_S = 0.3
"""Time beyond ``guards.pose_age`` that counts [s]: single poses may be late."""
RATE_MEMORY_S = 2.0
"""Time constant of forgetting time at a rate limit [s]: a limit cycle has breaks."""
OSCILLATION_MEMORY_S = 1.0
"""Time constant of forgetting time beyond ``oscillation_deg`` [s]."""


class GuardView:
    """Input of the guards: the newest command, and counts over several."""

    def __init__(
        self, config: GuardsConfig, fence: Fence | None, separation: Separation | None,
        vehicle: Vehicle, period_s: Callable[[], float],
        floor_z_m: float, gravity: float, coast_s: float,
    ) -> None:  # fmt: skip
        """Take the limits and the vehicle; see :class:`Guards`."""
        self.config, self.fence, self.separation, self.vehicle = config, fence, separation, vehicle
        self.period_s, self.coast_s = period_s, coast_s
        self.floor_z_m, self.gravity = floor_z_m, gravity
        self.tick: Tick
        """Newest command."""
        self.link: LinkStatus | None = None
        """Newest state of the link."""
        self.is_guided = True
        """Whether a reference is followed; a failsafe descent has none."""
        self.late_frames = 0
        """Late frames among the last ``FRAMES``."""
        self.resets = 0
        """Resets of the estimate behind the poses within ``RESETS_S``."""
        self._late: list[int] = []
        self._frames, self._left_s = 0, math.inf
        self._reset_count: int | None = None
        self._reset_s: list[float] = []

    def add_command(self, tick: Tick, *, is_guided: bool) -> None:
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
            self._reset_s.append(now_s)
        self._reset_s = [at for at in self._reset_s if now_s - at < RESETS_S]
        self._reset_count, self.resets = count, len(self._reset_s)

    @property
    def tilt_error_deg(self) -> float:
        """Angle between the body's z axis and the direction required by reference, drag and
        disturbance [deg].
        """
        estimate, k = self.tick.estimate, self.vehicle.drag_per_s
        dragged = add_scaled(estimate.disturbance, -k, estimate.motion.velocity)
        x, y, z = subtract(dragged, self.tick.reference.acceleration_ned)
        z += self.gravity
        p, q, r = third_column(estimate.motion.attitude)
        return angle_deg((x * p + y * q + z * r) / (math.sqrt(x * x + y * y + z * z) or 1.0))

    def nearest(self) -> Near | None:
        """Other vehicle with the least distance left after braking.

        None without ``separation.others``, or a sighting.
        """
        if self.separation is None:
            return None
        motion = self.tick.estimate.motion
        return self.separation.nearest(motion.position, motion.velocity, self.tick.time_s)


def _tilt(v: GuardView) -> Numbers | None:
    tilt = angle_deg(third_column(v.tick.estimate.motion.attitude)[2])
    return None if tilt <= v.config.tilt_deg else {"tilt_deg": tilt, "limit_deg": v.config.tilt_deg}


def _oscillation(v: GuardView) -> Numbers | None:
    off, limit = v.tilt_error_deg, v.config.oscillation_deg
    return None if not v.is_guided or off <= limit else {"off_deg": off, "limit_deg": limit}


def _error(v: GuardView) -> Numbers | None:
    off = math.dist(v.tick.estimate.motion.position, v.tick.reference.position_ned)
    return (
        None
        if not v.is_guided or off <= v.config.error_m
        else {"error_m": off, "limit_m": v.config.error_m}
    )


def _speed(v: GuardView) -> Numbers | None:
    off = math.dist(v.tick.estimate.motion.velocity, v.tick.reference.velocity_ned)
    beyond = v.is_guided and not off <= v.config.speed_m_s
    return {"speed_m_s": off, "limit_m_s": v.config.speed_m_s} if beyond else None


def _thrust(v: GuardView) -> Numbers | None:
    at_limit = v.is_guided and v.tick.command.thrust_n >= AT_LIMIT * v.vehicle.thrust_max_n
    return {"lasts_s": v.config.thrust_limit_s} if at_limit else None


def _rate(v: GuardView) -> Numbers | None:
    pairs = zip(v.tick.command.rates_rad_s, v.vehicle.rate_limits_deg_s, strict=True)
    at_limit = v.is_guided and any(
        abs(rate) >= AT_LIMIT * math.radians(limit) for rate, limit in pairs
    )
    return {"lasts_s": v.config.rate_limit_s} if at_limit else None


def _weak(v: GuardView) -> Numbers | None:
    found, limit = v.tick.estimate.effectiveness, v.config.effectiveness
    return (
        None
        if not v.is_guided or found >= limit
        else {"found": to_percent(found), "limit": to_percent(limit)}
    )


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
    return {
        "distance_m": near.distance_m,
        "name": near.name,
        "limit_m": v.separation.config.distance_m,
    }


def _approach(v: GuardView) -> Numbers | None:
    near = v.nearest()
    return (
        None
        if near is None or near.room_m >= 0.0
        else {"distance_m": near.distance_m, "name": near.name}
    )


def _unseen(v: GuardView) -> Numbers | None:
    names = () if v.separation is None else v.separation.unknown(v.tick.time_s)
    if not names or v.separation is None:
        return None
    return {"names": ", ".join(names), "limit_s": v.separation.config.stale_s}


def _pose_age(v: GuardView) -> Numbers | None:
    age, limit = v.tick.pose.arrival_s - v.tick.pose.time_s, v.config.pose_age * v.coast_s
    return None if age <= limit else {"age_ms": to_ms(age), "limit_ms": to_ms(limit)}


def _pose_resets(v: GuardView) -> Numbers | None:
    return (
        None
        if v.resets <= v.config.pose_resets
        else {"count": v.resets, "limit": v.config.pose_resets}
    )


def _under_floor(v: GuardView) -> Numbers | None:
    depth = v.tick.pose.position_ned[2] - v.floor_z_m
    return None if depth <= UNDER_FLOOR_M else {"depth_m": depth, "limit_m": UNDER_FLOOR_M}


def _overruns(v: GuardView) -> Numbers | None:
    return (
        None
        if v.late_frames < v.config.overruns
        else {"count": v.late_frames, "limit": v.config.overruns}
    )


def _round_trip(v: GuardView) -> Numbers | None:
    rtt, limit = None if v.link is None else v.link.rtt_s, v.config.rtt_s
    if rtt is None or rtt <= limit:
        return None
    return {"rtt_ms": to_ms(rtt), "limit_ms": to_ms(limit)}


def _charge(v: GuardView) -> Numbers | None:
    share, limit = None if v.link is None else v.link.battery_share, v.config.battery_share
    if share is None or not share < limit:
        return None
    return {"charge": to_percent(share), "limit": to_percent(limit)}


def _voltage(v: GuardView) -> Numbers | None:
    volts, limit = None if v.link is None else v.link.battery_v, v.config.battery_v
    return (
        None
        if limit is None or volts is None or not volts < limit
        else {"voltage_v": volts, "limit_v": limit}
    )


class Guard(NamedTuple):
    """One row of the table."""

    id: str
    """Id of its sentence, ``guard.`` and its name."""
    says: str
    """Limit, in words."""
    key: str
    """Configuration key of the limit."""
    lasts: str | float
    """Time beyond the limit after which the step follows [s]: a key of ``[guards]``, or the time
    itself."""
    step: GuardAction
    """Step that follows."""
    most: GuardAction
    """Last step that follows while the limit stays exceeded."""
    find: Callable[[GuardView], Numbers | None]
    """Numbers of the sentence where the limit is exceeded, else None."""
    memory_s: float = 0.0
    """Where breaks count too: time constant of forgetting time beyond the limit [s]."""


WARN = GuardAction.WARN
HOLD = GuardAction.HOLD
LAND = GuardAction.LAND
DESCEND = GuardAction.DESCEND
GUARDS: tuple[Guard, ...] = (
    Guard("guard.tilt", "largest tilt", "guards.tilt_deg", "tilt_s", DESCEND, DESCEND, _tilt),
    Guard("guard.oscillation", "oscillation: angle between tilt and required tilt",
        "guards.oscillation_deg",
          "oscillation_s", LAND, DESCEND, _oscillation, OSCILLATION_MEMORY_S),
    Guard("guard.error", "largest position error", "guards.error_m", "error_s", LAND, DESCEND,
        _error),
    Guard("guard.speed", "velocity relative to the reference", "guards.speed_m_s", "speed_s",
        LAND, DESCEND, _speed),
    Guard("guard.thrust", "thrust at its limit", "vehicle.thrust_max_n", "thrust_limit_s", LAND,
        DESCEND, _thrust),
    Guard("guard.rate", "a body rate at its limit", "vehicle.rate_limits_deg_s", "rate_limit_s",
        DESCEND, DESCEND,
          _rate, RATE_MEMORY_S),
    Guard("guard.weak", "least thrust scale", "guards.effectiveness", LONG_S, LAND, LAND, _weak),
    Guard("guard.fence", "outside the fence", "fence", 0.0, LAND, DESCEND, _fence),
    Guard("guard.braking", "too fast before the fence", "fence.braking_m_s2", 0.0, HOLD, DESCEND,
        _braking),
    Guard("guard.separation", "distance to another vehicle (the upper of two holds)",
        "separation.distance_m", SURE_S, LAND, LAND, _separation),
    Guard("guard.approach", "too fast towards another vehicle", "separation.braking_m_s2", SURE_S,
        HOLD, LAND,
          _approach),
    Guard("guard.unseen", "another vehicle not sighted (`separation.unknown` has what follows)",
        "separation.stale_s", 0.0, WARN, LAND, _unseen),
    Guard("guard.pose_age", "age of poses on arrival", "guards.pose_age", AGED_S, LAND, LAND,
        _pose_age),
    Guard("guard.pose_resets", "resets behind the poses", "guards.pose_resets", 0.0, LAND,
        DESCEND, _pose_resets),
    Guard("guard.under_floor", f"a pose {UNDER_FLOOR_M:g} m under the floor", "flight.floor_z_m",
        SURE_S, DESCEND, DESCEND, _under_floor),
    Guard("guard.overruns", "late frames of the last 100", "guards.overruns", 0.0, LAND, DESCEND,
        _overruns),
    Guard("guard.round_trip", "round trip of the link", "guards.rtt_s", LONG_S, LAND, LAND,
        _round_trip),
    Guard("guard.charge", "least charge of the battery", "guards.battery_share", LONG_S, LAND,
        LAND, _charge),
    Guard("guard.voltage", "least voltage of the battery", "guards.battery_v", LONG_S, LAND, LAND,
        _voltage),
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
    """Time beyond the limit after which the step follows [s]."""
    step: str
    """Step that follows."""
    most: str
    """Last step that follows while the limit stays exceeded."""
    remedy: str
    """Advice to the operator."""


STEPS = {WARN: "warning", HOLD: "hold", LAND: "land", DESCEND: "failsafe descent"}
"""Steps in words."""


def _lasts_s(guard: Guard, config: GuardsConfig) -> float:
    """Time beyond the limit of ``guard`` after which its step follows [s]."""
    return float(getattr(config, guard.lasts)) if isinstance(guard.lasts, str) else guard.lasts


def list_limits(config: object, guards: GuardsConfig) -> list[GuardLimit]:
    """Return the table with the limits of a flight's whole ``config``, and of its section
    ``guards``.
    """
    rows = []
    for guard in GUARDS:
        limit: object = config
        for name in guard.key.split("."):
            limit = getattr(limit, name, None)
        plain = None if isinstance(limit, msgspec.Struct) else limit
        remedy = NOTICES[guard.id].remedy
        rows.append(
            GuardLimit(
                guard.says,
                guard.key,
                plain,
                _lasts_s(guard, guards),
                STEPS[guard.step],
                STEPS[guard.most],
                remedy,
            )
        )
    return rows


UNSEEN_STEPS = {"warn": WARN, "hold": HOLD, "land": LAND}
"""Step by ``separation.unknown``, after ``separation.unknown_s``; before that it is a warning."""
OF_OTHERS = ("guard.separation", "guard.approach")
"""Rows about the nearest other vehicle."""
OF_LINK = ("guard.round_trip", "guard.charge", "guard.voltage")
"""Rows that check the link, not the commands."""


class Guards:
    """One flight's limits. Times are on the event loop's clock [s]."""

    def __init__(
        self, config: GuardsConfig, fence: Fence | None, vehicle: Vehicle,
        period_s: Callable[[], float], separation: Separation | None = None,
        floor_z_m: float = 0.0, gravity: float = GRAVITY, coast_s: float = math.inf,
    ) -> None:  # fmt: skip
        """Take the limits; ``period_s`` returns the link's time between two commands [s]: it is
        asked at each command, as the link may change it.

        ``separation`` is from other vehicles; ``floor_z_m`` is the position of a vehicle on the
        floor [m, NED], ``gravity`` the controller's [m/s²], ``coast_s`` the longest use of one pose
        [s].
        """
        self._view = GuardView(
            config, fence, separation, vehicle, period_s, floor_z_m, gravity, coast_s
        )
        self._since = Since()
        self._recent = {
            guard.id: RecentTime(guard.memory_s) for guard in GUARDS if guard.memory_s > 0.0
        }

    def check_command(self, tick: Tick, state: State) -> GuardFinding | None:
        """Return the gravest finding of one command: by its step, then by its last one."""
        self._view.add_command(tick, is_guided=state is not State.DESCENT)
        found = [self._check(guard, tick.time_s) for guard in GUARDS if guard.id not in OF_LINK]
        return max(
            (one for one in found if one is not None),
            key=lambda one: (one.step, one.most),
            default=None,
        )

    def check_link(self, status: LinkStatus, now_s: float) -> GuardFinding | None:
        """Return the first finding of the link's status."""
        self._view.link = status
        found = (self._check(guard, now_s) for guard in GUARDS if guard.id in OF_LINK)
        return next((one for one in found if one is not None), None)

    def _check(self, guard: Guard, now_s: float) -> GuardFinding | None:
        numbers, view = guard.find(self._view), self._view
        is_beyond, memory_s = numbers is not None, guard.memory_s
        for_s = _lasts_s(guard, view.config)
        if memory_s > 0.0:
            # The sum forgets: of for_s [s] without a break so much is left in it.
            held_s = self._recent[guard.id].add(is_beyond, now_s)
            for_s = -memory_s * math.expm1(-for_s / memory_s)
        else:
            held_s = self._since.held_s(guard.id, is_beyond, now_s)
        step, most = guard.step, guard.most
        if guard.id == "guard.unseen" and view.separation is not None:
            config = view.separation.config
            unseen_s = self._since.held_s("unseen long", is_beyond, now_s)
            is_long = unseen_s >= config.unknown_s - ROUNDING_S
            step = most = UNSEEN_STEPS[config.unknown] if is_long else WARN
        if guard.id in OF_OTHERS and (near := view.nearest()) is not None and near.beneath:
            step = most = HOLD  # the lower one lands: down upon another would be worse
        if numbers is None or held_s < for_s - ROUNDING_S:
            return None
        return GuardFinding(step, notice(guard.id, **numbers), most=most)
