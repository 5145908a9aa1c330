"""A comparison as a table: for people, and for documents, between the markers that they hold for it."""

from collections.abc import Sequence
from pathlib import Path

from groundstation.runtime import replace_between_markers, split_at_markers
from sim.studies.compare.compare import Row

BEGIN, END = "<!-- figures:begin -->", "<!-- figures:end -->"
NOTE = (
    "The error is the true one, from 15 s on. The baselines fly on our estimate and send commands as published, "
    "without inverting\nthe actuators' lags; `docs/decisions/0006-baselines.md` has both."
)
HEAD = ("scenario", "controller", "RMS cm", "spread", "max cm", "settled s", "effort", "survived")


def text_table(rows: Sequence[Row]) -> str:
    """Columns aligned for a terminal."""
    lines = [HEAD, *map(_cells, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEAD))]
    shown: list[str] = []
    last = rows[0].scenario if rows else ""
    for line in lines:
        if line is not HEAD and line[0] != last:
            shown.append("")
            last = line[0]
        cells = [
            cell.ljust(w) if i < 2 else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        ]
        shown.append("  ".join(cells).rstrip())
    note = "medians over the seeds; errors are true ones, from 15 s on; settled: the error stays below 10 cm"
    return "\n".join(
        [*shown, "", note, "effort: RMS of body rates [rad/s] and of thrust about its mean [m g], commanded"]
    )


def markdown_table(rows: Sequence[Row]) -> str:
    """One row a scenario, one column a controller: RMS error, and its spread over the seeds."""
    scenarios = list(dict.fromkeys(row.scenario for row in rows))
    controllers = list(dict.fromkeys(row.controller for row in rows))
    by_place = {(row.scenario, row.controller): row for row in rows}
    lines = [f"| RMS error, cm | {' | '.join(controllers)} |", f"|---|{'---:|' * len(controllers)}"]
    for scenario in scenarios:
        cells = [_rms(by_place.get((scenario, controller))) for controller in controllers]
        lines.append(f"| `{scenario}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def check_markers(path: Path) -> None:
    """Look for the markers in ``path``, before any work is done.

    Raises:
        ConfigError: it can't be read, or has not just one pair of them.
    """
    split_at_markers(path, BEGIN, END)


def write_between_markers(path: Path, rows: Sequence[Row], command: str) -> None:
    """Replace what stands between the markers of ``path`` by the table and by the ``command`` that made it.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    flights = max((row.flights for row in rows), default=0)
    what = f"Medians over {flights} flights each" if flights > 1 else "One flight each"
    spread = ", smallest and largest in brackets" if flights > 1 else ""
    made = f"{what}{spread}; made by `{command}`.\n{NOTE}"
    put_between_markers(path, f"{markdown_table(rows)}\n\n{made}")


def put_between_markers(path: Path, shown: str) -> None:
    """Replace what stands between the markers of ``path`` by ``shown``.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    replace_between_markers(path, BEGIN, END, shown)


def _cells(row: Row) -> tuple[str, ...]:
    spread = "" if row.rms_cm_min is None else f"{row.rms_cm_min:.2f} … {row.rms_cm_max:.2f}"
    survived = "yes" if row.survived else f"{row.flights - row.crashed} of {row.flights}"
    settled = "never" if row.survived and row.settle_s is None else _number(row.settle_s, 1)
    return (
        row.scenario,
        row.controller,
        _number(row.rms_cm, 2),
        spread,
        _number(row.max_cm, 2),
        settled,
        _number(row.effort, 3),
        survived,
    )


def _number(value: float | None, places: int) -> str:
    return "-" if value is None else f"{value:.{places}f}"


def _rms(row: Row | None) -> str:
    if row is None:
        return ""
    if row.rms_cm is None:
        return f"{row.crashed} of {row.flights} crashed"
    spread = f" ({row.rms_cm_min:.2f}–{row.rms_cm_max:.2f})" if row.flights > 1 else ""
    return f"{row.rms_cm:.2f}{spread}"
