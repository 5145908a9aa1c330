"""What came of one fault in one state, and whether that was safe."""

import math
from collections.abc import Sequence

import msgspec

from tests.proving.faults.deck import FALLS, MOMENTS, TUMBLES, Exemption, Fault, Poses
from tests.proving.faults.judge.thrust import Thrust
from tests.proving.faults.judge.truth import Truth

HIGHEST_M, SIDEWAYS_M, FASTEST_M_S = 1.0, 3.0, 3.0
"""How far a vehicle may go after a fault: above where it was struck or its course, sideways from there; how fast."""
SPOOL_M, SPOOL_M_S = 0.8, 3.0
"""How high a vehicle may come whose lift-off is not seen while thrust rises, and how fast fall from there."""
TOUCHDOWN_M_S, RATES_TOUCHDOWN_M_S, TILT_DEG = 1.0, 2.5, 60.0
"""What a safe end stays below; the second where body rates alone brought it down, without any pose."""
MOST_SHARE, OVER_HOVER_S = 1.25, 0.5
"""After the answer to false poses, or to none: the most thrust as a share of what hovers, and how long above 1."""
LIFT_S = 2.75
"""How long after that answer a command may lift."""
ACKNOWLEDGED_S = 0.1
"""How long after the autopilot took over landing a command may still be under way."""
COURSE_M = 0.5
"""Whoever flies on with false poses is no farther from the course than this."""
JUDGED_S = 5.0
"""How long after the strike what poses alone can't tell is judged."""
CONVICTED = "convicted:"
"""How the reason of an answer begins that convicts the poses."""

LIMITS = (
    ("rises above where it was struck, or above its course if that is higher", f"{HIGHEST_M:g} m"),
    ("the same, where no lift-off is seen, so that the motors only stop", f"{SPOOL_M:g} m"),
    ("goes sideways from where it was struck, carried along with its course", f"{SIDEWAYS_M:g} m"),
    ("moves", f"{FASTEST_M_S:g} m/s"),
    ("leans", f"{TILT_DEG:g}°"),
    ("meets the floor where an attitude loop is there, or poses are true", f"{TOUCHDOWN_M_S:g} m/s"),
    ("meets the floor on body rates alone, without any pose", f"{RATES_TOUCHDOWN_M_S:g} m/s"),
    ("meets the floor where no lift-off was seen", f"{SPOOL_M_S:g} m/s"),
    ("after the answer to false or missing poses: thrust", f"{MOST_SHARE:g}x what hovers"),
    ("after that answer: thrust above what hovers (3 % more still count as hovering), in all", f"{OVER_HOVER_S:g} s"),
    ("after that answer: commands that lift", f"{LIFT_S:g} s"),
    ("after the autopilot has acknowledged LAND: commands that lift", f"none ({ACKNOWLEDGED_S:g} s under way)"),
    ("flies on with false poses: distance from the course", f"{COURSE_M:g} m"),
)
"""What is limited, and by how much; for people."""

Answer = tuple[float, str, str]
"""When, what and why."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One cell of the deck."""

    fault: str
    state: str
    link: str
    scenario: str
    struck_s: float | None
    """When it was struck, from the beginning of the flight [s]; None where a flight in real time never came to it."""
    reaction: str
    """The states that it led to; ``flies on`` where the flight went on as planned."""
    answer_ms: float | None
    """From the fault to the first of these; None where there was none."""
    highest_m: float
    """Highest above where it was struck or its course."""
    sideways_m: float
    """Farthest sideways from where it was struck, carried along with its course."""
    fastest_m_s: float
    peak_error_m: float
    """Farthest from the reference; where none is followed any more, sideways from where that began."""
    touchdown_m_s: float | None
    """Fastest that it met the floor; None where it did not leave it."""
    drift_m: float
    """Sideways, from where it was struck to where it stands in the end."""
    tilt_deg: float
    """Farthest that it leant after the fault."""
    over_hover_s: float
    """For how long commands pushed more than what hovers after the answer."""
    exemption: str
    """What was not asked of it, a word of :class:`tests.proving.faults.deck.fault.Exemption`; mostly empty."""
    safe: bool
    why: str
    """Why it is not; else what the flight said of it."""


def exempted(fault: Fault, state: str) -> Exemption:
    """What can't be asked of ``fault`` in ``state``: who has not left the floor does not fall."""
    flying = MOMENTS[state].flying or fault.exemption is Exemption.NOT_OBSERVABLE
    return fault.exemption if flying else Exemption.NONE


def broken(fault: Fault, state: str, truth: Truth, exemption: Exemption) -> str:
    """The first limit on its motion that is broken already; empty where none is."""
    highest_m = SPOOL_M if _unseen(state, truth) else HIGHEST_M
    if not truth.highest_m <= highest_m:
        return f"it rose {truth.highest_m:.2f} m above where it was struck and its course"
    if exemption is not Exemption.NO_LINK and not truth.sideways_m < SIDEWAYS_M:
        return f"it went {truth.sideways_m:.2f} m sideways"
    if exemption not in FALLS and not truth.fastest_m_s <= FASTEST_M_S:
        return f"it moved at {truth.fastest_m_s:.2f} m/s"
    if exemption not in TUMBLES and not truth.tilt_deg <= TILT_DEG:
        return f"it leant by {truth.tilt_deg:.0f}°"
    return ""


def judged(
    name: str,
    fault: Fault,
    state: str,
    truth: Truth,
    answers: Sequence[Answer],
    *,
    wrong: str,
    exemption: Exemption,
    begun_s: float,
    drift_m: float,
    touchdown_m_s: float | None,
    thrust: Thrust | None = None,
    land_s: float | None = None,
    scenario: str = "paper",
    how: str = "",
) -> Row:
    """The row, safe where nothing is wrong: neither what the caller found nor how it moved.

    ``answers`` are what ``fault`` led to, the first one first, in a flight that began at ``begun_s`` [s];
    ``exemption`` is what can't be asked of it, ``land_s`` when its autopilot took over landing, where it was asked to,
    ``thrust`` what the commands pushed with, where that was seen, and ``how`` it was flown.
    """
    found = [
        wrong,
        broken(fault, state, truth, exemption),
        "" if exemption in FALLS else _too_hard(fault, state, truth, touchdown_m_s),
        "" if thrust is None else _pushed(fault, thrust, land_s),
        _flew_on(fault, truth, answers, exemption),
        _convicted(fault, answers),
    ]
    wrong = next((one for one in found if one), "")
    said = answers[0][2] if answers else ""
    answer_ms = round(1e3 * (answers[0][0] - truth.struck_s), 1) if answers else None
    return Row(
        fault=name,
        state=state,
        link=fault.link,
        scenario=scenario,
        struck_s=round(truth.struck_s - begun_s, 4) if math.isfinite(truth.struck_s) else None,
        reaction=" → ".join(dict.fromkeys(after for _, after, _ in answers)) or "flies on",
        answer_ms=answer_ms,
        highest_m=round(truth.highest_m, 3),
        sideways_m=round(truth.sideways_m, 3),
        fastest_m_s=round(truth.fastest_m_s, 3),
        peak_error_m=round(truth.off_m, 3),
        touchdown_m_s=None if touchdown_m_s is None else round(touchdown_m_s, 3),
        drift_m=round(drift_m, 3),
        tilt_deg=round(truth.tilt_deg, 1),
        over_hover_s=0.0 if thrust is None else round(thrust.over_s, 3),
        exemption=str(exemption),
        safe=not wrong,
        why=wrong or "; ".join(part for part in (said, how) if part),
    )


def _unseen(state: str, truth: Truth) -> bool:
    """Whether no lift-off was seen, so that it was told nothing but to rise: all that helps is to stop the motors."""
    return not MOMENTS[state].flying and not truth.led


def _too_hard(fault: Fault, state: str, truth: Truth, touchdown_m_s: float | None) -> str:
    """Nobody sees, and there is no attitude loop: then body rates alone bring it down."""
    by_rates = fault.link != "mavlink" and fault.poses is not Poses.TRUE
    most = SPOOL_M_S if _unseen(state, truth) else RATES_TOUCHDOWN_M_S if by_rates else TOUCHDOWN_M_S
    met = touchdown_m_s is None or touchdown_m_s < most
    return "" if met else f"it met the floor at {touchdown_m_s:.2f} m/s"


def _pushed(fault: Fault, thrust: Thrust, land_s: float | None) -> str:
    """What commands pushed with after the answer; while poses are true a law may push as it must."""
    if land_s is not None and thrust.last_lift_s > land_s + ACKNOWLEDGED_S:
        return f"a command that lifts left {thrust.last_lift_s - land_s:.2f} s after LAND was acknowledged"
    if fault.poses is Poses.TRUE:
        return ""
    if thrust.most > MOST_SHARE:
        return f"after the answer a command pushed with {thrust.most:.2f}x what hovers"
    if thrust.over_s > OVER_HOVER_S:
        return f"after the answer commands pushed with more than what hovers for {thrust.over_s:.2f} s"
    lifted_s = thrust.last_lift_s - thrust.answered_s
    return f"a command that lifts left {lifted_s:.2f} s after the answer" if lifted_s > LIFT_S else ""


def _flew_on(fault: Fault, truth: Truth, answers: Sequence[Answer], exemption: Exemption) -> str:
    if fault.poses is not Poses.FALSE or answers or exemption is Exemption.NOT_OBSERVABLE:
        return ""
    return "" if truth.off_m <= COURSE_M or not truth.led else f"it flew on {truth.off_m:.2f} m off its course"


def _convicted(fault: Fault, answers: Sequence[Answer]) -> str:
    """False answers, where poses are true and the vehicle obeys."""
    said = next((why for _, _, why in answers if why.startswith(CONVICTED)), "") if fault.obeys else ""
    return f"true poses were convicted: {said}" if said else ""
