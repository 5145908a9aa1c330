"""Guards: limits that are looked at with every command, and end a flight early, as conviction does. Sans-IO.

Of the flight itself: its error, its speed, its lean, the poses and the link that it needs. Of what is around it: the
geofence, and other vehicles that the cameras see, or should. Of its own swinging: poses that come late and commands
that get lost make the height swing as well as the lean. Up in the air the lean shows it in time; near the floor the
next trough of the thrust is a fall.

Beyond a limit follows one step of hold → land → failsafe descent after the other: what lasts on after its answer is
answered by the next, unless no landing could end it, as an empty battery.

Evidence against the poses leads to two things. *Suspicion*: nothing is learnt from the poses, the last trim is held,
and the operator is told. *Conviction*: the poses are not believed again in this flight; it ends with a descent on the
model, from what was believed before. Where the attitude obeys and only the position stands, or where something moves
the vehicle, it may be a tether, a net or a hand: the flight ends in the same way, and nobody is convicted.
"""

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Annotated, Literal, NamedTuple, Protocol

import msgspec

from groundstation.core.geometry import angle_deg, third_column
from groundstation.core.messages import Estimate
from groundstation.core.mission import State
from groundstation.core.safety.geofence import Fence, Separation
from groundstation.core.safety.obedience import STILL_SUSPECTS, PoseEvidence
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import GRAVITY, Motion, Vehicle
from links.core import Command, LinkStatus


class GuardAction(IntEnum):
    """What may follow, in the order of escalation."""

    WARN = 0
    HOLD = 1
    LAND = 2
    DESCEND = 3


class GuardFinding(NamedTuple):
    """A limit that is passed."""

    step: GuardAction
    reason: str
    blind: bool = False
    """True where the estimate of the speed is not to be believed."""
    most: GuardAction = GuardAction.DESCEND
    """The last step that follows where it lasts on: what does not go away by landing is no reason to land worse."""


class Since:
    """Since when each of several conditions has been so, by name. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}

    def lasts(self, name: str, so: bool, now_s: float, for_s: float) -> bool:
        """Whether it is ``so`` and has been at every look for at least ``for_s`` [s]."""
        if not so:
            self._since.pop(name, None)
            return False
        return now_s - self._since.setdefault(name, now_s) >= for_s - 1e-9


class Escalation:
    """Turns findings into steps: each no gentler than the last, the next one where its cause lasts on."""

    def __init__(self, lasting_s: float) -> None:
        self._lasting = lasting_s
        self._step = GuardAction.WARN
        self._at_s = -math.inf

    def answer(self, finding: GuardFinding, now_s: float) -> GuardFinding | None:
        """What to do now about ``finding``; None where the last answer is still at work."""
        if finding.step > self._step:
            answer = finding
        elif self._step < finding.most and now_s - self._at_s > self._lasting:
            answer = GuardFinding(GuardAction(self._step + 1), f"{finding.reason}, still", finding.blind, finding.most)
        else:
            return None
        self._step, self._at_s = answer.step, now_s
        return answer

    def reset(self) -> None:
        """The operator has sent it on: begin anew."""
        self._step, self._at_s = GuardAction.WARN, -math.inf


SWAY_FADES_S = 1.0
"""Time that it leant far off is forgotten so fast [s]."""
SWAY_LONGEST_S = 0.1
"""No two commands count as farther apart [s]."""


class AttitudeOscillationMonitor:
    """For how long one flight leant far off of late. Times are on the event loop's clock [s]."""

    def __init__(self, fades_s: float = SWAY_FADES_S) -> None:
        """Nothing seen; it is forgotten within ``fades_s`` [s]."""
        self._fades_s = fades_s
        self._at_s = -math.inf
        self._far_s = 0.0

    def see(self, now_s: float, far: bool) -> float:
        """Take one more command; ``far`` where it leans far off, on whichever side.

        Returns for how long of about the last second it did [s].
        """
        elapsed, self._at_s = now_s - self._at_s, now_s
        self._far_s *= math.exp(-elapsed / self._fades_s)
        if far:
            self._far_s += min(elapsed, SWAY_LONGEST_S)
        return self._far_s


SURE_S = 0.06
"""What the cameras tell of others must last so long [s]: one pose alone may be another body's."""


class ProximityMonitor:
    """One flight's distance to its geofence and to other vehicles. Times are on the event loop's clock [s]."""

    def __init__(self, fence: Fence | None, separation: Separation | None) -> None:
        """``separation`` is from other vehicles."""
        self._fence = fence
        self._separation = separation
        self._since = Since()

    def outside(self, motion: Motion) -> GuardFinding | None:
        """Beyond the fence, or too fast before it."""
        if self._fence is None:
            return None
        room = self._fence.room_m(motion.position)
        if room < 0.0:
            return GuardFinding(GuardAction.LAND, f"{-room:.2f} m outside the fence")
        if self._fence.braking_room_m(motion.position, motion.velocity) < 0.0:
            speed = math.hypot(*motion.velocity)
            return GuardFinding(GuardAction.HOLD, f"{room:.2f} m before the fence at {speed:.1f} m/s: braking")
        return None

    def near(self, motion: Motion, now_s: float) -> GuardFinding | None:
        """Too near to another vehicle: it brakes in time, and lands where that was not enough.

        Down upon another would be worse than to stay: the one that is lower lands.
        """
        separation = self._separation
        if separation is None:
            return None
        near = separation.nearest(motion.position, motion.velocity, now_s)
        limit = separation.config.distance_m
        if self._since.lasts("too near", near is not None and not near.distance_m >= limit, now_s, SURE_S):
            assert near is not None, "somebody is near"
            step = GuardAction.HOLD if near.beneath else GuardAction.LAND
            return GuardFinding(step, f"{near.distance_m:.2f} m from {near.name}, limit {limit:g} m", most=step)
        if self._since.lasts("nearing", near is not None and not near.room_m >= 0.0, now_s, SURE_S):
            assert near is not None, "somebody comes nearer"
            return GuardFinding(
                GuardAction.HOLD,
                f"{near.distance_m:.2f} m from {near.name} and nearing: braking",
                most=GuardAction.LAND,
            )
        return None

    def unseen(self, now_s: float) -> GuardFinding | None:
        """Where the cameras do not see another vehicle, nobody knows how near it is."""
        if self._separation is None:
            return None
        config, names = self._separation.config, self._separation.unknown(now_s)
        lasts = self._since.lasts("unseen", bool(names), now_s, config.unknown_s)
        if not names:
            return None
        says = f"the cameras have not seen {', '.join(names)} for more than {config.stale_s:g} s"
        step = (
            {"warn": GuardAction.WARN, "hold": GuardAction.HOLD, "land": GuardAction.LAND}[config.unknown]
            if lasts
            else GuardAction.WARN
        )
        return GuardFinding(step, says, most=step)


MEAN_S = 1.5
"""Over which the thrust is averaged [s]."""
FADES_S = 1.0
"""Time that it was far off is forgotten so fast [s]."""
LONGEST_S = 0.1
"""No two commands count as farther apart [s]."""


class ThrustOscillationMonitor:
    """For how long one flight's thrust swung of late. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self._at_s = -math.inf
        self._mean_n = self._low_s = self._high_s = 0.0

    def see(self, now_s: float, thrust_n: float, share: float) -> float:
        """Take one more command; far off is more than ``share`` of the mean, and never where that is infinite.

        Returns for how long of about the last second it was far below or far above, whichever was shorter [s].
        """
        since_s = now_s - self._at_s
        elapsed, fades = min(since_s, LONGEST_S), math.exp(-since_s / FADES_S)
        if self._at_s == -math.inf:
            self._mean_n = thrust_n
        self._at_s = now_s
        self._mean_n += (thrust_n - self._mean_n) * elapsed / (elapsed + MEAN_S)
        off_n, far_n = thrust_n - self._mean_n, share * self._mean_n
        self._low_s = fades * self._low_s + (elapsed if off_n < -far_n else 0.0)
        self._high_s = fades * self._high_s + (elapsed if off_n > far_n else 0.0)
        return min(self._low_s, self._high_s)


Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]
Share = Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]


class GuardsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits in flight. Config section ``[guards]``; docs/explanation/guards.md has what follows beyond each."""

    level_s: Annotated[float, msgspec.Meta(ge=0.0, le=0.75)] = 0.25
    """How long it descends on the model after ``flight.coast_s`` without a pose; then the link brings it down [s]."""
    divergence_m: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] = 0.10
    """Poses that stay farther than this from what the model expects: the estimate has diverged [m]."""
    divergence_s: Seconds = 0.15
    """For how long [s]."""
    tilt_deg: Annotated[float, msgspec.Meta(gt=0.0, le=90.0)] = 50.0
    """Farthest that it may lean [deg]."""
    tilt_s: Seconds = 0.1
    """For how long it may lean farther [s]."""
    tilt_error_deg: Annotated[float, msgspec.Meta(gt=0.0, le=90.0)] = 30.0
    """Farthest from the direction that the reference and the estimated wind ask for [deg]."""
    tilt_error_s: Seconds = 0.3
    """For how long it may be farther from it [s]."""
    sway_deg: Annotated[float, msgspec.Meta(gt=0.0, le=90.0)] = 15.0
    """The same of one that swings, as poses that are older than they say or many lost frames make it [deg]."""
    sway_s: Share = 0.3
    """For how long of about the last second it may be farther [s]."""
    heave: Share = 0.2
    """Share of its mean by which the thrust of a landing may swing, down and up: the same faults near the floor [-]."""
    heave_s: Share = 0.05
    """For how long of about the last second it may be farther down, and farther up [s]."""
    error_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 0.5
    """Farthest from the reference [m]."""
    error_s: Seconds = 0.3
    """For how long it may be farther from it [s]."""
    thrust_limit_s: Seconds = 1.0
    """How long the thrust may be at its upper limit [s]."""
    rate_limit_s: Seconds = 1.0
    """How long a body rate may be at its limit without a break, or as large a share of about the last 2 s [s]."""
    battery_share: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.2
    """Charge below which it lands, where the vehicle tells [-]."""
    battery_v: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | None = None
    """Voltage below which it lands, where the vehicle tells [V]."""
    effectiveness: Share = 0.7
    """λ̂, thrust over told thrust, below which it lands [-]: all that is known of a battery without telemetry."""
    rtt_s: Annotated[float, msgspec.Meta(gt=0.0, le=5.0)] = 0.2
    """Longest round trip to the vehicle and back, where the link knows it [s]."""
    overruns: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 5
    """So many frames that were late by more than one and a half periods, within the last 100, land it."""
    lasting_s: Seconds = 2.0
    """What lasts so long after its answer is answered by the next step [s]."""


class GuardInput(Protocol):
    """What the guards look at of one command; see :class:`groundstation.core.messages.snapshot.Tick`."""

    @property
    def time_s(self) -> float:
        """When it was computed."""
        ...

    @property
    def estimate(self) -> Estimate:
        """What it rests on."""
        ...

    @property
    def reference(self) -> Reference:
        """Where the vehicle should be."""
        ...

    @property
    def command(self) -> Command:
        """What leaves."""
        ...


HEAVE_M, HEAVE_OFF_M = (0.05, 0.5), 0.3
"""Swings count between these heights: above, what the landing began with dies away; below, the floor pushes too [m].
So far from the reference it is on its way back, and thrust does what it must [m]."""
RATE_FADES_S = 2.0
"""Time that a rate was at its limit is forgotten so fast [s]: a limit cycle has breaks."""
FRAMES = 100
"""Over so many frames are late ones counted."""


class Guards:
    """One flight's limits. Times are on the event loop's clock [s]."""

    def __init__(
        self,
        config: GuardsConfig,
        fence: Fence | None,
        vehicle: Vehicle,
        period_s: Callable[[], float],
        separation: Separation | None = None,
        floor_z_m: float = 0.0,
        gravity: float = GRAVITY,
    ) -> None:
        """``period_s`` tells the link's time between two commands [s]; ``separation`` is from other vehicles.

        It is asked with each command: a bridge's is known only once it is connected.
        ``floor_z_m`` is where its pose is when it stands on the floor [m, NED], ``gravity`` the controller's [m/s²].
        """
        self._config = config
        self._around = ProximityMonitor(fence, separation)
        self._thrust_max, self._drag = vehicle.thrust_max_n, vehicle.drag_per_s
        self._rates = tuple(math.radians(limit) for limit in vehicle.rate_limits_deg_s)
        self._period_s = period_s
        self._gravity = gravity
        self._since = Since()
        self._late: list[int] = []
        self._frames = 0
        self._left_s: float | None = None
        self._sway, self._heave, self._floor = AttitudeOscillationMonitor(), ThrustOscillationMonitor(), floor_z_m
        self._fast = AttitudeOscillationMonitor(RATE_FADES_S)

    def see(self, tick: GuardInput, state: State, diverged_m: float) -> GuardFinding | None:
        """The gravest of what one command shows; ``diverged_m`` is how far the newest pose was from the model's."""
        around, motion = self._around, tick.estimate.motion
        found = [
            self._divergence(tick, diverged_m),
            self._tilt(tick),
            around.outside(motion),
            around.near(motion, tick.time_s),
            around.unseen(tick.time_s),
            self._overrun(tick.time_s),
        ]
        if state is not State.DESCENT:  # it has no reference, and its thrust and rates are what they are
            found += [
                self._tilt_error(tick), self._error(tick), self._thrust(tick), self._rate(tick), self._weak(tick),
                self._heaves(tick, state),
            ]  # fmt: skip
        return max((one for one in found if one is not None), key=lambda one: one.step, default=None)

    def link(self, status: LinkStatus, now_s: float) -> GuardFinding | None:
        """What the link tells."""
        c = self._config
        if self._since.lasts("rtt", status.rtt_s is not None and status.rtt_s > c.rtt_s, now_s, 1.0):
            return _lands(f"round trip of {1e3 * (status.rtt_s or 0.0):.0f} ms, limit {1e3 * c.rtt_s:.0f} ms")
        share, volts = status.battery_share, status.battery_v
        if self._since.lasts("charge", share is not None and share < c.battery_share, now_s, 1.0):
            return _lands(f"battery at {100.0 * (share or 0.0):.0f} %, limit {100.0 * c.battery_share:.0f} %")
        low = c.battery_v is not None and volts is not None and volts < c.battery_v
        if self._since.lasts("volts", low, now_s, 1.0):
            return _lands(f"battery at {volts:.2f} V, limit {c.battery_v:.2f} V")
        return None

    def _divergence(self, tick: GuardInput, diverged_m: float) -> GuardFinding | None:
        c = self._config
        if self._since.lasts("divergence", not diverged_m <= c.divergence_m, tick.time_s, c.divergence_s):
            return GuardFinding(
                GuardAction.DESCEND, f"the estimate has diverged: poses are {diverged_m:.2f} m from it", blind=True
            )
        return None

    def _tilt(self, tick: GuardInput) -> GuardFinding | None:
        c = self._config
        tilt = angle_deg(third_column(tick.estimate.motion.attitude)[2])
        if self._since.lasts("tilt", not tilt <= c.tilt_deg, tick.time_s, c.tilt_s):
            return GuardFinding(GuardAction.DESCEND, f"it leans by {tilt:.0f}°, limit {c.tilt_deg:g}°")
        return None

    def _overrun(self, now_s: float) -> GuardFinding | None:
        left, self._left_s = self._left_s, now_s
        self._frames += 1
        if left is not None and now_s - left > 2.5 * self._period_s():
            self._late.append(self._frames)
        while self._late and self._late[0] <= self._frames - FRAMES:
            self._late.pop(0)
        if len(self._late) < self._config.overruns:
            return None
        return GuardFinding(
            GuardAction.LAND, f"{len(self._late)} of the last {FRAMES} frames were late: this computer is too slow"
        )

    def _tilt_error(self, tick: GuardInput) -> GuardFinding | None:
        c = self._config
        a, d, p = tick.reference.acceleration_ned, tick.estimate.disturbance, tick.estimate.motion.velocity
        k = self._drag
        x, y, z = d[0] - k * p[0] - a[0], d[1] - k * p[1] - a[1], self._gravity + d[2] - k * p[2] - a[2]
        u, v, w = third_column(tick.estimate.motion.attitude)
        cosine = (x * u + y * v + z * w) / max(math.sqrt(x * x + y * y + z * z), 1e-6)
        error = angle_deg(cosine)
        if self._sway.see(tick.time_s, not error <= c.sway_deg) > c.sway_s:
            return GuardFinding(
                GuardAction.DESCEND, f"it swings, {c.sway_deg:g}° and more away from where it should lean"
            )
        if self._since.lasts("tilt error", not error <= c.tilt_error_deg, tick.time_s, c.tilt_error_s):
            return GuardFinding(
                GuardAction.LAND, f"it leans {error:.0f}° away from where it should, limit {c.tilt_error_deg:g}°"
            )
        return None

    def _heaves(self, tick: GuardInput, state: State) -> GuardFinding | None:
        """Whether a landing's thrust swings: near the floor a swing ends in a fall before it shows in how it leans."""
        c = self._config
        place = tick.estimate.motion.position
        low = HEAVE_M[0] < self._floor - place[2] < HEAVE_M[1]
        there = math.dist(place, tick.reference.position_ned) < HEAVE_OFF_M
        share = c.heave if state is State.LANDING and low and there else math.inf
        if self._heave.see(tick.time_s, tick.command.thrust_n, share) > c.heave_s:
            return GuardFinding(
                GuardAction.DESCEND, f"its thrust swings by {100.0 * c.heave:.0f} % and more, down and up"
            )
        return None

    def _error(self, tick: GuardInput) -> GuardFinding | None:
        c = self._config
        error = math.dist(tick.estimate.motion.position, tick.reference.position_ned)
        if self._since.lasts("error", not error <= c.error_m, tick.time_s, c.error_s):
            return GuardFinding(GuardAction.LAND, f"{error:.2f} m from where it should be, limit {c.error_m:g} m")
        return None

    def _thrust(self, tick: GuardInput) -> GuardFinding | None:
        c = self._config
        at_limit = tick.command.thrust_n >= 0.999 * self._thrust_max
        if self._since.lasts("thrust", at_limit, tick.time_s, c.thrust_limit_s):
            return GuardFinding(GuardAction.LAND, f"thrust at its limit for {c.thrust_limit_s:g} s")
        return None

    def _rate(self, tick: GuardInput) -> GuardFinding | None:
        c = self._config
        rates = tick.command.rates_rad_s
        at_limit = any(abs(rate) >= 0.999 * limit for rate, limit in zip(rates, self._rates, strict=True))
        most_s = -RATE_FADES_S * math.expm1(-c.rate_limit_s / RATE_FADES_S)  # what is left of one without a break
        if self._fast.see(tick.time_s, at_limit) >= most_s - 1e-9 and at_limit:
            return GuardFinding(
                GuardAction.LAND, f"a body rate at its limit for {c.rate_limit_s:g} s, or again and again"
            )
        return None

    def _weak(self, tick: GuardInput) -> GuardFinding | None:
        c, found = self._config, tick.estimate.effectiveness
        if self._since.lasts("weak", not found >= c.effectiveness, tick.time_s, 1.0):
            return _lands(f"thrust is {100.0 * found:.0f} % of what is told, limit {100.0 * c.effectiveness:.0f} %")
        return None


def _lands(reason: str) -> GuardFinding:
    """It lands, and nothing worse follows: no landing ends this."""
    return GuardFinding(GuardAction.LAND, reason, most=GuardAction.LAND)


HELD_S = 1.0
"""How long the suspicion that the position stands may last, before it ends the flight [s]."""
WITNESS = 0.5
"""Share of the evidence that convicts where the autopilot's own attitude disagrees with the poses, too [-]."""

ANSWERED, PAROLE_S = 3.0, 0.8
"""Poses that came back after the descent had begun are believed as to speed once so much speaks for them (see
obedience.py), and not at all where that takes longer than so long [s]."""
OLD_SHARE, OLD_S = 0.6, 0.3
"""Poses older than this share of ``flight.coast_s`` for so long [s] are too old to fly by."""

UNDER_M = 0.3
"""No pose is so far under the floor [m]."""
RESETS, RESETS_S = 4, 5.0
"""More resets of an estimate within so long [s] are no corrections of one that flies."""


class Charge(NamedTuple):
    """Why a flight ends because of its poses, or of commands that nobody could fly by."""

    says: str
    accuses: Literal["", "suspicion", "convicted"] = ""
    """``convicted``: the poses lie; ``suspicion``: they do, or the vehicle is held; empty: none can be flown by."""

    @property
    def reason(self) -> str:
        """The sentence for the operator."""
        return f"{self.accuses}: {self.says}" if self.accuses else self.says


class Conviction:
    """One flight's. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self.says = ""
        """The newest line for the operator; empty where there is no news."""
        self._suspected = False
        self._still_since_s: float | None = None

    def look(self, evidence: PoseEvidence, now_s: float, *, led: bool = False, doubted: bool = False) -> Charge | None:
        """What follows from ``evidence``.

        ``led`` where something else than commands moves it; ``doubted`` where the autopilot's own attitude disagrees
        with the poses.
        """
        self.says = ""
        suspect = evidence.suspicious
        if suspect != self._suspected:
            self._suspected = suspect
            share = 100.0 * max(evidence)
            self.says = (
                f"suspicion: {_accusation(evidence)} ({share:.0f} % of what convicts); nothing is learnt from them"
                if suspect
                else "the suspicion has gone: the poses show what the commands do"
            )
        least = WITNESS if doubted else 1.0
        if max(evidence.attitude, evidence.axes, evidence.heading) >= least:
            if led and not doubted:
                return Charge(f"{LED}: down on the model", "suspicion")
            also = ", and the autopilot's own attitude says so, too" if doubted else ""
            return Charge(f"{_accusation(evidence)}{also}: down on the model", "convicted")
        if evidence.push >= 1.0:
            return Charge(f"{_accusation(evidence)}: down on the model", "suspicion")
        if evidence.still < STILL_SUSPECTS:
            self._still_since_s = None
        elif self._still_since_s is None:
            self._still_since_s = now_s
        elif evidence.still >= 1.0 or now_s - self._still_since_s >= HELD_S - 1e-9:
            return Charge(f"{_accusation(evidence)}: down on the model", "suspicion")
        return None


LED = "something else than the commands moves it (a hand, or it is another body)"


def charge_lateness(late_s: float) -> Charge | None:
    """What follows from poses that follow the commands so much later than they say [s]; None where they do not."""
    if late_s == 0.0:
        return None
    why = (
        f"what the poses show follows the commands {1e3 * late_s:.0f} ms later than told "
        "(poses older than they say, or commands that get lost)"
    )
    return Charge(f"{why}: down on the model", "convicted")


def charge_age(age_s: float, coast_s: float, since: Since, now_s: float) -> Charge | None:
    """What follows from poses so old that no loop is stable by them, though no command has passed its deadline.

    They are ``age_s`` old as they come, and commands may rest on one for ``coast_s`` [s]; None where they are not.
    """
    limit_s = OLD_SHARE * coast_s
    if not since.lasts("old", age_s > limit_s, now_s, OLD_S):
        return None
    return Charge(
        f"the poses are {1e3 * age_s:.0f} ms old as they come, limit {1e3 * limit_s:.0f} ms "
        f"({OLD_SHARE:g} of flight.coast_s): down on the model"
    )


def charge_place(height_m: float, astray_m: float) -> Charge | None:
    """What follows from a pose so high above the floor, of a source that may have wandered so far [m]."""
    if height_m > -UNDER_M - astray_m:
        return None
    why = f"the poses show it {-height_m:.2f} m under the floor"
    return Charge(f"{why}: down on the model")


class Resets:
    """How often the source of the poses began anew of late: each time nothing before counts against it any more."""

    def __init__(self) -> None:
        self._count: int | None = None
        self._at_s: list[float] = []

    def charge(self, count: int, now_s: float) -> Charge | None:
        """What follows from its newest ``count``."""
        if self._count is not None and count != self._count:
            self._at_s = [at for at in self._at_s if now_s - at < RESETS_S] + [now_s]
        self._count = count
        if len(self._at_s) <= RESETS:
            return None
        why = f"the estimate behind the poses was reset {len(self._at_s)} times within {RESETS_S:g} s"
        return Charge(f"{why}: down on the model")


class Parole:
    """Poses that come back after the descent has begun for want of them: are they this vehicle's, and new?"""

    def __init__(self) -> None:
        self._missing_s: float | None = None
        self._begun_s: float | None = None

    def begin(self, pose_s: float) -> None:
        """The newest pose, of ``pose_s`` [s], is so old that the descent begins."""
        self._missing_s, self._begun_s = pose_s, None

    def serves(self, pose_s: float) -> bool:
        """Whether poses have come back, the newest of ``pose_s`` [s], that have not proven themselves."""
        return self._missing_s is not None and pose_s > self._missing_s

    def ends(self, answered: float) -> bool:
        """Whether so much speaks for them that they are believed from now on."""
        if answered > ANSWERED:
            self._missing_s = None
        return self._missing_s is None

    def charge(self, now_s: float) -> Charge | None:
        """What follows where it lasts."""
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        if now_s - self._begun_s < PAROLE_S - 1e-9:
            return None
        return Charge("the poses that came back do not show what the commands do: down on the model")


FASTER_M_S, ASIDE_M_S = 1.5, 2.1
"""A failsafe descent levels out: who gets faster across by the first [m/s], and than the second [m/s], does not."""
SINKS_M_S, STAYS_S, RISES_M_S, RISES_S, LIFTS_LESS = 0.12, 0.7, 0.6, 0.3, 0.93
"""With so much less than what hovers [-] it sinks: who moves neither up nor down by the first [m/s] for so long [s], or
by the third [m/s] more upwards than before for the fourth [s], does not."""


class DescentMonitor:
    """Does the vehicle do what a failsafe descent tells it? Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self._slowest, self._sank = math.inf, -math.inf
        self._since = Since()

    def charge(self, motion: Motion, share: float, high: bool, now_s: float) -> Charge | None:
        """What follows from its ``motion`` as the poses show it; on the floor, where it is not ``high``, nothing.

        ``share`` is its thrust as a share of what hovers by the estimate [-].
        """
        u, v, w = motion.velocity
        aside = math.hypot(u, v)
        self._slowest = slowest = min(self._slowest, aside)
        away = aside > ASIDE_M_S and aside > slowest + FASTER_M_S
        if self._since.lasts("away", away, now_s, SURE_S):
            return Charge(f"told to level out it gets faster, {aside:.1f} m/s now: down on the model")
        self._sank = sank = max(self._sank, w)
        rises = high and w < min(sank - RISES_M_S, -SINKS_M_S) and share < LIFTS_LESS
        if self._since.lasts("rises", rises, now_s, RISES_S):
            return Charge(f"thrust does not carry it, and the poses rise at {-w:.1f} m/s: down on the model")
        stays = high and abs(w) < SINKS_M_S and share < LIFTS_LESS
        if self._since.lasts("stays", stays, now_s, STAYS_S):
            return Charge("thrust does not carry it, and the poses show no sinking: down on the model")
        return None


def _accusation(evidence: PoseEvidence) -> str:
    largest = max(evidence)
    if evidence.attitude == largest:
        return (
            "the poses do not turn as the commands turn the vehicle (another body, a picture that stands, "
            "or axes that are set up wrongly: see groundstation carry)"
        )
    if evidence.heading == largest:
        return "the poses turn about the vertical, and no command asks for that"
    if evidence.axes == largest:
        return "the poses move as a mirrored or turned image of the vehicle (check pose.axes with groundstation carry)"
    if evidence.push == largest:
        return (
            "the position does not show what pushes the vehicle (it lies along an axis, or comes late, "
            "or something holds the vehicle)"
        )
    return "the position stands while the vehicle is pushed (something holds it, or the position is not its own)"
