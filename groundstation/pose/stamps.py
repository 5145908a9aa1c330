"""Check of a source's time stamps: their unit, by the rate at which poses arrive. Sans-IO."""

import math

from groundstation.core.messages import Check, PoseKind, PoseStatus, Verdict, notice
from groundstation.pose.sources import FAST

FAIL_RATE = 2.0
"""Ratio of rates above which the stamps are in the wrong unit [-]."""
UNITS = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
"""Units of time stamps, by their length [s]."""


def check_stamp_rate(source: PoseStatus, kind: PoseKind) -> Check | None:
    """Check the unit of the stamps; None if it is right, or can't be wrong."""
    rate = source.stamp_rate
    if rate is None or not kind.stamp_field:
        return None
    factor = max(rate, 1.0 / rate) if rate > 0.0 else math.inf
    if factor <= FAST:  # nor does a stall of 0.3 s in 2 s make more than 1.18 of it
        return None
    unit_s = kind.stamp_unit_s / rate if rate > 0.0 else math.inf
    near = [name for one_s, name in UNITS.items() if 1.0 / FAST < unit_s / one_s < FAST]
    says = notice(
        "pose.stamp_rate",
        factor=f"{factor:.3g}" if factor < 100.0 else f"{factor:.0f}",
        way="fast" if rate > 1.0 else "slow",
        limit=FAIL_RATE,
        field=kind.stamp_field,
        unit=UNITS[kind.stamp_unit_s],
        looks_like=f", and looks like {near[0]}" if near else "",
    )
    return Check.of("pose rate", Verdict.FAIL if factor > FAIL_RATE else Verdict.WARN, says)
