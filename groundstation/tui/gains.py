"""The gains of the controller in force: their values, what they may be, and what the operator should know."""

import math
from collections.abc import Mapping
from typing import Any, get_args

import msgspec

from groundstation.control.controllers import ControllerConfig

ABOUT = "It moves there over 2 s, and back by itself if the error or V rises."


class Gain(msgspec.Struct, frozen=True):
    """One gain."""

    key: str
    """Dotted, as in the configuration."""
    value: float
    least: float
    most: float
    open_ends: bool
    """True where ``least`` itself is not allowed."""

    def bounds(self) -> str:
        """What it may be."""
        low = f"{'>' if self.open_ends else '≥'} {self.least:g}" if self.least > -math.inf else ""
        high = f"≤ {self.most:g}" if self.most < math.inf else ""
        return ", ".join(one for one in (low, high) if one) or "any"

    def text(self) -> str:
        """For who is to change it."""
        return f"now {self.value:g}, may be {self.bounds()}. {ABOUT}"

    def read(self, typed: str) -> float | str:
        """The value that was typed, or why it can't be taken."""
        try:
            value = float(typed)
        except ValueError:
            return f"{typed!r} is no number: nothing was changed"
        below = value <= self.least if self.open_ends else value < self.least
        if below or not value <= self.most or not math.isfinite(value):
            return f"{self.key} may be {self.bounds()}, not {typed}: nothing was changed"
        return value


def gains(config: Mapping[str, Any], changed: Mapping[str, float]) -> list[Gain]:
    """The numbers of the section ``controller``, with those that were ``changed`` since."""
    section = config.get("controller", {})
    bounds = _bounds(section.get("kind", "adaptive"))
    found = []
    for name, value in section.items():
        if isinstance(value, float | int) and not isinstance(value, bool):
            key = f"controller.{name}"
            found.append(Gain(key, changed.get(key, float(value)), *bounds.get(name, (-math.inf, math.inf, False))))
    return found


def _bounds(kind: str) -> dict[str, tuple[float, float, bool]]:
    """Least and most value of each number, and whether the least is excluded, by the configuration's own types."""
    for config in get_args(ControllerConfig) or (ControllerConfig,):
        if config.__struct_config__.tag == kind:
            info = msgspec.inspect.type_info(config)
            assert isinstance(info, msgspec.inspect.StructType)
            return {field.name: _bound(field.type) for field in info.fields}
    return {}


def _bound(kind: msgspec.inspect.Type) -> tuple[float, float, bool]:
    if isinstance(kind, msgspec.inspect.UnionType):
        kind = next((one for one in kind.types if isinstance(one, msgspec.inspect.FloatType)), kind)
    if not isinstance(kind, msgspec.inspect.FloatType | msgspec.inspect.IntType):
        return -math.inf, math.inf, False
    least = next((bound for bound in (kind.gt, kind.ge) if bound is not None), -math.inf)
    most = next((bound for bound in (kind.lt, kind.le) if bound is not None), math.inf)
    return float(least), float(most), kind.gt is not None
