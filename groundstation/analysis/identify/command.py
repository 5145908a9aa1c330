"""Identification command, ``groundstation identify LOG``: its answer as text, JSON, HTML page and
vehicle file.

The page holds its pictures and needs nothing else, as a report's does. The vehicle file has every
key of ``[vehicle]``, each with its interval, or why it stays as told. Figures show how well the
vehicle fits the flight, in a report's style.

The identified vehicle is what a recording tells of it, each parameter with its interval, or why it
tells nothing.
"""

import json
import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from groundstation.analysis.identify.fit import (
    DRAG,
    DRAGS,
    THRUST_NAMES,
    TURN_NAMES,
    ThrustFit,
    TurnFit,
    fit_thrust,
    fit_turns,
    full_n,
    hover_signal,
    most_n,
    thrust_n,
)
from groundstation.analysis.identify.stretch import (
    Column,
    FlightStretch,
    StretchTooShort,
    components,
    read_stretch,
)
from groundstation.analysis.report import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    ReportFigure,
    document,
    finish_panels,
    frame_picture,
    html_table,
    save_figures,
)
from groundstation.config import ConfigError, from_dict, refuse_io, round_digits, write_value
from groundstation.core.estimation import SIGNIFICANT
from groundstation.core.geometry import so3
from groundstation.core.messages import QUANTILE_95, notice
from groundstation.core.trajectory import ExcitationConfig
from groundstation.machine import write_whole
from groundstation.recording import refuse_recordings
from groundstation.runtime import Exit, require_package
from groundstation.settings import Config
from links.core import signal

FLY = "not identifiable from this flight: fly trajectory.kind = 'excitation'"
AGAIN = (
    "not identifiable from this flight: fly it for longer (trajectory.laps), or harder "
    "(trajectory.acceleration_m_s2)"
)


PARAMETERS = {
    "thrust_scale": ("thrust over what was told", ""),
    "hover_thrust": ("signal that carries it", ""),
    "thrust_curve": ("thrust curve f", ""),
    "thrust_sag": ("thrust lost to the battery", "1/min"),
    "thrust_lag": ("thrust lag", "s"),
    "thrust_delay": ("thrust delay", "s"),
    "rate_lag": ("rate lag, roll and pitch", "s"),
    "rate_delay": ("rate delay, roll and pitch", "s"),
    "roll_rate_lag": ("roll rate lag", "s"),
    "pitch_rate_lag": ("pitch rate lag", "s"),
    "yaw_rate_lag": ("yaw rate lag", "s"),
    "yaw_rate_delay": ("yaw rate delay", "s"),
    "rate_response": ("rate response, roll and pitch", "s"),
    "yaw_rate_response": ("yaw rate response", "s"),
    "drag": ("linear drag", "1/s"),
    "pose_latency": ("latency of poses", "s"),
}
"""Name of each parameter → its title and unit."""


class IdentifiedParameter(msgspec.Struct, frozen=True, kw_only=True):
    """One figure of a vehicle: its value and interval, or why the flight does not tell."""

    name: str
    value: float | None = None
    """None where the flight does not tell."""
    interval: tuple[float, float] | None = None
    """95 %."""
    told: float | None = None
    """Configured value; None where there is no key for it."""
    note: str = ""

    @property
    def title(self) -> str:
        """Its name for people."""
        return PARAMETERS[self.name][0]

    @property
    def unit(self) -> str:
        """Its unit; empty where it has none."""
        return PARAMETERS[self.name][1]

    @property
    def identified(self) -> bool:
        """Whether the flight tells."""
        return self.value is not None


def judge_parameter(
    name: str,
    value: float,
    deviation: float,
    enough: float,
    *,
    moved: bool = True,
    told: float | None = None,
    least: float = -math.inf,
    most: float = math.inf,
    note: str = "",
) -> IdentifiedParameter:
    """The parameter; without a value where half its interval is more than ``enough``, or where
    nothing ``moved``.
    """
    half = QUANTILE_95 * deviation
    if not (moved and half <= enough):
        return IdentifiedParameter(name=name, told=told, note=FLY)
    low, high = (float(min(max(edge, least), most)) for edge in (value - half, value + half))
    value, told = float(min(max(value, least), most)), None if told is None else float(told)
    return IdentifiedParameter(name=name, value=value, interval=(low, high), told=told, note=note)


MODEL = 0.005
"""No lag is quite of first order, no scale constant: nothing is known better than this share."""
LAG_SPREAD = 1.5
"""Factor on the deviations of a lag with its delay [-], counted over 200 flights in gusts and 100
on rotors: both stand for one another, gusts are no random walk, and a rotor's loop is no lag behind
a delay."""
DRAG_LEAST = 0.0007
"""Least deviation of drag, even where there is none [1/s]: of 94 flights on rotors 8 lay outside
without it."""
DELAY = (
    "from a command's leaving until it is followed; what pose.latency_s is wrong by is part of it"
)
RESPONSE = (
    "lag + delay, from a command's leaving: known better than either, as one may stand for the "
    "other"
)
DRAG_NOTE = "deceleration per speed; the controller is told one for all axes"
ONE_FOR_ALL = "the controller is told one for all three"
TURNED_RAD_S = 0.05
"""Body rates of less than this (RMS about each axis) tell of nothing but noise, whatever the
statistics say."""
PUSHED_M_S2 = 0.2
"""Least acceleration by thrust, and by tilt, that excites [m/s²]."""


class MotionExcitation(NamedTuple):
    """Axes and inputs that the flight excited enough."""

    turned: tuple[bool, bool, bool]
    """About roll, pitch and yaw."""
    thrust: bool
    pushed: bool
    """Any acceleration."""


@dataclass(frozen=True)
class IdentifiedVehicle:
    """All of it, and what it rests on."""

    seen: FlightStretch
    turned: TurnFit
    pushed: ThrustFit
    parameters: dict[str, IdentifiedParameter]
    """Parameters by name."""


def accelerations(found: IdentifiedVehicle) -> tuple[Column, Column, Column]:
    """Times [s], and second differences over 0.2 s of the measured positions and of the model's
    path, (n, 3) [m/s²].

    Both are NaN where two poses in a row are missing within that time.
    """
    at, place = found.seen.at_s, found.seen.position_ned
    path, h = place - found.pushed.left, 0.1
    spans = np.diff(at)
    holes = np.flatnonzero(spans > 2.5 * np.median(spans))
    whole = (at > at[0] + h) & (at < at[-1] - h)
    for hole in holes:
        whole &= (at < at[hole] - h) | (at > at[hole + 1] + h)

    def second(values: Column) -> Column:
        parts = [
            np.stack([np.interp(at + k * h, at, axis) for axis in values.T], axis=1)
            for k in (-1, 0, 1)
        ]
        difference: Column = (parts[0] - 2.0 * parts[1] + parts[2]) / h**2
        difference[~whole] = np.nan
        return difference

    return at, second(place), second(path)


def identify(seen: FlightStretch) -> IdentifiedVehicle:
    """Find everything that ``seen`` tells."""
    turned = fit_turns(seen)
    pushed = fit_thrust(seen, turned)
    moved = judge_excitation(seen, turned)
    parameters = [
        *_thrust(seen, pushed, moved),
        *_thrust_response(seen, pushed, moved),
        *_turn_response(seen, turned, moved),
        _drag(seen, pushed, moved),
        _latency(seen),
    ]
    if isinstance(seen.config.trajectory, ExcitationConfig):
        parameters = [
            msgspec.structs.replace(one, note=AGAIN) if one.note == FLY else one
            for one in parameters
        ]
    return IdentifiedVehicle(seen, turned, pushed, {one.name: one for one in parameters})


def judge_excitation(seen: FlightStretch, turned: TurnFit) -> MotionExcitation:
    """Judge the stretch that was ``seen`` by how it moved."""
    rates = turned.modelled / np.diff(seen.at_s)[:, None]
    roll, pitch, yaw = (
        bool(rms > TURNED_RAD_S) for rms in np.sqrt((rates**2).mean(axis=0)).tolist()
    )
    flown = (seen.sent_s >= seen.at_s[0]) & (seen.sent_s <= seen.at_s[-1])
    thrust = float(seen.thrust_n[flown].std()) / seen.config.vehicle.mass_kg
    down = np.stack(so3.third_column(components(seen.attitude)), axis=1)
    tilt = seen.config.controller.gravity * float(np.sqrt(down[:, :2].var(axis=0).max()))
    return MotionExcitation(
        (roll, pitch, yaw), thrust > PUSHED_M_S2, max(thrust, tilt) > PUSHED_M_S2
    )


def _thrust(
    seen: FlightStretch, pushed: ThrustFit, moved: MotionExcitation
) -> list[IdentifiedParameter]:
    config, vehicle = seen.config, seen.config.vehicle
    values, deviations = pushed.fit.values, pushed.fit.deviations
    scale, sag, curve = (THRUST_NAMES.index(name) for name in ("scale", "sag", "curve"))
    mass = vehicle.mass_kg
    of = f"of thrust over mass: if it weighs m and not {mass:g} kg, thrust is this times m/{mass:g}"
    spread = math.hypot(deviations[scale], MODEL * values[scale])
    sag_spread = math.hypot(deviations[sag], MODEL)
    replaced = config.link.thrust_curve is not None
    return [
        judge_parameter(
            "thrust_scale", values[scale], spread, 0.05, moved=moved.pushed, told=1.0, note=of
        ),
        _hover_thrust(config, pushed, moved.pushed, scaled=QUANTILE_95 * spread <= 0.05),
        judge_parameter(
            "thrust_curve",
            values[curve],
            math.hypot(deviations[curve], MODEL),
            0.25,
            moved=moved.thrust,
            told=config.thrust_curve,
            least=0.0,
            most=1.0,
            note="link.thrust_curve stands in its place" if replaced else "",
        ),
        judge_parameter("thrust_sag", values[sag], sag_spread, 0.08, moved=moved.pushed),
    ]


def _spread(figure: Callable[[Column], float], pushed: ThrustFit) -> float:
    """One deviation of a ``figure`` that follows from the parameters."""
    values, steps = pushed.fit.values, 1e-4
    slope = np.array(
        [(figure(values + move) - figure(values)) / steps for move in steps * np.eye(len(values))]
    )
    return math.sqrt(max(float(slope @ pushed.fit.covariance @ slope), 0.0))


def _hover_thrust(
    config: Config, pushed: ThrustFit, moved: bool, *, scaled: bool
) -> IdentifiedParameter:
    """The signal that carries the vehicle; identified where the thrust scale is (``scaled``)."""
    scale, curve = (THRUST_NAMES.index(name) for name in ("scale", "curve"))

    def hover(values: Column) -> float:
        return hover_signal(config, pushed.about, float(values[scale]), float(values[curve]))

    told = signal(config.weight_n / config.full_thrust_n, config.thrust_curve)
    return judge_parameter(
        "hover_thrust",
        hover(pushed.fit.values),
        math.hypot(_spread(hover, pushed), MODEL * told),
        math.inf if scaled else 0.0,
        moved=moved,
        told=told,
        note="in the middle of the flight, in still air",
    )


def _judge_lag(
    name: str, value: float, deviation: float, told: float, seen: bool, note: str = ""
) -> IdentifiedParameter:
    """A lag of ``value`` [s], 1σ ``deviation``; ``seen`` where the flight shows it."""
    enough = max(0.01, 0.25 * value)
    spread = math.hypot(deviation, MODEL * value)
    return judge_parameter(name, value, spread, enough, moved=seen, told=told, least=0.0, note=note)


def _judge_delay(
    seen: FlightStretch,
    name: str,
    value: float,
    deviation: float,
    told: float,
    *,
    moved: bool,
    note: str,
) -> IdentifiedParameter:
    """A delay of ``value`` [s], 1σ ``deviation``; ``moved`` where the flight shows it."""
    if value + QUANTILE_95 * deviation < 0.0:
        note = (
            f"it seems to obey before commands leave: poses are stamped {-1e3 * value:.0f} ms "
            "early or more, so pose.latency_s is too large by as much"
        )
    return judge_parameter(name, value, deviation, 0.015, moved=moved, told=told, note=note)


def _judge_response(
    seen: FlightStretch, name: str, turned: TurnFit, sums: Sequence[tuple[str, str]], *, moved: bool
) -> IdentifiedParameter:
    """Lag + delay from ``sums`` of the fit's parameters, by their names.

    ``moved`` where the flight shows it.
    """
    of = np.array([[float(one in pair) for one in TURN_NAMES] for pair in sums])
    value, deviation = _combine(of @ turned.fit.values, of @ turned.fit.covariance @ of.T)
    spread = math.hypot(LAG_SPREAD * deviation, MODEL * value)
    vehicle = seen.config.vehicle
    told = vehicle.rate_lag_s + (vehicle.command_delay_s + vehicle.rate_delay_s)
    enough = max(0.01, 0.25 * value)
    return judge_parameter(name, value, spread, enough, moved=moved, told=told, note=RESPONSE)


def _thrust_response(
    seen: FlightStretch, pushed: ThrustFit, moved: MotionExcitation
) -> list[IdentifiedParameter]:
    """Lag and delay of thrust."""
    vehicle = seen.config.vehicle
    delay, lag = pushed.fit.values[:2].tolist()
    delay_spread, lag_spread = (LAG_SPREAD * pushed.fit.deviations[:2]).tolist()
    told = vehicle.command_delay_s + vehicle.thrust_delay_s
    return [
        _judge_lag("thrust_lag", lag, lag_spread, vehicle.thrust_lag_s, moved.thrust),
        _judge_delay(
            seen, "thrust_delay", delay, delay_spread, told, moved=moved.thrust, note=DELAY
        ),
    ]


def _turn_response(
    seen: FlightStretch, turned: TurnFit, moved: MotionExcitation
) -> list[IdentifiedParameter]:
    """Lags and delays of the body rates, by axis and together."""
    vehicle = seen.config.vehicle
    delay, roll, pitch, yaw_delay, yaw = turned.fit.values.tolist()
    both, both_spread = _combine(turned.fit.values[1:3], turned.fit.covariance[1:3, 1:3])
    spreads = dict(zip(TURN_NAMES, turned.fit.deviations.tolist(), strict=True))
    rolled, pitched, yawed = moved.turned
    either = rolled or pitched
    lag_s, delay_s = vehicle.rate_lag_s, vehicle.command_delay_s + vehicle.rate_delay_s
    # Of yaw a longer delay with a shorter lag may fit as well, 30 ms apart: where one is open, so
    # is the other.
    yaw_lag = _judge_lag("yaw_rate_lag", yaw, spreads["yaw_lag"], lag_s, yawed, ONE_FOR_ALL)
    return [
        _judge_lag("rate_lag", both, both_spread, lag_s, either),
        _judge_delay(
            seen, "rate_delay", delay, spreads["delay"], delay_s, moved=either, note=DELAY
        ),
        _judge_lag("roll_rate_lag", roll, spreads["roll_lag"], lag_s, rolled),
        _judge_lag("pitch_rate_lag", pitch, spreads["pitch_lag"], lag_s, pitched),
        yaw_lag,
        _judge_delay(
            seen,
            "yaw_rate_delay",
            yaw_delay,
            spreads["yaw_delay"],
            delay_s,
            moved=yaw_lag.identified,
            note=ONE_FOR_ALL,
        ),
        _judge_response(
            seen,
            "rate_response",
            turned,
            (("delay", "roll_lag"), ("delay", "pitch_lag")),
            moved=either,
        ),
        _judge_response(
            seen, "yaw_rate_response", turned, (("yaw_delay", "yaw_lag"),), moved=yawed
        ),
    ]


def _combine(values: Column, cover: Column) -> tuple[float, float]:
    """One figure that was found several times, each by its information, and its deviation.

    Correlations count.
    """
    weights = np.linalg.solve(cover, np.ones(len(values)))
    weights = np.clip(weights / weights.sum(), 0.0, 1.0)
    weights /= weights.sum()
    return float(weights @ values), math.sqrt(float(weights @ cover @ weights))


LOOP_S = 0.002
"""An autopilot tells the attitude of its last loop, which is older than its stamp by about so much,
one deviation."""


def _latency(seen: FlightStretch) -> IdentifiedParameter:
    """Latency of the poses, where the vehicle's own attitude shows it."""
    told = seen.config.pose.latency_s or 0.0
    if seen.late_s is None:
        note = "the vehicle told no attitude of its own"
        return IdentifiedParameter(name="pose_latency", told=told, note=note)
    late, spread = seen.late_s
    note = "no key of a vehicle, but pose.latency_s"
    return judge_parameter(
        "pose_latency", told + late, math.hypot(spread, LOOP_S), 0.015, told=told, note=note
    )


def _drag(seen: FlightStretch, pushed: ThrustFit, moved: MotionExcitation) -> IdentifiedParameter:
    """One drag for all axes."""
    drags = slice(DRAG, DRAG + len(DRAGS))
    each, cover = pushed.fit.values[drags], pushed.fit.covariance[drags, drags]
    drag, spread = _combine(each, cover)
    # Axes that differ by more than their deviations are not one drag: its deviation grows by as
    # much (Birge 1932).
    apart = each - drag
    spread *= math.sqrt(max(1.0, float(apart @ np.linalg.solve(cover, apart)) / (len(each) - 1)))
    return judge_parameter(
        "drag",
        drag,
        math.hypot(spread, MODEL * drag, DRAG_LEAST),
        0.2,
        moved=moved.pushed,
        told=seen.config.vehicle.drag_per_s,
        note=DRAG_NOTE,
    )


CLOSE_S = 5.0
"""Motions are shown over this time, where they are strongest [s]."""
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
    """Commanded, measured (from one pose to the next) and modelled, over the 5 s in which they move
    most.

    Dots that lie beside the line all to one side speak of another lag or delay.
    """
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
        measured, model = (
            turned.turns[near, axis] / spans[near, 0],
            turned.modelled[near, axis] / spans[near, 0],
        )
        panel.plot(t, measured, ".", color=ORANGE, markersize=3.5, label="measured")
        panel.plot(t, model, color=BLUE, linewidth=1.4, label="model")
        panel.set_ylabel(f"{name} rate\n[rad/s]")
    finish_panels(panels, below=TIME)


def pushes(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Second differences over 0.2 s of the measured positions and of the model's, each less its
    mean.

    What differs slowly is wind.
    """
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
            panel.plot(
                t,
                one - np.nanmean(one),
                style,
                color=colour,
                linewidth=width,
                markersize=3.5,
                label=label,
            )
        panel.set_ylabel(f"{name}\n[m/s²]")
    finish_panels(panels, below=TIME)


def curve(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Thrust by the signal that is sent, as told and as found.

    Below, which signals this flight used.

    Beyond these the curve is a guess.
    """
    over, often = panels
    config, pushed = found.seen.config, found.pushed
    scale, f = (float(pushed.fit.values[THRUST_NAMES.index(name)]) for name in ("scale", "curve"))
    signals = np.linspace(0.0, 1.0, 101)
    told = config.full_thrust_n * (
        config.thrust_curve * signals**2 + (1.0 - config.thrust_curve) * signals
    )

    def at(scale: float, f: float) -> Column:
        thrust: Column = scale * thrust_n(config, pushed.about, f, signals)
        return thrust

    slopes = np.stack([at(1.0, f), (at(scale, f + 1e-3) - at(scale, f)) / 1e-3], axis=1)
    which = [THRUST_NAMES.index("scale"), THRUST_NAMES.index("curve")]
    cover = pushed.fit.covariance[np.ix_(which, which)]
    spread = QUANTILE_95 * np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, cover, slopes), 0.0))
    over.fill_between(
        signals, at(scale, f) - spread, at(scale, f) + spread, color=BLUE, alpha=0.25, linewidth=0
    )
    over.plot(signals, at(scale, f), color=BLUE, label="found; band: 95 %")
    over.plot(signals, told, "--", color="black", linewidth=0.9, label="told")
    over.axhline(config.weight_n, color=GREEN, linestyle=":", linewidth=1.2, label="weight")
    over.set_ylabel("thrust [N]")
    over.set_ylim(0.0, 1.08 * max(told[-1], full_n(config, pushed.about, scale, f)))
    seen = found.seen
    flown = (seen.sent_s >= seen.at_s[0]) & (seen.sent_s <= seen.at_s[-1])
    sent = [
        signal(newtons / config.full_thrust_n, config.thrust_curve)
        for newtons in seen.thrust_n[flown].tolist()
    ]
    often.hist(
        sent,
        bins=60,
        range=(0.0, 1.0),
        weights=np.full(len(sent), 100.0 / len(sent)),
        color=BLUE,
        alpha=0.75,
    )
    often.set_ylabel("share of\ncommands [%]")
    finish_panels(panels, below="signal as sent, 0 to 1")


FIGURES = (
    ReportFigure("turns", "Body rates", 3, 5.2, turns),
    ReportFigure("pushes", "Accelerations", 3, 5.2, pushes),
    ReportFigure("curve", "Thrust curve", 2, 5.0, curve),
)


NEEDED = ("thrust_scale", "thrust_lag", "thrust_delay", "rate_lag", "rate_delay")
"""Parameters of which a vehicle file needs at least one."""


def identify_command(path: Path, out: Path | None, page: Path | None, *, as_json: bool) -> Exit:
    """Print what the recording at ``path`` tells.

    Write a vehicle file ``out`` and the fits into the folder ``page``.

    Returns 1 where it tells nothing of thrust, lags and delay, else 0.

    Raises:
        ConfigError: the file is no recording, holds too little flight or tells nothing to write,
            matplotlib is missing, or a file can't be written or is there already.
    """
    if page is not None:
        require_package("matplotlib", "--page", "plot")
    if out is not None and out.exists():
        raise ConfigError("--out", notice("file.exists", path=out))
    with refuse_recordings(StretchTooShort):
        found = identify(read_stretch(path))
    knows = any(found.parameters[name].identified for name in NEEDED)
    if out is not None:
        if not knows:
            raise ConfigError("--out", notice("identify.nothing_to_write", why=FLY))
        text = file_text(found)
        with refuse_io("--out", "file.unwritten", out):
            write_whole(out, text)
    shown = None
    if page is not None:
        with refuse_io("--page", "file.unwritten", page):
            page.mkdir(parents=True, exist_ok=True)
            shown = write_page(page, found, save_figures(page, FIGURES, found))
    if as_json:
        written = {"vehicle_file": str(out) if out else None, "page": str(shown) if shown else None}
        print(json.dumps({**facts(found), **written}))
    else:
        print(table(found))
        for written_to in (out, shown):
            if written_to is not None:
                print(f"written to {written_to}")
    return Exit.DONE if knows else Exit.FAILED


def number(value: float | None) -> str:
    """Four digits, or a dash."""
    return "–" if value is None else f"{value:.4g}"


def describe_figures(one: IdentifiedParameter) -> tuple[str, str, str]:
    """Value, interval, and what was told."""
    interval = (
        "" if one.interval is None else f"{number(one.interval[0])} to {number(one.interval[1])}"
    )
    return number(one.value), interval, number(one.told)


def remarks(found: IdentifiedVehicle) -> list[str]:
    """Describe the conditions of the identification."""
    seen = found.seen
    flown = seen.config.trajectory.__struct_config__.tag
    lines = [
        f"{seen.length_s:.1f} s of {flown}, {len(seen.at_s)} poses. Intervals hold the truth in 95 "
        "% of flights."
    ]
    if seen.trouble:
        lines.append(f"The recording {seen.trouble}. This is from what is in it before.")
    return lines


def table(found: IdentifiedVehicle) -> str:
    """One line a parameter."""
    lines = [*remarks(found), f"{'':30}{'found':>12}{'95 %':>26}{'told':>12}"]
    for one in found.parameters.values():
        value, interval, told = describe_figures(one)
        unit = f" {one.unit}" if one.unit else ""
        lines.append(
            f"{one.title:30}{value:>12}{interval:>26}{told:>12}{unit:<7} {one.note}".rstrip()
        )
    return "\n".join(lines)


TOLD = ("title", "value", "interval", "unit", "told", "identified", "note")
"""Fields of a parameter in JSON."""


def facts(found: IdentifiedVehicle) -> dict[str, Any]:
    """Return the result as one object for JSON."""
    seen = found.seen
    return {
        "file": str(seen.path),
        "whole": not seen.trouble,
        "flight": {
            key: seen.about.get(key, "")
            for key in ("vehicle", "controller", "trajectory", "scenario", "seed")
        },
        "length_s": seen.length_s,
        "poses": len(seen.at_s),
        "parameters": {
            one.name: {key: getattr(one, key) for key in TOLD} for one in found.parameters.values()
        },
    }


COMPARED = (*NEEDED, "drag", "pose_latency")
"""Parameters that a flight's summary compares with the configuration: others repeat these, or are
no keys."""


def find_outside(path: Path) -> list[str]:
    """Find the configured values outside of their identified intervals in the flight at ``path``,
    one line each.

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
        half = max(one.interval[1] - one.value, one.value - one.interval[0])
        # Of many figures some lie outside of their 95 %.
        if abs(one.told - one.value) > SIGNIFICANT / QUANTILE_95 * half:
            unit = f" {one.unit}" if one.unit else ""
            low, high = one.interval
            lines.append(
                f"{one.title}: told {number(one.told)}{unit}, and this flight shows "
                f"{number(one.value)}{unit} ({number(low)} to {number(high)}): look at "
                "groundstation identify"
            )
    return lines


PAGE = "identification.html"


def write_page(
    folder: Path, found: IdentifiedVehicle, figures: Sequence[tuple[ReportFigure, Path]]
) -> Path:
    """Write the page into ``folder``; returns its path.

    Raises:
        OSError: it can't be written, or a picture can't be read.
    """
    name = found.seen.config.vehicle.name
    title = f"{name}, identified from {found.seen.path.name}"
    rows = [
        [f"{one.title} [{one.unit}]" if one.unit else one.title, *describe_figures(one), one.note]
        for one in found.parameters.values()
    ]
    parts = [f"<h1>{escape(title)}</h1>"]
    parts += [f'<p class="note">{escape(line)}</p>' for line in remarks(found)]
    parts.append(html_table(["", "found", "95 %", "told", ""], rows, numbers=range(1, 4)))
    parts += [frame_picture(one.name, one.title, one.caption, path) for one, path in figures]
    page = folder / PAGE
    write_whole(page, document(title, parts))
    return page


KEYS = {
    "thrust_curve": "thrust_curve",
    "thrust_lag_s": "thrust_lag",
    "rate_lag_s": "rate_lag",
    "drag_per_s": "drag",
}
"""Key of a vehicle → parameter that it takes as it is."""
DELAYS = {"thrust_delay_s": "thrust_delay", "rate_delay_s": "rate_delay"}
"""Delays beyond the common one, by configuration key."""
BESIDE = (
    "thrust_scale",
    "thrust_sag",
    "yaw_rate_lag",
    "yaw_rate_delay",
    "rate_response",
    "yaw_rate_response",
    "pose_latency",
)
"""Parameters that are no keys of a vehicle."""


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
            values[key] = round_digits(max(one.value, 0.0)) if sure else 0.0
    _split_delays(found, values, notes)
    if told.link.thrust_curve is not None:
        values["thrust_curve"] = told.vehicle.thrust_curve
        notes["thrust_curve"] = (
            f"as told: link.thrust_curve stands in its place; found: {notes['thrust_curve']}"
        )
    scale = parameters["thrust_scale"]
    notes["hover_thrust"] = describe_parameter(parameters["hover_thrust"])
    if scale.value is not None:
        _scale_thrust(found, values)
        notes["thrust_max_n"] = (
            f"what the signal gives of which {told.vehicle.thrust_max_n:g} N were told"
        )
        values["hover_n"] = round_digits(told.weight_n)
        notes["hover_n"] = "measured: with these figures the thrust that hovers is the weight"
    text = _write_toml(found, values, notes)
    try:
        curve = {} if told.link.thrust_curve is None else {"thrust_curve": told.link.thrust_curve}
        from_dict({"vehicle": tomllib.loads(text), "link": {"kind": "mavlink", **curve}}, Config)
    except ConfigError as error:
        raise ConfigError(error.key, notice("identify.no_vehicle", why=error.problem)) from None
    return text


def _write_toml(found: IdentifiedVehicle, values: dict[str, Any], notes: dict[str, str]) -> str:
    """The lines of the file: its head, and each key of ``values`` with its note."""
    parameters = found.parameters
    lines = [
        f"# {found.seen.config.vehicle.name}, identified from {found.seen.path.name}: "
        f"{found.seen.length_s:.0f} s of flight",
        "# Each interval holds the truth in about 95 % of flights. Look at the fits before you "
        "fly it.",
        *(f"# {parameters[name].title}: {describe_parameter(parameters[name])}" for name in BESIDE),
    ]
    for key, value in values.items():
        if key not in ("preset", "file") and value is not None:
            lines.append(f"{f'{key} = {write_value(value)}':42} # {notes.get(key, 'as told')}")
    return "\n".join(lines) + "\n"


def _split_delays(found: IdentifiedVehicle, values: dict[str, Any], notes: dict[str, str]) -> None:
    """Split the found delays into the one common to thrust and rates, and the rest of each."""
    ones = {key: found.parameters[name] for key, name in DELAYS.items()}
    whole = {
        key: values["command_delay_s"] + values[key] if x.value is None else x.value
        for key, x in ones.items()
    }
    common = max(0.0, min(values["command_delay_s"], *whole.values()))
    notes["command_delay_s"] = "as told: the part of both delays below that is the link's"
    if common < values["command_delay_s"]:
        notes["command_delay_s"] = (
            f"told {number(values['command_delay_s'])}, and no more of it was found"
        )
    values["command_delay_s"] = round_digits(common)
    for key, one in ones.items():
        values[key] = round_digits(max(whole[key] - common, 0.0))
        notes[key] = f"from leaving: {describe_parameter(one)}"


def _scale_thrust(found: IdentifiedVehicle, values: dict[str, Any]) -> None:
    """Hover thrust and largest thrust by the scale, on the curve that the file has."""
    config, pushed, link = found.seen.config, found.pushed, found.seen.config.link
    curve = float(values["thrust_curve"] if link.thrust_curve is None else link.thrust_curve)
    scale = float(
        pushed.fit.condition_on(THRUST_NAMES.index("curve"), curve)[THRUST_NAMES.index("scale")]
    )
    values["hover_thrust"] = round_digits(hover_signal(config, pushed.about, scale, curve))
    values["thrust_max_n"] = round_digits(most_n(config, pushed.about, scale, curve))


def describe_parameter(one: IdentifiedParameter) -> str:
    """Value, interval and what was told, in a few words."""
    told = "" if one.told is None else f", told {number(one.told)}"
    if one.value is None or one.interval is None:
        return f"as told: {one.note}" if one.told is not None else one.note
    unit = f" {one.unit}" if one.unit else ""
    low, high = one.interval
    return f"{number(one.value)}{unit}, 95 % from {number(low)} to {number(high)}{told}"
