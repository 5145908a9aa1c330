"""A vehicle file of what was found: every key of ``[vehicle]``, each with its interval, or why it stays as told."""

import json
import tomllib
from typing import Any

import msgspec

from groundstation.analysis.identify.found import Found
from groundstation.analysis.identify.parameter import Parameter
from groundstation.analysis.identify.scene import NAMES, hover_signal, most_n
from groundstation.config.load import ConfigError, from_dict
from groundstation.settings.settings import Config

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
