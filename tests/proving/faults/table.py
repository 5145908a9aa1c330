"""The fault deck as text: a line a cell for a terminal, and a page with a line a family."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from groundstation.machine import fill_markers
from tests.proving.faults.fault import FALLS, REASONS, Kind
from tests.proving.faults.faults import FAMILIES, FAULTS, LATE_LIFT_OFF
from tests.proving.faults.judge import (
    KNOWN_SHARE,
    LIMITS,
    NEAR_LIMIT,
    OPEN_LOOP,
    REQUIRED_SHARE,
    Row,
)

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "fault-table.md"
"""The page, with its words."""
HEAD = """\
| family | cells | within | within 1.5x | up, m | aside, m | fastest, m/s | floor, m/s | \
fly on | open loop | beyond the limits |
|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|"""
NAMED = 4
"""Cells beyond the limits that a line of the page names; the command lists them all."""
SAYS = {
    Kind.REQUIRED: "Poses that lie or are lost, required",
    Kind.KNOWN_LIMIT: "Poses that lie, known limits",
    Kind.HONEST: "True poses of a vehicle that something moves",
    Kind.OTHER: "Everything else that breaks",
}
"""Headings of the page."""


def tell_families(rows: Sequence[Row]) -> Iterator[tuple[Kind, str]]:
    """Yield the kind of each family among ``rows``, in the order of the table, and its line."""
    names = [*((name, kind) for name, kind, _ in FAMILIES), (LATE_LIFT_OFF, Kind.KNOWN_LIMIT)]
    for name, kind in sorted(names, key=lambda one: list(SAYS).index(one[1])):
        some = [row for row in rows if row.family == name]
        if not some:
            continue
        held = [row for row in some if row.exemption not in FALLS] or some
        beyond = sorted((row for row in some if not row.safe), key=lambda row: -row.worst)
        told = [f"{name_cell(row)} ({row.worst:.2f}x)" for row in beyond[:NAMED]]
        if len(beyond) > NAMED:
            told.append(f"{len(beyond) - NAMED} more")
        cells = (
            name,
            len(some),
            len(some) - len(beyond),
            sum(row.safe or row.worst <= NEAR_LIMIT for row in some),
            f"{max(row.highest_m for row in held):.2f}",
            f"{max(row.sideways_m for row in held):.2f}",
            f"{max(row.fastest_m_s for row in held):.2f}",
            f"{max(row.touchdown_m_s or 0.0 for row in held):.2f}",
            sum(row.ended == "flies on" for row in some),
            sum(row.ended == OPEN_LOOP for row in some),
            "; ".join(told),
        )
        yield kind, f"| {' | '.join(map(str, cells))} |"


def count_kinds(rows: Sequence[Row]) -> Iterator[tuple[Kind, int, int, int]]:
    """Count for each kind its cells, those within the limits, and those beyond NEAR_LIMIT times."""
    for kind in Kind:
        some = [row for row in rows if row.kind == kind]
        if some:
            far = sum(not row.safe and row.worst > NEAR_LIMIT for row in some)
            yield kind, len(some), sum(row.safe for row in some), far


def tell_kinds(rows: Sequence[Row]) -> list[str]:
    """Return for each kind among ``rows`` how many cells are within their limits."""
    return [
        f"{kind}: {within} of {cells} within ({100.0 * within / cells:.1f} %), {far} beyond "
        f"{NEAR_LIMIT:g}x"
        for kind, cells, within, far in count_kinds(rows)
    ]


def is_within(rows: Sequence[Row]) -> bool:
    """Return whether ``rows`` as a whole are within what is asked of each kind."""
    shares = {Kind.REQUIRED: REQUIRED_SHARE, Kind.KNOWN_LIMIT: KNOWN_SHARE}
    return all(
        within >= shares.get(kind, 1.0) * cells and not (far and kind is Kind.REQUIRED)
        for kind, cells, within, far in count_kinds(rows)
    )


def name_cell(row: Row) -> str:
    """Return the cell of ``row`` in words."""
    what = ": ".join(filter(None, (row.fault, row.variant)))
    where = "" if row.link == "mavlink" else f", {row.link}"
    return f"{what}, {row.state}{where}"


def text(rows: Sequence[Row]) -> str:
    """Return a line a cell, a line a family, and the count."""
    lines = []
    for row in rows:
        verdict = "safe  " if row.safe else "UNSAFE"
        after = "" if row.answer_ms is None else f"after {row.answer_ms:.0f} ms"
        met = "" if row.touchdown_m_s is None else f"floor at {row.touchdown_m_s:.2f} m/s"
        lines.append(
            f"{verdict} {name_cell(row):46} {row.reaction:34}{after:16}"
            f"up {row.highest_m:5.2f} m  aside {row.sideways_m:5.2f} m  "
            f"{row.fastest_m_s:5.2f} m/s  {met}"
        )
        if row.why and not row.safe:
            lines.append(f"       {row.why}")
    lines += ["", HEAD, *(line for _, line in tell_families(rows)), ""]
    bad = sum(not row.safe for row in rows)
    return "\n".join([*lines, *tell_kinds(rows), f"{len(rows)} cells, {bad} unsafe"])


def page(rows: Sequence[Row], command: str) -> str:
    """Return the whole page in Markdown; ``command`` made it."""
    lines: list[str] = []
    for kind, some in groupby(tell_families(rows), key=lambda one: one[0]):
        lines += [f"| **{SAYS[kind]}** |{' |' * 10}", *(line for _, line in some)]
    exempt = "; ".join(f"*{word}*: {why}" for word, why in REASONS.items())
    parts = (
        "\n".join([HEAD, *lines]),
        f"Limits: {'; '.join(LIMITS)}.",
        f"Exempt: {exempt}.",
        f"{'; '.join(tell_kinds(rows))}. {len(FAULTS)} faults, {len(rows)} cells, by `{command}`.",
    )
    return fill_markers(PAGE, {"deck": "\n\n".join(parts)})
