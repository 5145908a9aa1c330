"""What came of one fault in one state, and whether that was safe."""

from collections.abc import Sequence

import msgspec

from sim.deck.faults import Fault
from sim.deck.moments import MOMENTS
from sim.deck.truth import Truth

TOUCHDOWN_M_S, TILT_DEG = 1.0, 60.0
"""What a safe end stays below."""

Answer = tuple[float, str, str]
"""When, what and why."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One cell of the deck."""

    fault: str
    state: str
    reaction: str
    """The states that it led to; ``flies on`` where the flight went on as planned."""
    react_ms: float | None
    """From the fault to the first of these; None where there was none."""
    peak_error_m: float
    """Farthest from the reference; where none is followed any more, sideways from where that began."""
    touchdown_m_s: float | None
    """Fastest that it met the floor; None where it did not leave it."""
    drift_m: float
    """Sideways, from where it was struck to where it stands in the end."""
    tilt_deg: float
    """Farthest that it leant after the fault."""
    safe: bool
    why: str
    """Why it is not; else what the flight said of it, and what could not be asked of it."""


def judged(
    name: str,
    fault: Fault,
    state: str,
    truth: Truth,
    answers: Sequence[Answer],
    *,
    wrong: str,
    robs: str,
    drift_m: float,
    touchdown_m_s: float | None,
    how: str = "",
) -> Row:
    """The row, safe where nothing is wrong: neither what the caller found nor how it moved.

    ``answers`` are what ``fault`` led to, the first one first; ``robs`` is why no soft touchdown can be asked of it
    (empty: it can), and ``how`` it was flown.
    """
    if not fault.frees and not truth.tilt_deg <= TILT_DEG:
        wrong = wrong or f"it leant by {truth.tilt_deg:.0f}°"
    if not robs and touchdown_m_s is not None and not touchdown_m_s < TOUCHDOWN_M_S:
        wrong = wrong or f"it met the floor at {touchdown_m_s:.2f} m/s"
    said = answers[0][2] if answers else ""
    note = f"touchdown not judged: {robs}" if robs and MOMENTS[state].flying else ""
    return Row(
        fault=name,
        state=state,
        reaction=" → ".join(dict.fromkeys(after for _, after, _ in answers)) or "flies on",
        react_ms=round(1e3 * (answers[0][0] - truth.struck_s), 1) if answers else None,
        peak_error_m=round(truth.off_m, 3),
        touchdown_m_s=None if touchdown_m_s is None else round(touchdown_m_s, 3),
        drift_m=round(drift_m, 3),
        tilt_deg=round(truth.tilt_deg, 1),
        safe=not wrong,
        why=wrong or "; ".join(part for part in (said, note, how) if part),
    )
