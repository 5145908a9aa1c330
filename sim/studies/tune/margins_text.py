"""Margins in words: lines for a terminal, and a table for documents."""

from collections.abc import Sequence

from sim.studies.tune.margins import AXES, FLOOR_CM, LONGEST_S, TIMES_NOMINAL, Axis, Margin, Report


def criterion(report: Report) -> str:
    """What counts as a failure, as a sentence."""
    several = f"any of {report.seeds} flights" if report.seeds > 1 else "a flight"
    return (
        f"It fails where {several} of {report.duration_s:g} s crashes, or has an RMS error from 15 s on above "
        f"{TIMES_NOMINAL:g} times the one with nothing wrong and above {FLOOR_CM:g} cm."
    )


def text(report: Report) -> str:
    """One line a margin."""
    head = f"{report.scenario}, vehicle {report.vehicle}, controller {report.controller}"
    if report.limit_cm is None:
        return f"{head}\nIt fails with nothing wrong: there are no margins."
    rows = [(axis.label, shown(margin), axis.meaning, margin.why or "") for axis, margin in _known(report)]
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    lines = [
        f"{label:<{widths[0]}}  {value:>{widths[1]}}  {meaning:<{widths[2]}}  {f'({why})' if why else ''}".rstrip()
        for label, value, meaning, why in rows
    ]
    return "\n".join(
        [
            f"{head}: RMS error {report.nominal_rms_cm:.2f} cm with nothing wrong",
            f"One thing wrong at a time, untold. {criterion(report)}",
            "",
            *lines,
        ]
    )


def markdown_table(reports: Sequence[Report]) -> str:
    """One row a margin, one column a configuration."""
    columns = [f"{report.vehicle} in `{report.scenario}`" for report in reports]
    lines = [f"| fails at | {' | '.join(columns)} | what does this |", f"|---|{'---:|' * len(reports)}---|"]
    for axis in AXES:
        by_report = [{margin.name: margin for margin in report.margins}.get(axis.name) for report in reports]
        cells = ["-" if margin is None else shown(margin) for margin in by_report]
        lines.append(f"| {axis.label} | {' | '.join(cells)} | {axis.meaning} |")
    return "\n".join(lines)


def shown(margin: Margin) -> str:
    """``+38 ms`` or ``1.62x``; ``> +320 ms`` where nothing tried failed."""
    if margin.unit == "s":
        return f"> +{1e3 * LONGEST_S:.0f} ms" if margin.fails is None else f"+{1e3 * margin.fails:.0f} ms"
    if margin.fails is None:
        return f"{'>' if margin.holds > 1.0 else '<'} {margin.holds:.2f}x"
    return f"{margin.fails:.2f}x"


def _known(report: Report) -> list[tuple[Axis, Margin]]:
    by_name = {axis.name: axis for axis in AXES}
    return [(by_name[margin.name], margin) for margin in report.margins]
