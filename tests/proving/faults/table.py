"""The fault deck as text: a line a cell for a terminal, and a page with the whole table."""

from collections.abc import Sequence
from pathlib import Path

from groundstation.config import refuse_io
from groundstation.machine import fill_markers
from tests.proving.faults.cell import AUTOPILOT
from tests.proving.faults.fault import REASONS
from tests.proving.faults.faults import FAULTS
from tests.proving.faults.judge import LIMITS, Row

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "fault-table.md"
"""The page, with its words."""
HEAD = """\
| in | reaction | after | up | aside | speed | off by | floor met at | pushed | exempt | safe | why |
|---|---|---:|---:|---:|---:|---:|---:|---:|---|---|---|"""


def text(rows: Sequence[Row]) -> str:
    """For a terminal."""
    lines = []
    for row in rows:
        verdict = "safe  " if row.safe else "UNSAFE"
        after = "" if row.answer_ms is None else f"after {row.answer_ms:.0f} ms"
        met = "" if row.touchdown_m_s is None else f"floor at {row.touchdown_m_s:.2f} m/s"
        lines.append(
            f"{verdict} {row.fault:32}{row.state:10} {row.reaction:34}{after:16}up {row.highest_m:5.2f} m  "
            f"aside {row.sideways_m:5.2f} m  {row.fastest_m_s:5.2f} m/s  {met}"
        )
        if row.why and not row.safe:
            lines.append(f"       {row.why}")
    bad = sum(not row.safe for row in rows)
    return "\n".join([*lines, f"{len(rows)} cells, {bad} unsafe"])


def page(rows: Sequence[Row], command: str) -> str:
    """The whole page in Markdown; ``command`` made it."""
    lines = []
    for name in dict.fromkeys(row.fault for row in rows):
        lines += [f"## {name}", "", f"{FAULTS[name].says[0].upper()}{FAULTS[name].says[1:]}.", "", HEAD]
        lines += [*(_line(row) for row in rows if row.fault == name), ""]
    limits, exemptions = (
        "\n".join([head, *(f"| {what} | {told} |" for what, told in some)])
        for head, some in (
            ("| it | at most |\n|---|---:|", LIMITS),
            ("| word | where, and what it lifts |\n|---|---|", REASONS.items()),
        )
    )
    held = f"The autopilot holds the last set-point for {AUTOPILOT['COM_OF_LOSS_T']} s when they stop"
    parts = {
        "command": f"<!-- not tested: it flies for minutes -->\n```sh\n{command}\n```",
        "held": f"{held} (`COM_OF_LOSS_T`).",
        "limits": limits,
        "exemptions": exemptions,
        "cells": "\n".join(lines).rstrip(),
    }
    return fill_markers(PAGE, parts)


def _line(row: Row) -> str:
    after = "" if row.answer_ms is None else f"{row.answer_ms:.0f} ms"
    met = "" if row.touchdown_m_s is None else f"{row.touchdown_m_s:.2f} m/s"
    safe = "yes" if row.safe else "**NO**"
    why = row.why.replace("|", "\\|")
    return (
        f"| {row.state} | {row.reaction} | {after} | {row.highest_m:.2f} m | {row.sideways_m:.2f} m "
        f"| {row.fastest_m_s:.2f} m/s | {row.peak_error_m:.2f} m | {met} | {row.over_hover_s:.2f} s "
        f"| {row.exemption} | {safe} | {why} |"
    )


def write(path: Path, rows: Sequence[Row], command: str) -> None:
    """Write the page.

    Raises:
        ConfigError: the file can't be written.
    """
    with refuse_io("--write", f"cannot write {path}"):
        path.write_text(page(rows, command), "utf-8")
