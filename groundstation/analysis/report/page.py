"""Report page, ``groundstation report LOG [LOG2]``: a recorded flight with its figures.

One HTML file that holds its pictures and needs nothing else, no network and no script; or the
numbers alone.
"""

import base64
import csv
import json
import math
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from groundstation.analysis.report.figures import (
    FIGURES,
    OVERLAYS,
    ReportFigure,
    flight_letters,
    save_figures,
)
from groundstation.analysis.report.flight import (
    FlightColumns,
    NoCommand,
    numbers,
    read_columns,
)
from groundstation.config import ConfigError, refuse_io
from groundstation.core.messages import (
    PAPER,
    SATURATION_FROM_S,
    STEADY_S,
    DisturbanceReading,
    notice,
)
from groundstation.machine import open_whole, write_whole
from groundstation.recording import refuse_recordings
from groundstation.runtime import Exit, require_package

PAGE = "report.html"
PAGE_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #111; background: #fff;
  max-width: 62rem; margin: 1.5rem auto;
       padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0.2rem; }
h2 { font-size: 1.15rem; margin: 2rem 0 0.5rem; }
table { border-collapse: collapse; margin: 0.5rem 0; }
th, td { text-align: left; padding: 0.2rem 0.9rem 0.2rem 0; border-bottom: 1px solid #ddd;
  vertical-align: top;
         overflow-wrap: anywhere; }
td:first-child, th:first-child { overflow-wrap: normal; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.number:last-child { white-space: normal; overflow-wrap: normal; }
figure { margin: 1.5rem 0; break-inside: avoid; }
img { max-width: 100%; height: auto; }
figcaption, .note { color: #444; font-size: 0.9rem; }
.warning { border-left: 4px solid #d55e00; padding-left: 0.7rem; }
pre { font-size: 0.8rem; white-space: pre-wrap; background: #f5f5f5; padding: 0.7rem; }
@media print { body { font-size: 10pt; margin: 0; max-width: none; }
  details { break-before: page; } }
@page { size: A4; margin: 15mm; }
"""
AGAINST = (
    "Against the estimate: the distance of what the controller went by from the reference, at "
    "each command. Where poses are wrong, so is the estimate, and a recording can't tell. Against "
    "the truth: the same of where a simulated vehicle really was, at each step of the simulation; "
    "of a real flight nobody knows it. RMS and largest count over the steady part: on the "
    f"trajectory, from {STEADY_S:g} s on. Time counts from where the trajectory begins; where it "
    "never did, from the first command."
)
CLOCK = (
    "The clock is the station's: lines of the flight, its dashboard, MQTT and exported tables have "
    "the same."
)
NOT_A_SUM = (
    "Squared contribution: RMS² of the flight less RMS² with that source switched off. They need "
    "not add up to RMS²: sources act on each other, and what stays without any of them (mean wind, "
    "sampling) is none. Negative: it helped."
)
FORMATS = ("html", "pdf", "svg", "csv")
"""Forms of a report: a page, figures a column wide for print, or the table of results."""


def write_page(
    folder: Path, figures: Sequence[tuple[ReportFigure, Path]], facts: Sequence[dict[str, Any]]
) -> Path:
    """Write the page of some flights into ``folder``; returns its path.

    Raises:
        OSError: it can't be written, or a picture can't be read.
    """
    names = _short_names(facts)
    title = " against ".join(_name(one) for one in facts)
    parts = [f"<h1>{escape(title)}</h1>", *(_warnings(one) for one in facts)]
    head, *rows = result_table(names, facts)
    parts += [
        "<h2>Result</h2>",
        html_table(head, rows, numbers=range(1, len(head))),
        f'<p class="note">{AGAINST}</p>',
    ]
    parts += [
        _budget(name, one["budget"])
        for name, one in zip(names, facts, strict=True)
        if one["budget"]
    ]
    parts += [frame_picture(one.name, one.title, one.caption, path) for one, path in figures]
    parts += [
        "<h2>Events</h2>",
        *(_events(name, one) for name, one in zip(names, facts, strict=True)),
    ]
    parts += ["<h2>What flew</h2>", html_table(["", *names], _program(facts))]
    parts += [_config(name, one) for name, one in zip(names, facts, strict=True)]
    page = folder / PAGE
    write_whole(page, document(title, parts))
    return page


def frame_picture(name: str, title: str, caption: str, path: Path) -> str:
    """A figure with its words, and the picture at ``path`` inside it.

    Raises:
        OSError: the picture can't be read.
    """
    picture = base64.b64encode(path.read_bytes()).decode()
    return (
        f'<figure id="{name}"><h2>{escape(title)}</h2>'
        f'<img alt="{escape(title)}: {escape(caption)}" src="data:image/png;base64,{picture}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def document(title: str, parts: Sequence[str]) -> str:
    """The whole page; empty parts are left out."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
        "style-src 'unsafe-inline'\">"
        f'<link rel="icon" href="data:,"><title>{escape(title)}</title>'
        f"<style>{PAGE_STYLE}</style></head>\n<body>\n"
        + "\n".join(part for part in parts if part)
        + "\n</body></html>\n"
    )


def _name(one: dict[str, Any]) -> str:
    flight = one["flight"]
    words = [flight["vehicle"], flight["controller"], flight["trajectory"]]
    if flight["scenario"]:
        words.append(f"simulated {flight['scenario']}, seed {flight['seed']}")
    if flight["started"]:
        words.append(flight["started"])
    return ", ".join(words)


def _warnings(one: dict[str, Any]) -> str:
    said = []
    if one["damaged_at"] is not None:
        said.append(f"The recording is damaged at byte {one['damaged_at']}: the rest is not read.")
    elif not one["whole"]:
        said.append("The recording was cut off: this is all that is in it.")
    if one["lost_records"]:
        said.append(f"{one['lost_records']} records are missing: the recorder could not keep up.")
    if one["flight"]["clock"] == "virtual":
        said.append("Flown in virtual time: computing takes none there, and nothing is ever late.")
    said += map(escape, one["told_outside"])
    return "".join(f'<p class="note warning">{escape(one["file"])}: {line}</p>' for line in said)


def _flown_name(one: dict[str, Any]) -> str:
    """Name of a flight among several: as a legend has it, with the seed of a simulated one."""
    flight = one["flight"]
    words = [
        flight["controller"],
        flight["scenario"],
        f"seed {flight['seed']}" if flight["scenario"] else "",
    ]
    return ", ".join(filter(None, words)) or str(one["file"])


class ResultRow(NamedTuple):
    """One row of the results."""

    label: str
    cells: list[str]
    """A cell a flight."""
    paper_key: str = ""
    """The paper's figure beside it; empty where the paper has none."""


def result_table(names: Sequence[str], facts: Sequence[dict[str, Any]]) -> list[list[str]]:
    """The results, a column a flight: the head, then a row a figure.

    The paper's beside its own flight alone.
    """
    rows = [*_error_rows(facts), *_flight_rows(facts), *_timing_rows(facts)]
    if len(facts) > 1:
        rows.insert(0, ResultRow("flight", [_flown_name(f) for f in facts]))
    words = [_last_words(f["link"]) for f in facts]
    if any(words):
        rows.append(ResultRow("last telemetry of the vehicle", [one or "–" for one in words]))
    ends = [f"{f['ended']['state']}: {f['ended']['reason']}" for f in facts]
    rows.append(ResultRow("ended", ends))
    table = [["", *names], *([row.label, *row.cells] for row in rows)]
    if all(f["paper"] for f in facts):
        paper: dict[str, float] = facts[0]["paper"]
        column = [row.paper_key and _n(paper[row.paper_key]) for row in rows]
        table = [[*row, cell] for row, cell in zip(table, ["the paper", *column], strict=True)]
    return table


def _error_rows(facts: Sequence[dict[str, Any]]) -> list[ResultRow]:
    """Position errors, against the truth where one of the flights knows it."""
    against = {"error": "estimate"}
    if any(f["true_error"]["rms_cm"] is not None for f in facts):
        against["true_error"] = "truth"
    rows = [
        ResultRow(
            f"{label} error against the {what}, from {STEADY_S:g} s on [cm]",
            [_n(f[error][key]) for f in facts],
            key,
        )
        for error, what in against.items()
        for label, key in (("RMS", "rms_cm"), ("largest", "max_cm"))
    ]
    for label, key in (
        ("error against the estimate stays below 10 cm after [s]", "settle_s"),
        ("99 % of errors against the estimate below [cm]", "p99_cm"),
    ):
        paper_key = key if key in PAPER else ""
        rows.append(ResultRow(label, [_n(f["error"][key]) for f in facts], paper_key))
    return rows


def _flight_rows(facts: Sequence[dict[str, Any]]) -> list[ResultRow]:
    """Duration, disturbance, saturation and certificate."""
    rows: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
        ("time on the trajectory [s]", lambda f: _n(f["flown_s"], 1)),
        (
            "disturbance north, east, down, last second [m/s²]",
            lambda f: _disturbance(f["disturbance"]),
        ),
        ("of which, with 95 % intervals", lambda f: _split(f["disturbance"])),
        (
            f"commands at a limit, from {SATURATION_FROM_S:g} s on [%]",
            lambda f: _p(f["actuation"]["saturated_fraction_steady"]),
        ),
        ("certificate holds [%]", lambda f: _p(_share(f, "holds"))),
        ("certificate violated [%]", lambda f: _p(_share(f, "violated"))),
    )
    return [ResultRow(label, [cell(f) for f in facts]) for label, cell in rows]


def _timing_rows(facts: Sequence[dict[str, Any]]) -> list[ResultRow]:
    """Latencies on the way of a command, and its lateness."""
    rows = [
        (label, [f["latency_ms"][part] for f in facts])
        for part, label in (
            ("transport", "pose transport"),
            ("pose_age", "pose age"),
            ("compute", "compute"),
        )
    ]
    rows.append(("command lateness", [f["lateness_ms"] for f in facts]))
    return [
        ResultRow(f"{label}, median / 99 % / largest [ms]", [_spread(one) for one in spreads])
        for label, spreads in rows
    ]


def _last_words(link: dict[str, Any]) -> str:
    """Describe the newest telemetry of the vehicle or its receiver."""
    told = [] if link.get("battery_v") is None else [f"{link['battery_v']:.2f} V"]
    told += (
        []
        if link.get("battery_share") is None
        else [f"battery {100.0 * link['battery_share']:.0f} %"]
    )
    told += [f"mode {link['mode']}"] if link.get("mode") else []
    if link.get("angles_rad"):
        angles = zip(("roll", "pitch", "yaw"), link["angles_rad"], strict=True)
        told.append(" ".join(f"{name} {math.degrees(angle):+z.0f}°" for name, angle in angles))
    if link.get("uplink_share") is not None:
        share, power, snr = 100.0 * link["uplink_share"], link["uplink_dbm"], link["uplink_snr_db"]
        told.append(f"gets {share:.0f} % of frames, {power} dBm, {snr} dB over noise")
    return ", ".join(told)


def _budget(name: str, budget: dict[str, Any]) -> str:
    head, *rows = budget_table(budget)
    note = f"{budget['of']} {NOT_A_SUM}" if rows else budget["of"]
    table = html_table(head, rows, numbers=range(1, 4)) if rows else ""
    return (
        f'<h2 id="error-budget">Error budget of {escape(name)}</h2>{table}<p '
        f'class="note">{escape(note)}</p>'
    )


def budget_table(budget: dict[str, Any]) -> list[list[str]]:
    """An error budget: the head, the flight as it is, then a row a source.

    The head alone where there is none.
    """
    head = [
        "switched off",
        "RMS error without [cm]",
        "squared contribution [cm²]",
        "of RMS² [%]",
        "that is",
    ]
    if not budget["duration_s"]:
        return [head]
    whole = (budget["rms_cm"] or math.nan) ** 2
    rows = [
        [
            "nothing",
            _n(budget["rms_cm"], 3),
            _n(budget["rms_cm"] and whole, 4),
            "",
            "the flight as it is",
        ]
    ]
    for one in budget["contributions"]:
        squared = one["squared_cm2"]
        share = None if squared is None else 100.0 * squared / whole
        rows.append(
            [one["source"], _n(one["rms_cm"], 3), _n(squared, 4), _n(share, 0), one["means"]]
        )
    return [head, *rows]


def _events(name: str, one: dict[str, Any]) -> str:
    rows = [
        [f"{event['time_s']:.2f}", f"{event['clock_s']:.3f}", event["kind"], event["text"]]
        for event in one["events"]
    ]
    head = ["time [s]", "clock [s]", "what", ""]
    return (
        f"<h3>{escape(name)}</h3>"
        + html_table(head, rows, numbers=range(2))
        + f'<p class="note">{escape(CLOCK)}</p>'
    )


def _program(facts: Sequence[dict[str, Any]]) -> list[list[str]]:
    rows = [["recording", *(f["file"] for f in facts)]]
    for part in ("flight", "program"):
        for key in facts[0][part]:
            values = [str(f[part][key]) for f in facts]
            if any(values):
                rows.append([key, *values])
    return rows


def _config(name: str, one: dict[str, Any]) -> str:
    return (
        "<details><summary>Configuration of "
        f"{escape(name)}</summary><pre>{escape(one['config'])}</pre></details>"
    )


def html_table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: range = range(0)
) -> str:
    """A table in HTML; ``numbers`` are its columns of numbers."""
    kinds = [' class="number"' if i in numbers else "" for i in range(len(head))]
    cells = [[f"<th{kind}>{escape(cell)}</th>" for kind, cell in zip(kinds, head, strict=True)]]
    cells += [
        [f"<td{kind}>{escape(cell)}</td>" for kind, cell in zip(kinds, row, strict=True)]
        for row in rows
    ]
    return "<table>" + "".join(f"<tr>{''.join(row)}</tr>" for row in cells) + "</table>"


def _n(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:z.{digits}f}"


def _share(facts: dict[str, Any], state: str) -> float | None:
    """Share of time of the certificate in ``state``; None for a controller without V."""
    fractions = facts["certificate"]["fractions"]
    return None if set(fractions) == {"none"} else fractions.get(state, 0.0)


def _p(value: float | None) -> str:
    return _n(None if value is None else 100.0 * value)


def _disturbance(found: dict[str, Any]) -> str:
    return _v(found["ned_m_s2"]) if "ned_m_s2" in found else "–"


def _split(found: dict[str, Any]) -> str:
    return (
        msgspec.convert(found, DisturbanceReading).describe_split() if "ned_m_s2" in found else "–"
    )


def _v(values: Sequence[float | None]) -> str:
    return ", ".join(f"{value:+z.3f}" if value is not None else "–" for value in values)


def _spread(spread: dict[str, float | None]) -> str:
    if spread["p50"] is None:
        return "–"
    return " / ".join(
        _n(None if value is None else max(value, 0.0))
        for value in map(spread.get, ("p50", "p99", "max"))
    )


def report_command(
    paths: Sequence[Path],
    out: Path | None,
    find_outside: Callable[[Path], list[str]],
    find_budget: Callable[[FlightColumns], dict[str, Any]] | None = None,
    *,
    as_json: bool,
    formats: Sequence[str] = ("html",),
) -> Exit:
    """Report on recordings in ``formats`` into the folder ``out`` (default: beside the first).

    Returns 0.

    ``find_outside`` says what was told of the vehicle and lies outside of what a recording shows.
    ``find_budget`` has the error budget of a flight; several that are overlaid have none.

    With ``as_json`` the numbers are printed, and all else is written only where ``out`` is given.

    Raises:
        ConfigError: a file is no recording of commands, matplotlib is missing, or something can't
            be written.
    """
    draw = out is not None or not as_json
    for form in formats:
        if form not in FORMATS:
            raise ConfigError(
                "--format", notice("value.choices", choices=list(FORMATS), found=form)
            )
    if draw and set(formats) - {"csv"}:
        require_package("matplotlib", "report", "plot", "package.needed_for_pictures")
    with refuse_recordings(NoCommand):
        flights = [read_columns(path) for path in paths]
        if find_budget is not None and len(flights) == 1:
            flights[0].budget = find_budget(flights[0])
        facts = [numbers(flown) | {"told_outside": find_outside(flown.path)} for flown in flights]
    written: list[Path] = []
    if draw:
        folder = out or paths[0].with_name(f"{paths[0].stem}-report")
        written = _write_all(formats, folder, flights, facts)
    page = next((str(path) for path in written if path.name == PAGE), None)
    print(json.dumps({"flights": facts, "page": page}) if as_json else "\n".join(map(str, written)))
    return Exit.DONE


def _write_all(
    formats: Sequence[str], folder: Path, flights: list[FlightColumns], facts: list[dict[str, Any]]
) -> list[Path]:
    """Write the report in ``formats`` into ``folder``; returns the files."""
    with refuse_io("--out", "file.unwritten", folder):
        folder.mkdir(parents=True, exist_ok=True)
        return [path for form in formats for path in _write(form, folder, flights, facts)]


def _write(
    form: str, folder: Path, flights: Sequence[FlightColumns], facts: Sequence[dict[str, Any]]
) -> list[Path]:
    """The files of one format."""
    if form == "csv":
        path = folder / "results.csv"
        with open_whole(path) as file:
            csv.writer(file, lineterminator="\n").writerows(
                result_table(_short_names(facts), facts)
            )
        return [path]
    printed = "" if form == "html" else form
    drawn, shown = (OVERLAYS, flights) if len(flights) > 1 else (FIGURES, flights[0])
    figures = save_figures(folder, drawn, shown, printed)
    return [path for _, path in figures] if printed else [write_page(folder, figures, facts)]


def _short_names(facts: Sequence[dict[str, Any]]) -> list[str]:
    return [facts[0]["flight"]["vehicle"]] if len(facts) == 1 else flight_letters(len(facts))
