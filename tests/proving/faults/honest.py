"""Honest flights, ``groundstation-sim dev honest``: true poses of a vehicle that something moves.

Each flight is flown once more without monitor and guards from the strike on, and judged by that.
"""

import csv
from collections.abc import Sequence
from pathlib import Path

import msgspec

from groundstation.config import refuse_io
from tests.proving.faults.deal import Cell, Planned
from tests.proving.faults.fault import Kind
from tests.proving.faults.faults import CASES, HONEST_STATES
from tests.proving.faults.judge import Row
from tests.proving.faults.table import name_cell

SCENARIOS_FLOWN = ("paper", "quad1kg", "rotors_mqx", "rotors_quad1kg")
"""Scenarios whose vehicles are disturbed: 80 g and 1 kg, and each on four rotors with a rate loop."""
LINKS_FLOWN = ("mavlink", "dsm")
"""With an autopilot that knows its own position, and with none."""
SEEDS = 3
"""Seeds that each disturbance is flown with; each has a direction of its own."""


def plan_honest(
    *,
    scenarios: Sequence[str] = SCENARIOS_FLOWN,
    links: Sequence[str] = LINKS_FLOWN,
    states: Sequence[str] = HONEST_STATES,
    seeds: Sequence[int] = range(SEEDS),
    only: Sequence[str] = (),
    forced: str = "",
) -> list[Planned]:
    """Return the flights of the honest table; ``only`` names cases, empty for all."""
    return [
        Planned(Cell(case, state, link), scenario, seed, forced)
        for scenario in scenarios
        for link in links
        for state in states
        for seed in seeds
        for case, fault in CASES.items()
        if fault.kind is Kind.HONEST and (not only or case in only)
    ]


def tell_honest(rows: Sequence[Row]) -> str:
    """Return a table by disturbance: how the flights ended, and how fast and far they went."""
    lines = [
        f"{'disturbance':26}{'flights':>8}{'fly on':>8}{'land':>6}{'open':>6}{'bad':>5}"
        f"{'fastest':>14}{'farthest off':>16}"
    ]
    for case in dict.fromkeys((row.fault, row.variant) for row in rows):
        some = [row for row in rows if (row.fault, row.variant) == case]
        ends = [row.ended for row in some]
        on, open_loop = ends.count("flies on"), ends.count("open loop")
        bad = sum(not row.safe for row in some)
        fast, far = max(row.fastest_m_s for row in some), max(row.far_m for row in some)
        fast_off = max(row.unguarded_m_s or 0.0 for row in some)
        far_off = max(row.unguarded_m or 0.0 for row in some)
        lines.append(
            f"{': '.join(filter(None, case)):26}{len(some):8}{on:8}"
            f"{len(some) - on - open_loop:6}{open_loop:6}{bad:5}"
            f"{fast:6.2f} ({fast_off:.2f}) {far:8.2f} ({far_off:.2f})"
        )
    for row in rows:
        if not row.safe:
            lines.append(f"  {name_cell(row, seed=True)}: {row.why}")
    bad = sum(not row.safe for row in rows)
    lines.append(f"{len(rows)} flights, {bad} beyond what is allowed (in brackets: unguarded)")
    return "\n".join(lines)


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write ``rows``, a line each.

    Raises:
        ConfigError: the file can't be written.
    """
    with refuse_io("--csv", f"cannot write {path}"), path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, Row.__struct_fields__)
        writer.writeheader()
        writer.writerows(msgspec.to_builtins(row) for row in rows)
