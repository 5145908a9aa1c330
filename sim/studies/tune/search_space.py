"""Which gains are searched, and between which bounds."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec import inspect as mi

from groundstation.config import ConfigError
from groundstation.core.control import ControllerConfig, Custom, Gains, bound_decrease

SECTION = "controller."
KEYS: dict[str, tuple[str, ...]] = {
    "adaptive": ("k2", "k3", "kb", "kappa", "sigma_slope", "k_omega"),
    "uncompensated": ("k2", "k3", "kb", "sigma_slope"),
    "geometric": ("k_position", "k_velocity", "k_integral", "coupling", "k_attitude"),
    "pid": ("p_position", "p_velocity", "i_velocity", "d_velocity", "p_attitude"),
    "indi": ("k_position", "k_velocity", "k_acceleration", "filter_s", "k_attitude"),
}
"""What is searched where ``--keys`` names nothing: the gains of the law, not bounds or facts. A controller of the
user's own has all its options searched that are positive numbers."""
AROUND = 4.0
"""Bounds are the default divided and multiplied by this."""
DIGITS = 4
"""Gains are tried as they are written down: with so many digits."""


class Key(msgspec.Struct, frozen=True):
    """One gain to search, on a logarithmic scale."""

    name: str
    """Within ``[controller]``."""
    low: float
    high: float
    start: float
    """What the configuration has."""

    def round(self, value: float) -> float:
        """``value`` with as many digits as are written down, within the bounds."""
        return min(max(round_gain(value), self.low), self.high)


Point = Mapping[str, float]


def space(controller: ControllerConfig, keys: Sequence[str]) -> list[Key]:
    """The gains of ``controller`` that ``keys`` (``controller.k2`` or ``k2=0.5:8``) name, or the usual ones.

    Bounds without ``=LOW:HIGH`` are a factor around the default, within what the key accepts, and hold the value in
    force. Where ``keys`` is empty, gains that are switched off (0) stay off.

    Raises:
        ConfigError: a key that is no gain of this controller, is switched off, or bounds that make no sense.
    """
    accepted = _numbers(controller)
    if keys:
        return [_key(controller, accepted, text) for text in keys]
    usual = KEYS.get(controller.kind, accepted if isinstance(controller, Custom) else ())
    found = [_key(controller, accepted, name) for name in usual if _value(controller, name) > 0.0]
    if not found:
        raise ConfigError("--keys", f"{controller.kind} has no usual gains to search, so name some")
    return found


def with_gains(controller: ControllerConfig, gains: Point) -> ControllerConfig:
    """``controller`` with other gains."""
    if not isinstance(controller, Custom):
        return msgspec.structs.replace(controller, **gains)
    own = {name: value for name, value in gains.items() if name in controller.options}
    rest = {name: value for name, value in gains.items() if name not in own}
    return msgspec.structs.replace(controller, options={**controller.options, **own}, **rest)


def round_gain(value: float) -> float:
    """``value`` with as many digits as are written down."""
    return float(f"{value:.{DIGITS}g}")


def loses_proof(controller: ControllerConfig) -> bool:
    """True where this form of adaptation has a proof, and these gains do not satisfy it (kb² κ < 4 k3)."""
    if not isinstance(controller, Gains) or controller.composite == "raw" or controller.kb == 0.0:
        return False
    return bound_decrease(controller).startswith("none")


def _numbers(controller: ControllerConfig) -> dict[str, tuple[mi.FloatType, float | None]]:
    """Every key of ``controller`` that holds any number, with its type and its default."""
    if isinstance(controller, Custom):
        options = {
            n: v for n, v in controller.options.items() if isinstance(v, int | float) and v is not True and v > 0
        }
        return {name: (mi.FloatType(), float(value)) for name, value in options.items()}
    info = mi.type_info(type(controller))
    assert isinstance(info, mi.StructType)
    kinds = ((field, field.type.type if isinstance(field.type, mi.Metadata) else field.type) for field in info.fields)
    return {
        field.name: (kind, field.default if isinstance(field.default, float) else None)
        for field, kind in kinds
        if isinstance(kind, mi.FloatType) and field.name != "gravity"
    }


def _value(controller: ControllerConfig, name: str) -> float:
    found: Any = controller.options[name] if isinstance(controller, Custom) else getattr(controller, name)
    return float(found)


def _key(controller: ControllerConfig, accepted: Mapping[str, Any], text: str) -> Key:
    name, equals, bounds = text.partition("=")
    name = name.strip().removeprefix(SECTION)
    dotted = SECTION + name
    if name not in accepted:
        raise ConfigError("--keys", f"expected some of {_list_names(accepted)}, got {dotted!r}")
    kind, default = accepted[name]
    start = _value(controller, name)
    if equals:
        low, high = _bounds(dotted, bounds)
        for bound in (low, high):
            if not _allows(kind, bound):
                raise ConfigError("--keys", f"{dotted} does not accept {bound:g}")
    elif start == 0.0:
        raise ConfigError("--keys", f"{dotted} is switched off (0): switch it on with --set, or leave it out")
    else:
        middle = default or start
        # What a key accepts may end within the range, as a share ends at 1.
        ceiling = min(bound for bound in (kind.le, kind.lt and 0.999 * kind.lt, math.inf) if bound is not None)
        low = min(round_gain(middle / AROUND), start)
        high = max(min(round_gain(middle * AROUND), ceiling), start)
        low = max(low, kind.ge if kind.ge is not None else low)
    return Key(name, low, high, start)


def _bounds(dotted: str, text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise ConfigError("--keys", f"expected {dotted}=LOW:HIGH, such as 0.5:8, got {text!r}") from None
    if not 0.0 < low < high < math.inf:
        raise ConfigError("--keys", f"expected 0 < LOW < HIGH for {dotted}, got {text!r}")
    return low, high


def _allows(kind: mi.FloatType, value: float) -> bool:
    return (
        (kind.gt is None or value > kind.gt)
        and (kind.ge is None or value >= kind.ge)
        and (kind.lt is None or value < kind.lt)
        and (kind.le is None or value <= kind.le)
    )


def _list_names(names: Iterable[str]) -> list[str]:
    return [SECTION + name for name in names]
