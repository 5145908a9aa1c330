"""Judge: what came of one fault in one state, and whether that was safe.

``Truth`` sees how the vehicle moves, ``Thrust`` what the commands push with once a fault was
answered, and ``WireJudge`` each frame that leaves: it must be the newest command (or the one
before, in the instant in which the newest is made) before its deadline, or the part of its
bring-down whose time it is.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from groundstation.core.geometry import Vec3, so3
from groundstation.core.health import Failure
from groundstation.core.messages import IdleRecord, TickRecord
from groundstation.core.mission import State
from groundstation.recording import Record
from groundstation.settings import Config
from links.core import Command, Segment, signal
from links.mavlink import MavlinkLinkConfig
from links.mavlink.protocol import MavlinkCodec
from links.rf import Channels, RfLinkConfig
from sim.radio import MODULE
from sim.time import Address
from sim.world import Quadrotor
from tests.proving.faults.fault import (
    FALLS,
    MOMENTS,
    TUMBLES,
    Exemption,
    Fault,
    Kind,
    Poses,
    name_of,
)
from tests.proving.faults.monitors import FAILED, NOT_BY_ATTITUDE

OFF_FLOOR_M = 0.02
"""Higher than this above the floor it flies [m]."""
RECENT_S = 0.1
"""A reference that was told so long ago at most still counts as the present one [s]."""


class Truth:
    """One flight. Times are on the event loop's clock [s]."""

    def __init__(self, floor_z_m: float) -> None:
        """The floor is at ``floor_z_m`` [m, NED]."""
        self.plant: Quadrotor
        """To be set before the first step."""
        self.struck_s = math.inf
        """Time from which on it counts [s]."""
        self.struck_ned: Vec3 = (0.0, 0.0, 0.0)
        """Place at which it was struck [m]."""
        self.off_m = 0.0
        """Farthest from the reference, or sideways from where there was none any more."""
        self.highest_m = 0.0
        """Highest above where it was struck, and above the highest point of the course since."""
        self.sideways_m = 0.0
        """Farthest sideways from where it was struck, carried along with the course since."""
        self.fastest_m_s = 0.0
        """Fastest that it moved."""
        self._floor = floor_z_m
        self._over = False
        self._upright = 1.0
        self._referred_s = -math.inf
        self._from: Vec3 | None = None
        self._told: Vec3 | None = None
        """The reference when it was struck, or the first one after."""
        self._before: Vec3 = (0.0, 0.0, 0.0)
        self._course: Vec3 = (0.0, 0.0, 0.0)
        self._top = math.inf

    @property
    def tilt_deg(self) -> float:
        """Farthest that it leant."""
        return so3.angle_deg(self._upright)

    @property
    def far_m(self) -> float:
        """Farthest from the reference, or sideways from where it would be [m]."""
        return max(self.off_m, self.sideways_m)

    @property
    def led(self) -> bool:
        """Whether there was a course since it was struck."""
        return self._told is not None

    def strike(self, time_s: float) -> None:
        """Begin to judge at ``time_s`` [s]."""
        self.struck_s = time_s
        self.struck_ned = self._course = self.plant.truth(time_s).position_ned
        self._top = self.struck_ned[2]
        self._told = self._before if time_s - self._referred_s <= RECENT_S else None

    def end(self) -> None:
        """Nothing counts any more."""
        self._over = True

    def step(self, time_s: float, position: Vec3) -> None:
        """One step of the plant."""
        if self._over or time_s < self.struck_s:
            return
        self._upright = min(self._upright, so3.third_column(self.plant.attitude)[2])
        self.fastest_m_s = max(self.fastest_m_s, math.hypot(*self.plant.velocity))
        self.highest_m = max(self.highest_m, self._top - position[2])
        self.sideways_m = max(self.sideways_m, math.dist(self._course[:2], position[:2]))
        if self._floor - position[2] < OFF_FLOOR_M:
            return
        if time_s - self._referred_s > RECENT_S:
            self._from = self._from or position
            self.off_m = max(self.off_m, math.dist(self._from[:2], position[:2]))

    def refer(self, time_s: float, position: Vec3, velocity: Vec3, at_s: float) -> None:
        """At ``time_s`` it is told to be at ``position`` with ``velocity`` at ``at_s``."""
        self._referred_s, self._from = time_s, None
        back = time_s - at_s
        x, y, z = (p + back * v for p, v in zip(position, velocity, strict=True))
        self._before = x, y, z
        if self._over or time_s < self.struck_s:
            return
        if self._told is None:
            self._told = self._before
        north, east, down = (
            s + p - q for s, p, q in zip(self.struck_ned, self._before, self._told, strict=True)
        )
        self._course = north, east, down
        self._top = min(self._top, down)
        self.off_m = max(self.off_m, math.dist(self._before, self.plant.truth(time_s).position_ned))


OVER = 1.03
"""Share of the true thrust in the wind up to which a thrust counts as hovering [-]: it is known so
well."""
LIFTS = 0.01
"""A smaller share of the thrust lifts nothing."""


class Thrust:
    """The commands of one flight, as they leave. Times are on the event loop's clock [s]."""

    def __init__(
        self, hover_n: float, newtons: Callable[[float, float], float], held_s: float
    ) -> None:
        """``hover_n`` hovers in the wind [N]; ``newtons(time_s, signal)`` is what a signal gives.

        A signal (0..1) counts until the next one, or for as long as it is held: ``held_s`` [s].
        """
        self.answered_s = math.inf
        """Time from which on it counts [s]: in open loop, and no older command is under way."""
        self.decided_s = math.inf
        """When the first answer came."""
        self.decided_height_m = 0.0
        """Height above the floor then [m]."""
        self.most = 0.0
        """The most thrust since, as a share of what hovers."""
        self.over_s = 0.0
        """For how long altogether it was more than that [s]."""
        self.last_lift_s = -math.inf
        """When a frame last left that lifts, at any time."""
        self._hover = hover_n
        self._newtons = newtons
        self._held = held_s
        self._over = False
        self._newest: tuple[float, float] | None = None

    def command(self, time_s: float, signal: float) -> None:
        """A command leaves."""
        if self._over:
            return
        if signal > LIFTS:
            self.last_lift_s = time_s
        self._close(time_s)
        if time_s >= self.answered_s:
            share = self._newtons(time_s, signal) / self._hover
            self.most = max(self.most, share)
            self._newest = time_s, share

    def end(self, time_s: float) -> None:
        """The flight is over: nothing counts any more."""
        self._close(time_s)
        self._over = True

    def _close(self, time_s: float) -> None:
        if self._newest is not None and self._newest[1] > OVER:
            self.over_s += min(time_s - self._newest[0], self._held)
        self._newest = None


class MotionLimits(NamedTuple):
    """Limits on how far and how fast a vehicle moves."""

    up_m: float
    """Highest above where it was struck, or above its course."""
    aside_m: float
    """Farthest sideways from there."""
    speed_m_s: float


STRICT = MotionLimits(up_m=1.0, aside_m=3.0, speed_m_s=3.0)
"""Limits of all rows but those of known limits (docs/explanation/trust.md)."""
KNOWN = MotionLimits(up_m=2.0, aside_m=5.0, speed_m_s=4.5)
"""Limits of those."""
SPOOL_M = 0.8
"""Highest without a lift-off that is seen: thrust rises, and then the motors stop [m]."""
TOUCHDOWN_M_S = 1.0
"""Fastest touchdown where the height is believed, or an autopilot flies [m/s]."""
RATES_TOUCHDOWN_M_S = 2.5
"""Fastest touchdown behind a radio where the height is not believed any more [m/s]."""
TILT_DEG = 60.0
"""Farthest lean [deg]."""
MOST_SHARE = 1.25
"""Most thrust in an open-loop descent, as a share of what hovers [-]."""
OVER_HOVER_S = 0.5
"""Longest time in an open-loop descent with more thrust than hovers, in all [s]."""
LIFT_SINK_M_S = 0.7
"""Sink rate that a descent has at least, from the height at which it was decided [m/s]."""
LIFT_MORE_S = 2.0
"""Time that a command may lift beyond that [s]."""
ACKNOWLEDGED_S = 0.1
"""Time that a command may be under way after the autopilot took over landing [s]."""
COURSE_M = 0.5
"""Farthest from the course with false poses that go unnoticed [m]."""
JUDGED_S = 5.0
"""When a flight that poses alone can't tell from a true one is judged [s after the strike]."""
NEAR_LIMIT = 1.5
"""No cell of a required family goes beyond this share of a limit [-]."""
REQUIRED_SHARE = 0.97
"""Share of the cells of required families that must be within the limits [-]."""
KNOWN_SHARE = 0.9
"""Share of the cells of known limits that must be within theirs [-]."""
GUARDED_SHARE = 1.5
"""An honest flight is so much faster or farther off than without guards, at most [-] …"""
GUARDED_M_S = 0.5
"""… and so much more [m/s] …"""
GUARDED_M = 0.2
"""… and so much more [m]."""

LIMITS = (
    f"rises above where it was struck, or above its course: {STRICT.up_m:g} m",
    f"the same, where no lift-off is seen, so that the motors only stop: {SPOOL_M:g} m",
    f"goes sideways from where it was struck, carried along its course: {STRICT.aside_m:g} m",
    f"moves: {STRICT.speed_m_s:g} m/s",
    f"known limits: up, sideways, speed: {KNOWN.up_m:g} m, {KNOWN.aside_m:g} m, "
    f"{KNOWN.speed_m_s:g} m/s",
    f"leans: {TILT_DEG:g}°",
    "meets the floor; behind a radio where the height failed; without a lift-off that was seen: "
    f"{TOUCHDOWN_M_S:g}; {RATES_TOUCHDOWN_M_S:g}; {STRICT.speed_m_s:g} m/s",
    f"thrust in an open-loop descent, and above what hovers in all: {MOST_SHARE:g}x what hovers, "
    f"{OVER_HOVER_S:g} s",
    f"commands lift after the answer: height / {LIFT_SINK_M_S:g} m/s + {LIFT_MORE_S:g} s",
    f"flies on with false poses: distance from the course: {COURSE_M:g} m",
    "honest rows: speed and distance of the same flight without guards: "
    f"{GUARDED_SHARE:g}x + {GUARDED_M_S:g} m/s, {GUARDED_SHARE:g}x + {GUARDED_M:g} m",
)
"""Limits and their values, for people."""


class Measure(NamedTuple):
    """One figure against its limit."""

    share: float
    """Figure as a share of its limit [-]."""
    says: str
    """Figure in words."""


OPEN_LOOP = "open loop"
"""End of a flight whose commands follow no pose."""
AUTOPILOT_LANDS = "autopilot lands"
"""Answer of an autopilot whose set-points have stopped: its own failsafe."""
NO_HEIGHT = (str(State.ABORTED), str(State.DESCENT))
"""Answers after which the height of the poses is not believed any more."""
DOWN_M = 0.15
"""Commands that end below this height leave the vehicle on the floor [m]: a fall of 1.7 m/s."""
ON_FLOOR = "on the floor"
"""End of a flight whose commands end on the floor, or had not left it."""
LANDS_ITSELF = "autopilot's LAND"
"""End of a flight whose autopilot lands by its own position."""
Answer = tuple[float, str, str]
"""When, what and why."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One cell of the deck."""

    fault: str
    variant: str = ""
    """Value that the fault is flown with; empty where there is one only."""
    family: str = ""
    kind: str = ""
    """Rule of judgement, a word of :class:`tests.proving.faults.fault.Kind`."""
    state: str
    link: str
    scenario: str
    seed: int = 0
    struck_s: float | None
    """When it was struck, from the beginning of the flight [s]; None where it never came to it."""
    reaction: str
    """The states that it led to; ``flies on`` where the flight went on as planned."""
    answer_ms: float | None
    """Time from the fault to the first answer [ms]; None where there was none."""
    highest_m: float
    """Highest above where it was struck or its course."""
    sideways_m: float
    """Farthest sideways from where it was struck, carried along with its course."""
    fastest_m_s: float
    far_m: float = 0.0
    """Farthest from the reference, or sideways from where it would be [m]."""
    peak_error_m: float
    """Farthest from the reference; where none is followed, sideways from where that began."""
    touchdown_m_s: float | None
    """Fastest that it met the floor; None where it did not leave it."""
    drift_m: float
    """Sideways, from where it was struck to where it stands in the end."""
    tilt_deg: float
    """Farthest that it leant after the fault."""
    over_hover_s: float
    """For how long commands pushed more than what hovers after the answer."""
    exemption: str
    """Waived demands, a word of :class:`tests.proving.faults.fault.Exemption`; mostly empty."""
    ended: str = ""
    """Ending: flies on, holds, lands, descends (each in closed loop), open loop."""
    worst: float = 0.0
    """Largest figure as a share of its limit [-]."""
    unguarded_m_s: float | None = None
    """Fastest in the same flight without monitor and guards; None where that is not flown [m/s]."""
    unguarded_m: float | None = None
    """Farthest off in it [m]."""
    forced: str = ""
    """Doubt that was forced upon it; mostly empty."""
    safe: bool
    why: str
    """Why it is not; else what the flight said of it."""


class Observations(NamedTuple):
    """Observations of one flight."""

    truth: Truth
    answers: Sequence[Answer] = ()
    """Answers to the fault, the first one first."""
    wrong: str = ""
    """Broken rule that has no figure; empty where nothing did."""
    exemption: Exemption = Exemption.NONE
    begun_s: float = 0.0
    """When the flight began [s]."""
    drift_m: float = 0.0
    """Sideways distance from the strike to the end [m]."""
    touchdown_m_s: float | None = None
    """Fastest touchdown [m/s]; None without any."""
    thrust: Thrust | None = None
    """The commands; None where they were not noted."""
    land_s: float | None = None
    """When the autopilot, which was asked to land, began to [s]; None where it did not."""
    failure: Failure | None = None
    blind: bool = False
    """Whether it came down without poses."""
    height_believed: bool = True
    """Whether the commands have always used the height of the poses since the strike."""
    aborted_m: float = math.inf
    """Height above the floor at which commands ended [m]."""


def exemption_of(fault: Fault, state: str) -> Exemption:
    """Return the demands waived in ``state``: a vehicle on the floor does not fall."""
    flying = MOMENTS[state].flying or fault.exemption is Exemption.NOT_OBSERVABLE
    return fault.exemption if flying else Exemption.NONE


def measure(fault: Fault, state: str, seen: Observations) -> list[Measure]:
    """Return the figures of a flight against their limits."""
    truth, exemption = seen.truth, seen.exemption
    known = fault.kind is Kind.KNOWN_LIMIT
    most = KNOWN if known else STRICT
    if _unseen(state, truth) and not known:
        most = most._replace(up_m=SPOOL_M)
    up_m, aside_m, speed_m_s = truth.highest_m, truth.sideways_m, truth.fastest_m_s
    rose = f"it rose {up_m:.2f} m above where it was struck and its course"
    found = [Measure(up_m / most.up_m, rose)]
    if exemption is not Exemption.NO_LINK:
        found.append(Measure(aside_m / most.aside_m, f"it went {aside_m:.2f} m sideways"))
    if exemption not in FALLS:
        found.append(Measure(speed_m_s / most.speed_m_s, f"it moved at {speed_m_s:.2f} m/s"))
    if known:
        return found
    if exemption not in TUMBLES:
        found.append(Measure(truth.tilt_deg / TILT_DEG, f"it leant by {truth.tilt_deg:.0f}°"))
    if exemption not in FALLS and seen.touchdown_m_s is not None:
        found.append(_measure_touchdown(fault, state, seen, seen.touchdown_m_s))
    if seen.thrust is not None and fault.poses is not Poses.TRUE:
        found += _measure_lift(seen.thrust)
    return found


def judge(name: str, fault: Fault, state: str, seen: Observations, scenario: str = "paper") -> Row:
    """Return the row of ``fault`` in ``state``: safe where nothing is wrong, no limit broken."""
    truth, answers, thrust = seen.truth, seen.answers, seen.thrust
    measured = measure(fault, state, seen)
    wrong = seen.wrong
    if fault.kind is not Kind.HONEST:  # that one is judged beside the same one without guards
        wrong = wrong or _find_wrong(fault, seen, measured)
    first_s, _, said = answers[0] if answers else (math.nan, "", "")
    hit_m_s = seen.touchdown_m_s
    return Row(
        fault=name_of(name),
        variant=name.partition(": ")[2],
        family=fault.family,
        kind=str(fault.kind),
        state=state,
        link=fault.link,
        scenario=scenario,
        struck_s=round(truth.struck_s - seen.begun_s, 4) if truth.struck_s < math.inf else None,
        reaction=" → ".join(dict.fromkeys(after for _, after, _ in answers)) or "flies on",
        answer_ms=round(1e3 * (first_s - truth.struck_s), 1) if answers else None,
        highest_m=round(truth.highest_m, 3),
        sideways_m=round(truth.sideways_m, 3),
        fastest_m_s=round(truth.fastest_m_s, 3),
        far_m=round(truth.far_m, 3),
        peak_error_m=round(truth.off_m, 3),
        touchdown_m_s=None if hit_m_s is None else round(hit_m_s, 3),
        drift_m=round(seen.drift_m, 3),
        tilt_deg=round(truth.tilt_deg, 1),
        over_hover_s=0.0 if thrust is None else round(thrust.over_s, 3),
        exemption=str(seen.exemption),
        ended=name_end(seen),
        worst=round(max(one.share for one in measured), 3),
        safe=not wrong,
        why=wrong or said,
    )


ENDS = {
    State.ABORTED: OPEN_LOOP,
    State.DESCENT: "descends",
    State.LANDING: "lands",
    State.HOLD: "holds",
}
"""Ending by the states that answers lead to; the first one counts that is among the answers."""


def name_end(seen: Observations) -> str:
    """Return how a flight ended, by its answers."""
    states = [after for _, after, _ in seen.answers]
    if not states:
        return "flies on"
    if seen.aborted_m < DOWN_M:
        states = [state for state in states if state != State.ABORTED]
    if seen.land_s is not None and State.ABORTED in states:
        return LANDS_ITSELF
    if seen.blind or AUTOPILOT_LANDS in states:
        return OPEN_LOOP
    return next((end for state, end in ENDS.items() if state in states), (states or [ON_FLOOR])[-1])


def judge_honest(row: Row, unguarded: Row, *, must_fly_on: bool) -> Row:
    """Return ``row`` of an honest disturbance, held against the same flight without guards."""
    fast = GUARDED_SHARE * unguarded.fastest_m_s + GUARDED_M_S
    far = GUARDED_SHARE * unguarded.far_m + GUARDED_M
    wrong = ""
    blind = row.forced.removeprefix(FAILED) in NOT_BY_ATTITUDE
    if not row.safe:
        wrong = row.why
    elif row.ended == OPEN_LOOP and not blind:
        wrong = f"true poses, and it came down in open loop: {row.why}"
    elif must_fly_on and row.ended != "flies on":
        wrong = f"it does not fly on: {row.why}"
    elif row.fastest_m_s > fast:
        wrong = f"{row.fastest_m_s:.2f} m/s, unguarded {unguarded.fastest_m_s:.2f} m/s"
    elif row.far_m > far:
        wrong = f"{row.far_m:.2f} m off, unguarded {unguarded.far_m:.2f} m"
    return replace(
        row,
        unguarded_m_s=unguarded.fastest_m_s,
        unguarded_m=unguarded.far_m,
        worst=round(max(row.fastest_m_s / fast, row.far_m / far), 3),
        safe=not wrong,
        why=wrong or row.why,
    )


def _unseen(state: str, truth: Truth) -> bool:
    """Whether no lift-off was seen: it was only told to rise, and all that helps is to stop."""
    return not MOMENTS[state].flying and not truth.led


def _measure_touchdown(
    fault: Fault, state: str, seen: Observations, touchdown_m_s: float
) -> Measure:
    """Return the touchdown: harder where neither height nor an attitude loop is left.

    Without a lift-off that is seen the motors only stop: no more than its speed is limited.
    """
    doubted = not seen.height_believed or any(after in NO_HEIGHT for _, after, _ in seen.answers)
    most = TOUCHDOWN_M_S
    if _unseen(state, seen.truth):
        most = STRICT.speed_m_s
    elif fault.link != "mavlink" and fault.poses is not Poses.TRUE and doubted:
        most = RATES_TOUCHDOWN_M_S
    return Measure(touchdown_m_s / most, f"it met the floor at {touchdown_m_s:.2f} m/s")


def _measure_lift(thrust: Thrust) -> list[Measure]:
    """Return for how long commands lifted after the answer to false or missing poses."""
    lifted_s = thrust.last_lift_s - thrust.decided_s
    if not lifted_s > 0.0:
        return []
    most_s = thrust.decided_height_m / LIFT_SINK_M_S + LIFT_MORE_S
    says = f"a command that lifts left {lifted_s:.2f} s after the answer"
    return [Measure(lifted_s / most_s, says)]


def _find_wrong(fault: Fault, seen: Observations, measured: Sequence[Measure]) -> str:
    """Find the first limit or rule that a flight broke; empty where it kept all."""
    for one in measured:
        if not one.share <= 1.0:
            return one.says
    if seen.thrust is not None and fault.kind is not Kind.KNOWN_LIMIT:
        pushed = _judge_push(fault, seen.thrust, seen.land_s)
        if pushed:
            return pushed
    must_find = fault.poses is Poses.FALSE and seen.exemption is not Exemption.NOT_OBSERVABLE
    is_off = seen.truth.led and not seen.truth.off_m <= COURSE_M
    if must_find and is_off and not seen.answers:
        return f"it flew on {seen.truth.off_m:.2f} m off its course"
    if fault.obeys and seen.failure is not None and seen.failure.id.startswith("pose."):
        return f"true poses failed: {seen.failure.reason}"
    return ""


def _judge_push(fault: Fault, thrust: Thrust, land_s: float | None) -> str:
    """Judge the thrust of an open-loop descent; while poses are true a law may push as it must."""
    if land_s is not None and thrust.last_lift_s > land_s + ACKNOWLEDGED_S:
        late_s = thrust.last_lift_s - land_s
        return f"a command that lifts left {late_s:.2f} s after LAND was acknowledged"
    if fault.poses is Poses.TRUE:
        return ""
    if thrust.most > MOST_SHARE:
        return f"after the answer a command pushed with {thrust.most:.2f}x what hovers"
    if thrust.over_s > OVER_HOVER_S:
        over = f"{thrust.over_s:.2f} s"
        return f"after the answer commands pushed with more than what hovers for {over}"
    return ""


AGREES = 2e-6
"""32-bit floats agree so well with what they were made of [-]."""
INSTANT_S = 2e-6
"""Timers fire up to a clock's tick early or late [s]."""


class WireJudge:
    """The frames of one flight."""

    def __init__(self, config: Config, thrust: Thrust) -> None:
        """``config`` says how the commands leave; ``thrust`` hears what each pushes with."""
        self.wrong = ""
        """The first thing that must not have left; empty where there is none."""
        self.last_s = -math.inf
        """When anything last left."""
        self._config = config
        self._thrust = thrust
        self._commands: deque[Command] = deque(maxlen=4)
        self._port = None
        self._sticks: tuple[Channels, float] | None = None
        link = config.link
        if isinstance(link, MavlinkLinkConfig):
            self._port = int(link.endpoint.rpartition(":")[2])
            self._codec = MavlinkCodec(1, 1)
        elif isinstance(link, RfLinkConfig):
            codec = link.codec()
            self._decoder = codec.decoder()
            channels = Channels(
                link.with_thrust_curve(0.0).map, count=codec.channels, thrust_max_n=1.0
            )
            self._sticks = channels, link.lead_s + link.period_s

    def record(self, record: Record) -> None:
        """Take what the flight hands to its recorder."""
        if isinstance(record, TickRecord):
            self._commands.append(record.tick.command)
        elif isinstance(record, IdleRecord):
            self._commands.append(record.command)

    def tap(self, time_s: float, source: Address, target: Address, data: bytes) -> None:
        """Take one datagram of the simulated network."""
        if source[1] == self._port:
            self.last_s = time_s
            for m in self._codec.feed(data, source):
                if m.get_type() == "SET_ATTITUDE_TARGET":
                    rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
                    self._frame(time_s, rates, m.thrust)
        elif self._sticks is not None and target == MODULE:
            self._radio(time_s, data)

    def _frame(self, time_s: float, rates: Vec3, thrust: float) -> None:
        """Take body rates [rad/s] and thrust (0..1) of a set-point."""
        if not math.isfinite(thrust + sum(rates)):
            self._say(f"a number that is not finite left at {time_s:.3f} s")
        self._thrust.command(time_s, thrust)
        # At the very border of two parts either may be meant.
        borders = (time_s - INSTANT_S, time_s + INSTANT_S)
        for due in {_due(command, at_s) for command in self._commands for at_s in borders}:
            if due is None:
                continue
            share = signal(due.thrust_n / self._config.full_thrust_n, self._config.thrust_curve)
            pairs = zip((thrust, *rates), (share, *due.rates_rad_s), strict=True)
            if all(abs(a - b) < AGREES for a, b in pairs):
                return
        if thrust > LIFTS:
            self._say(f"a command left at {time_s:.3f} s that was not due then")

    def _radio(self, time_s: float, data: bytes) -> None:
        assert self._sticks is not None, "only a radio's frames come here"
        channels, lead_s = self._sticks
        for heard in self._decoder.feed(data):
            self.last_s = time_s
            if heard.positions is None:
                continue
            sticks = channels.read(heard.positions)
            self._thrust.command(time_s, sticks.thrust_n if sticks.armed else 0.0)
            lifts = sticks.armed and sticks.thrust_n > LIFTS
            if lifts and not any(_due(command, time_s - lead_s) for command in self._commands):
                self._say(f"a frame that lifts left at {time_s:.3f} s, and no command was due then")

    def _say(self, wrong: str) -> None:
        self.wrong = self.wrong or wrong


def _due(command: Command, time_s: float) -> Command | Segment | None:
    """Return the part of ``command`` that may leave at ``time_s`` [s], where no other came."""
    end = command.deadline_s
    if time_s <= end:
        return command
    for part in command.bring_down:
        end += part.duration_s
        if time_s <= end:
            return part
    return None
