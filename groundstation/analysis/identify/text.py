"""Answers of an identification: as text, as JSON, as an HTML page, and as a vehicle file.

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

from groundstation.analysis.identify.figures import Figure
from groundstation.analysis.identify.found import Found
from groundstation.analysis.identify.parameter import Parameter
from groundstation.analysis.identify.scene import NAMES, hover_signal, most_n
from groundstation.analysis.report import document, framed
from groundstation.config import ConfigError, from_dict
from groundstation.settings import Config


def number(value: float | None) -> str:
    """Four digits, or a dash."""
    return "–" if value is None else f"{value:.4g}"


def remarks(found: Found) -> list[str]:
    """What to know about all of it."""
    seen = found.seen
    flown = seen.config.trajectory.__struct_config__.tag
    lines = [f"{seen.length_s:.1f} s of {flown}, {len(seen.at_s)} poses. Intervals hold the truth in 95 % of flights."]
    if not seen.recording.whole:
        lines.append(f"The recording {seen.recording.trouble}. This is from what is in it before.")
    return lines


def table(found: Found) -> str:
    """One line a parameter."""
    lines = [*remarks(found), f"{'':30}{'found':>12}{'95 %':>26}{'told':>12}"]
    for one in found.parameters.values():
        interval = "" if one.interval is None else f"{number(one.interval[0])} to {number(one.interval[1])}"
        unit = f" {one.unit}" if one.unit else ""
        lines.append(
            f"{one.title:30}{number(one.value):>12}{interval:>26}{number(one.told):>12}{unit:<7} {one.note}".rstrip()
        )
    return "\n".join(lines)


def facts(found: Found) -> dict[str, Any]:
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


def write(folder: Path, found: Found, figures: Sequence[tuple[Figure, Path]]) -> Path:
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
    parts += [framed(one.name, one.title, one.caption, path) for one, path in figures]
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


def file_text(found: Found) -> str:
    """The file's text, which reads back as a vehicle.

    Raises:
        ConfigError: what was found is no vehicle, by the bounds of its keys.
    """
    told, parameters = found.seen.config, found.parameters
    values: dict[str, Any] = msgspec.to_builtins(told.vehicle)
    notes: dict[str, str] = {}
    for key, name in KEYS.items():
        one = parameters[name]
        notes[key] = described(one)
        if one.value is not None:
            values[key] = _rounded(max(one.value, 0.0))
    if told.link.thrust_curve is not None:
        values["thrust_curve"] = told.vehicle.thrust_curve
        notes["thrust_curve"] = f"as told: link.thrust_curve stands in its place; found: {notes['thrust_curve']}"
    scale = parameters["thrust_scale"]
    notes["hover_thrust"] = described(parameters["hover_thrust"])
    if scale.value is not None:
        _scaled(found, values)
        notes["thrust_max_n"] = f"what the signal gives of which {told.vehicle.thrust_max_n:g} N were told"
        values["hover_n"] = _rounded(told.weight_n)
        notes["hover_n"] = "measured: with these figures the thrust that hovers is the weight"
    lines = [
        f"# {told.vehicle.name}, identified from {found.seen.path.name}: {found.seen.length_s:.0f} s of flight",
        "# Each interval holds the truth in about 95 % of flights. Look at the fits before you fly it.",
        *(f"# {parameters[name].title}: {described(parameters[name])}" for name in BESIDE),
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


def _scaled(found: Found, values: dict[str, Any]) -> None:
    """Hover thrust and largest thrust by the scale, on the curve that the file has."""
    config, pushed, link = found.seen.config, found.pushed, found.seen.config.link
    curve = float(values["thrust_curve"] if link.thrust_curve is None else link.thrust_curve)
    scale = float(pushed.fit.given(NAMES.index("curve"), curve)[NAMES.index("scale")])
    values["hover_thrust"] = _rounded(hover_signal(config, pushed.about, scale, curve))
    values["thrust_max_n"] = _rounded(most_n(config, pushed.about, scale, curve))


def described(one: Parameter) -> str:
    """Value, interval and what was told, in a few words."""
    told = "" if one.told is None else f", told {_short(one.told)}"
    if one.value is None or one.interval is None:
        return f"as told: {one.note}" if one.told is not None else one.note
    unit = f" {one.unit}" if one.unit else ""
    low, high = one.interval
    return f"{_short(one.value)}{unit}, 95 % from {_short(low)} to {_short(high)}{told}"


def _short(value: float) -> str:
    return f"{value:.4g}"


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
