"""The gains that may be changed in flight: their values, how far one change may go, and what follows. Sans-IO."""

import math
from collections.abc import Mapping
from typing import Any

import msgspec

from groundstation.core.safety import RAMP_S, STEP_FACTOR


class Gain(msgspec.Struct, frozen=True):
    """One gain."""

    key: str
    """Dotted, as in the configuration."""
    value: float
    """As it is now."""
    begun: float
    """As it is configured; NaN where that is not known."""

    def text(self) -> str:
        """For who is to change it."""
        return (
            f"now {self.value:g}; one change goes from {self.value / STEP_FACTOR:g} to {self.value * STEP_FACTOR:g}. "
            f"It gets there within {RAMP_S:g} s, and goes back by itself where the error or V rises."
        )

    def read(self, typed: str) -> float | str:
        """The value that was typed, or why it can't be taken; bounds are the ground station's to judge."""
        try:
            value = float(typed)
        except ValueError:
            return f"{typed!r} is no number: nothing was changed"
        return value if math.isfinite(value) else f"{typed} is no gain: nothing was changed"


def gains(config: Mapping[str, Any], now: Mapping[str, float]) -> list[Gain]:
    """Those of a snapshot, with what they are configured to be."""
    section = config.get("controller", {})
    found = []
    for key, value in now.items():
        begun = section.get(key.rpartition(".")[2], math.nan)
        found.append(Gain(key, value, float(begun) if isinstance(begun, float | int) else math.nan))
    return found
