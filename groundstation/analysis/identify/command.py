"""Identification command, ``groundstation identify LOG``: its answer as text, JSON, HTML page and vehicle file.

The page holds its pictures and needs nothing else, as a report's does. The vehicle file has every key of ``[vehicle]``,
each with its interval, or why it stays as told. Figures show how well the vehicle fits the flight, in a report's style.
"""

import json
import tomllib
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from groundstation.analysis.identify.stretch import Column, StretchTooShort, read_stretch
from groundstation.analysis.identify.thrust_fit import NAMES, full_n, hover_signal, most_n, thrust_n
from groundstation.analysis.identify.vehicle import (
    FLY,
    WIDE,
    IdentifiedParameter,
    IdentifiedVehicle,
    accelerations,
    identify,
)
from groundstation.analysis.report import (
    BLUE,
    DPI,
    GREEN,
    GREY,
    ORANGE,
    PLOT_STYLE,
    ReportFigure,
    document,
    finish_panels,
    frame_picture,
)
from groundstation.config import ConfigError, from_dict
from groundstation.recording import NoRecording
from groundstation.runtime import require_package
from groundstation.settings import Config
from links.core import signal

CLOSE_S = 5.0
"""Motions are shown over this time, where they are strongest [s]."""
LAGS = 60
"""Innovations are held against themselves so many poses later."""
TIME = "time since the first pose used [s]"


def _busiest(at_s: Column, values: Column) -> tuple[float, float]:
    """The stretch of :data:`CLOSE_S` in which ``values`` (N, k) move most [s]."""
    span = float(np.median(np.diff(at_s)))
    width = max(1, min(len(at_s), round(CLOSE_S / span)))
    squares = np.nan_to_num((values - np.nanmean(values, axis=0)) ** 2).sum(axis=1)
    strength = np.convolve(squares, np.ones(width), mode="valid")
    start = float(at_s[int(strength.argmax())])
    return start, start + CLOSE_S


def turns(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Body rates between poses: commanded, measured, modelled."""
    seen, turned = found.seen, found.turned
    spans = np.diff(seen.at_s)[:, None]
    begun = seen.at_s[0]
    middle = seen.at_s[:-1] + 0.5 * spans[:, 0]
    start, end = _busiest(middle, turned.modelled / spans)
    for axis, (panel, name) in enumerate(zip(panels, ("roll", "pitch", "yaw"), strict=True)):
        near = (seen.sent_s >= start - 0.1) & (seen.sent_s <= end)
        panel.step(
            seen.sent_s[near] - begun,
            seen.rates_rad_s[near, axis],
            where="post",
            color=GREY,
            linewidth=0.7,
            label="commanded",
        )
        near = (middle >= start) & (middle <= end)
        t = middle[near] - begun
        measured, model = turned.turns[near, axis] / spans[near, 0], turned.modelled[near, axis] / spans[near, 0]
        panel.plot(t, measured, ".", color=ORANGE, markersize=3.5, label="measured")
        panel.plot(t, model, color=BLUE, linewidth=1.4, label="model")
        panel.set_ylabel(f"{name} rate\n[rad/s]")
    finish_panels(panels, below=TIME)


def pushes(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Accelerations: measured and modelled, each less its mean."""
    at, measured, model = accelerations(found)
    start, end = _busiest(at, model)
    near = (at >= start) & (at <= end)
    t = at[near] - found.seen.at_s[0]
    for axis, (panel, name) in enumerate(zip(panels, ("north", "east", "down"), strict=True)):
        for values, style, colour, width, label in (
            (measured, ".", ORANGE, 1.2, "measured"),
            (model, "-", BLUE, 1.4, "model, without wind"),
        ):
            one = values[near, axis]
            panel.plot(t, one - np.nanmean(one), style, color=colour, linewidth=width, markersize=3.5, label=label)
        panel.set_ylabel(f"{name}\n[m/s²]")
    finish_panels(panels, below=TIME)


def curve(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Thrust by its signal, as told and as found, and how often which signal flew."""
    over, often = panels
    config, pushed = found.seen.config, found.pushed
    scale, f = (float(pushed.fit.values[NAMES.index(name)]) for name in ("scale", "curve"))
    signals = np.linspace(0.0, 1.0, 101)
    told = config.full_thrust_n * (config.thrust_curve * signals**2 + (1.0 - config.thrust_curve) * signals)

    def at(scale: float, f: float) -> Column:
        thrust: Column = scale * thrust_n(config, pushed.about, f, signals)
        return thrust

    slopes = np.stack([at(1.0, f), (at(scale, f + 1e-3) - at(scale, f)) / 1e-3], axis=1)
    which = [NAMES.index("scale"), NAMES.index("curve")]
    cover = pushed.fit.covariance[np.ix_(which, which)]
    spread = WIDE * np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, cover, slopes), 0.0))
    over.fill_between(signals, at(scale, f) - spread, at(scale, f) + spread, color=BLUE, alpha=0.25, linewidth=0)
    over.plot(signals, at(scale, f), color=BLUE, label="found; band: 95 %")
    over.plot(signals, told, "--", color="black", linewidth=0.9, label="told")
    over.axhline(config.weight_n, color=GREEN, linestyle=":", linewidth=1.2, label="weight")
    over.set_ylabel("thrust [N]")
    over.set_ylim(0.0, 1.08 * max(told[-1], full_n(config, pushed.about, scale, f)))
    seen = found.seen
    flown = (seen.sent_s >= seen.at_s[0]) & (seen.sent_s <= seen.at_s[-1])
    sent = [signal(newtons / config.full_thrust_n, config.thrust_curve) for newtons in seen.thrust_n[flown].tolist()]
    often.hist(sent, bins=60, range=(0.0, 1.0), weights=np.full(len(sent), 100.0 / len(sent)), color=BLUE, alpha=0.75)
    often.set_ylabel("share of\ncommands [%]")
    finish_panels(panels, below="signal as sent, 0 to 1")


def whiteness(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """How what the models leave hangs together in time."""
    span = float(np.median(np.diff(found.seen.at_s)))
    groups = (
        (found.turned.fit.news, (("roll", BLUE, "-"), ("pitch", ORANGE, "--"), ("yaw", GREEN, "-."))),
        (found.pushed.fit.news, (("north", BLUE, "-"), ("east", ORANGE, "--"), ("down", GREEN, "-."))),
    )
    for panel, (news, axes), name in zip(panels, groups, ("turns", "positions"), strict=True):
        band = WIDE / np.sqrt(len(news))
        panel.axhspan(-band, band, color=GREY, alpha=0.18, linewidth=0, label="95 % of white noise")
        for axis, (label, colour, dash) in enumerate(axes):
            one = news[:, axis] - news[:, axis].mean()
            total = max(float(one @ one), 1e-12)
            shares = [float(one[lag:] @ one[:-lag]) / total for lag in range(1, LAGS + 1)]
            panel.plot(span * np.arange(1, LAGS + 1), shares, dash, color=colour, linewidth=1.0, label=label)
        panel.set_ylim(-0.5, 0.5)
        panel.set_ylabel(f"{name}:\nautocorrelation [-]")
        panel.legend(ncols=4, loc="upper right")
    panels[-1].set_xlabel("apart by [s]")


def shares(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Each parameter against what was told."""
    (panel,) = panels
    known = [one for one in found.parameters.values() if one.interval and one.value is not None and one.told]
    for row, one in enumerate(known):
        assert one.interval is not None
        assert one.value is not None
        assert one.told
        low, high, value = (100.0 * edge / one.told for edge in (*one.interval, one.value))
        panel.plot([low, high], [row, row], color=BLUE, linewidth=2.0, solid_capstyle="butt")
        panel.plot([value], [row], "o", color=BLUE, markersize=5)
    panel.axvline(100.0, color="black", linestyle="--", linewidth=0.9)
    panel.set_yticks(range(len(known)), [one.title for one in known])
    panel.set_ylim(len(known) - 0.5, -0.5)
    panel.set_xlabel("share of what was told [%]; bars: 95 %")


FIGURES = (
    ReportFigure(
        "told",
        "Found against told",
        "Each parameter that the controller is told, and its 95 % interval, as a share of what it was told in this "
        "flight. What it was told as 0 is in the table only.",
        1,
        3.4,
        shares,
    ),
    ReportFigure(
        "turns",
        "Body rates",
        "Commanded, measured (from one pose to the next) and modelled, over the 5 s in which they move most. Dots that "
        "lie beside the line all to one side speak of another lag or delay.",
        3,
        5.2,
        turns,
    ),
    ReportFigure(
        "pushes",
        "Accelerations",
        "Second differences over 0.2 s of the measured positions and of the model's, each less its mean. What differs "
        "slowly is wind.",
        3,
        5.2,
        pushes,
    ),
    ReportFigure(
        "curve",
        "Thrust curve",
        "Thrust by the signal that is sent, as told and as found; below, which signals this flight used. Beyond these "
        "the curve is a guess.",
        2,
        5.0,
        curve,
    ),
    ReportFigure(
        "whiteness",
        "What is left",
        "Innovations of turns and positions against themselves, later. Far outside the band, the model lacks "
        "something; intervals are widened for it.",
        2,
        4.6,
        whiteness,
    ),
)


def draw_figures(folder: Path, found: IdentifiedVehicle) -> list[tuple[ReportFigure, Path]]:
    """Draw every figure into ``folder``; returns each with its file.

    Raises:
        OSError: a file can't be written.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure as Canvas

    made = []
    with rc_context(PLOT_STYLE):
        for one in FIGURES:
            canvas = Canvas(figsize=(7.4, one.height_in), layout="constrained")
            panels: Any = canvas.subplots(one.rows, 1, squeeze=False, sharex=True)
            one.draw(panels[:, 0], found)
            path = folder / f"{one.name}.png"
            canvas.savefig(path, dpi=DPI)
            made.append((one, path))
    return made


EXIT_FOUND, EXIT_NOTHING = 0, 1
NEEDED = ("thrust_scale", "thrust_lag", "thrust_delay", "rate_lag", "rate_delay")
"""What a vehicle file is written for: without any of them there is nothing to write."""


def identify_command(path: Path, out: Path | None, page: Path | None, *, as_json: bool) -> int:
    """Print what the recording at ``path`` tells; write a vehicle file ``out`` and the fits into the folder ``page``.

    Returns 1 where it tells nothing of thrust, lags and delay, else 0.

    Raises:
        ConfigError: the file is no recording, holds too little flight or tells nothing to write, matplotlib is
            missing, or a file can't be written or is there already.
    """
    if page is not None:
        require_package("matplotlib", "--page", "plot")
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


COMPARED = (*NEEDED, "drag", "pose_latency")
"""What a flight's summary holds against what was told: others repeat these, or are no keys."""
APART = 2.0
"""Of so many figures and flights some lie outside their 95 %: it is told of what lies outside of twice as much."""


def find_outside(path: Path) -> list[str]:
    """What was told to the flight at ``path`` and lies outside of what it shows, one line each.

    Nothing where it is too short, or shows nothing.

    Raises:
        NoRecording, OSError: see :func:`read_stretch`.
    """
    try:
        found = identify(read_stretch(path))
    except (StretchTooShort, np.linalg.LinAlgError):
        return []
    lines = []
    for one in (found.parameters[name] for name in COMPARED):
        if one.value is None or one.interval is None or one.told is None:
            continue
        if abs(one.told - one.value) > APART * max(one.interval[1] - one.value, one.value - one.interval[0]):
            unit = f" {one.unit}" if one.unit else ""
            low, high = one.interval
            lines.append(
                f"{one.title}: told {_short(one.told)}{unit}, and this flight shows {_short(one.value)}{unit} "
                f"({_short(low)} to {_short(high)}): look at groundstation identify"
            )
    return lines


PAGE = "identification.html"


def write_page(folder: Path, found: IdentifiedVehicle, figures: Sequence[tuple[ReportFigure, Path]]) -> Path:
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
    "drag_per_s": "drag",
}
"""Key of a vehicle → parameter that it takes as it is."""
DELAYS = {"thrust_delay_s": "thrust_delay", "rate_delay_s": "rate_delay"}
"""The same, less the delay that is common to both."""
BESIDE = (
    "thrust_scale",
    "thrust_sag",
    "yaw_rate_lag",
    "yaw_rate_delay",
    "pose_latency",
    "stamp_jitter",
    "position_noise",
    "attitude_noise",
)
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
            sure = name != "drag" or (one.interval is not None and one.interval[0] > 0.0)
            values[key] = _round(max(one.value, 0.0)) if sure else 0.0
    _split_delays(found, values, notes)
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


def _split_delays(found: IdentifiedVehicle, values: dict[str, Any], notes: dict[str, str]) -> None:
    """What was found from a command's leaving, in two: the part that is told for both, and what is beyond it."""
    ones = {key: found.parameters[name] for key, name in DELAYS.items()}
    whole = {key: values["command_delay_s"] + values[key] if x.value is None else x.value for key, x in ones.items()}
    common = max(0.0, min(values["command_delay_s"], *whole.values()))
    notes["command_delay_s"] = "as told: the part of both delays below that is the link's"
    if common < values["command_delay_s"]:
        notes["command_delay_s"] = f"told {_short(values['command_delay_s'])}, and no more of it was found"
    values["command_delay_s"] = _round(common)
    for key, one in ones.items():
        values[key] = _round(max(whole[key] - common, 0.0))
        notes[key] = f"from leaving: {describe_parameter(one)}"


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
