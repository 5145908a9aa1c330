"""Identification command, ``groundstation identify LOG``: its answer as text, JSON, HTML page and vehicle file.

The page holds its pictures and needs nothing else, as a report's does. The vehicle file has every key of ``[vehicle]``,
each with its interval, or why it stays as told.
"""

import json
import tomllib
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import msgspec

from groundstation.analysis.identify.figures import FitFigure, draw_figures
from groundstation.analysis.identify.stretch import StretchTooShort, read_stretch
from groundstation.analysis.identify.thrust_fit import NAMES, hover_signal, most_n
from groundstation.analysis.identify.vehicle import FLY, IdentifiedParameter, IdentifiedVehicle, identify
from groundstation.analysis.report import document, frame_picture
from groundstation.config import ConfigError, from_dict
from groundstation.recording import NoRecording
from groundstation.runtime import require_matplotlib
from groundstation.settings import Config

EXIT_FOUND, EXIT_NOTHING = 0, 1
NEEDED = ("thrust_scale", "thrust_lag", "rate_lag", "command_delay")
"""What a vehicle file is written for: without any of them there is nothing to write."""


def identify_command(path: Path, out: Path | None, page: Path | None, *, as_json: bool) -> int:
    """Print what the recording at ``path`` tells; write a vehicle file ``out`` and the fits into the folder ``page``.

    Returns 1 where it tells nothing of thrust, lags and delay, else 0.

    Raises:
        ConfigError: the file is no recording, holds too little flight or tells nothing to write, matplotlib is
            missing, or a file can't be written or is there already.
    """
    if page is not None:
        require_matplotlib("--page", "its figures need matplotlib: pip install 'quadrotor-groundstation[plot]'")
    if out is not None and out.exists():
        raise ConfigError("--out", f"{out} is there already")
    try:
        found = identify(read_stretch(path))
    except (NoRecording, StretchTooShort) as error:
        raise ConfigError("LOG", str(error)) from None
    except OSError as error:
        raise ConfigError("LOG", f"cannot read {error.filename}: {error.strerror}") from None
    knows = any(found.parameters[name].identified for name in NEEDED)
    if out is not None:
        if not knows:
            raise ConfigError("--out", f"nothing to write: thrust, lags and delay are {FLY}")
        text = file_text(found)
        try:
            out.write_text(text, "utf-8")
        except OSError as error:
            raise ConfigError("--out", f"cannot write {out}: {error.strerror}") from None
    shown = None
    if page is not None:
        try:
            page.mkdir(parents=True, exist_ok=True)
            shown = write_page(page, found, draw_figures(page, found))
        except OSError as error:
            raise ConfigError("--page", f"cannot write {error.filename or page}: {error.strerror}") from None
    if as_json:
        written = {"vehicle_file": str(out) if out else None, "page": str(shown) if shown else None}
        print(json.dumps({**facts(found), **written}))
    else:
        print(table(found))
        for written_to in (out, shown):
            if written_to is not None:
                print(f"written to {written_to}")
    return EXIT_FOUND if knows else EXIT_NOTHING


def number(value: float | None) -> str:
    """Four digits, or a dash."""
    return "–" if value is None else f"{value:.4g}"


def remarks(found: IdentifiedVehicle) -> list[str]:
    """What to know about all of it."""
    seen = found.seen
    flown = seen.config.trajectory.__struct_config__.tag
    lines = [f"{seen.length_s:.1f} s of {flown}, {len(seen.at_s)} poses. Intervals hold the truth in 95 % of flights."]
    if not seen.recording.whole:
        lines.append(f"The recording {seen.recording.trouble}. This is from what is in it before.")
    return lines


def table(found: IdentifiedVehicle) -> str:
    """One line a parameter."""
    lines = [*remarks(found), f"{'':30}{'found':>12}{'95 %':>26}{'told':>12}"]
    for one in found.parameters.values():
        interval = "" if one.interval is None else f"{number(one.interval[0])} to {number(one.interval[1])}"
        unit = f" {one.unit}" if one.unit else ""
        lines.append(
            f"{one.title:30}{number(one.value):>12}{interval:>26}{number(one.told):>12}{unit:<7} {one.note}".rstrip()
        )
    return "\n".join(lines)


def facts(found: IdentifiedVehicle) -> dict[str, Any]:
    """The same as one object for JSON."""
    seen = found.seen
    about = seen.recording.about
    return {
        "file": str(seen.path),
        "whole": seen.recording.whole,
        "flight": {key: about.get(key, "") for key in ("vehicle", "controller", "trajectory", "scenario", "seed")},
        "length_s": seen.length_s,
        "poses": len(seen.at_s),
        "parameters": {
            one.name: {
                "title": one.title,
                "value": one.value,
                "interval": one.interval,
                "unit": one.unit,
                "told": one.told,
                "identified": one.identified,
                "note": one.note,
            }
            for one in found.parameters.values()
        },
    }


PAGE = "identification.html"


def write_page(folder: Path, found: IdentifiedVehicle, figures: Sequence[tuple[FitFigure, Path]]) -> Path:
    """Write the page into ``folder``; returns its path.

    Raises:
        OSError: it can't be written, or a picture can't be read.
    """
    name = found.seen.config.vehicle.name
    title = f"{name}, identified from {found.seen.path.name}"
    head = "".join(
        f"<th{' class=number' if i else ''}>{cell}</th>" for i, cell in enumerate(("", "found", "95 %", "told"))
    )
    rows = [f"<tr>{head}<th></th></tr>"]
    for one in found.parameters.values():
        interval = "" if one.interval is None else f"{number(one.interval[0])} to {number(one.interval[1])}"
        cells = [number(one.value), interval, number(one.told)]
        label = f"{one.title} [{one.unit}]" if one.unit else one.title
        numbers = "".join(f'<td class="number">{escape(cell)}</td>' for cell in cells)
        rows.append(f'<tr><td>{escape(label)}</td>{numbers}<td class="note">{escape(one.note)}</td></tr>')
    parts = [f"<h1>{escape(title)}</h1>"]
    parts += [f'<p class="note">{escape(line)}</p>' for line in remarks(found)]
    parts.append(f"<table>{''.join(rows)}</table>")
    parts += [frame_picture(one.name, one.title, one.caption, path) for one, path in figures]
    page = folder / PAGE
    page.write_text(document(title, parts), "utf-8")
    return page


KEYS = {
    "thrust_curve": "thrust_curve",
    "thrust_lag_s": "thrust_lag",
    "rate_lag_s": "rate_lag",
    "command_delay_s": "command_delay",
}
"""Key of a vehicle → parameter that it takes as it is."""
BESIDE = ("thrust_scale", "thrust_sag", "yaw_rate_lag", "drag", "position_noise", "attitude_noise")
"""Parameters that are no keys of a vehicle."""
DIGITS = 5
"""So many digits are written, and no vehicle needs more."""


def file_text(found: IdentifiedVehicle) -> str:
    """The file's text, which reads back as a vehicle.

    Raises:
        ConfigError: what was found is no vehicle, by the bounds of its keys.
    """
    told, parameters = found.seen.config, found.parameters
    values: dict[str, Any] = msgspec.to_builtins(told.vehicle)
    notes: dict[str, str] = {}
    for key, name in KEYS.items():
        one = parameters[name]
        notes[key] = describe_parameter(one)
        if one.value is not None:
            values[key] = _round(max(one.value, 0.0))
    if told.link.thrust_curve is not None:
        values["thrust_curve"] = told.vehicle.thrust_curve
        notes["thrust_curve"] = f"as told: link.thrust_curve stands in its place; found: {notes['thrust_curve']}"
    scale = parameters["thrust_scale"]
    notes["hover_thrust"] = describe_parameter(parameters["hover_thrust"])
    if scale.value is not None:
        _scale_thrust(found, values)
        notes["thrust_max_n"] = f"what the signal gives of which {told.vehicle.thrust_max_n:g} N were told"
        values["hover_n"] = _round(told.weight_n)
        notes["hover_n"] = "measured: with these figures the thrust that hovers is the weight"
    lines = [
        f"# {told.vehicle.name}, identified from {found.seen.path.name}: {found.seen.length_s:.0f} s of flight",
        "# Each interval holds the truth in about 95 % of flights. Look at the fits before you fly it.",
        *(f"# {parameters[name].title}: {describe_parameter(parameters[name])}" for name in BESIDE),
    ]
    for key, value in values.items():
        if key in ("preset", "file") or value is None:
            continue
        shown = f"[{', '.join(map(str, value))}]" if isinstance(value, list | tuple) else json.dumps(value)
        lines.append(f"{f'{key} = {shown}':42} # {notes.get(key, 'as told')}")
    text = "\n".join(lines) + "\n"
    try:
        curve = {} if told.link.thrust_curve is None else {"thrust_curve": told.link.thrust_curve}
        from_dict({"vehicle": tomllib.loads(text), "link": {"kind": "mavlink", **curve}}, Config)
    except ConfigError as error:
        raise ConfigError(error.key, f"what was identified is no vehicle: {error.problem}") from None
    return text


def _scale_thrust(found: IdentifiedVehicle, values: dict[str, Any]) -> None:
    """Hover thrust and largest thrust by the scale, on the curve that the file has."""
    config, pushed, link = found.seen.config, found.pushed, found.seen.config.link
    curve = float(values["thrust_curve"] if link.thrust_curve is None else link.thrust_curve)
    scale = float(pushed.fit.condition_on(NAMES.index("curve"), curve)[NAMES.index("scale")])
    values["hover_thrust"] = _round(hover_signal(config, pushed.about, scale, curve))
    values["thrust_max_n"] = _round(most_n(config, pushed.about, scale, curve))


def describe_parameter(one: IdentifiedParameter) -> str:
    """Value, interval and what was told, in a few words."""
    told = "" if one.told is None else f", told {_short(one.told)}"
    if one.value is None or one.interval is None:
        return f"as told: {one.note}" if one.told is not None else one.note
    unit = f" {one.unit}" if one.unit else ""
    low, high = one.interval
    return f"{_short(one.value)}{unit}, 95 % from {_short(low)} to {_short(high)}{told}"


def _short(value: float) -> str:
    return f"{value:.4g}"


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
