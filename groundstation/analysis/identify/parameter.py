"""One figure of a vehicle: its value and interval, or why the flight does not tell."""

import math

import msgspec

WIDE = 1.96
"""Deviations to either side of a 95 % interval."""
FLY = "not identifiable from this flight: fly trajectory.kind = 'excitation'"
AGAIN = (
    "not identifiable from this flight: fly it for longer (trajectory.laps), or harder (trajectory.acceleration_m_s2)"
)


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """One figure."""

    name: str
    title: str
    unit: str
    value: float | None
    """None where the flight does not tell."""
    interval: tuple[float, float] | None
    """95 %."""
    told: float | None
    """What the controller was told; None where it is told nothing of this."""
    note: str = ""

    @property
    def identified(self) -> bool:
        """Whether the flight tells."""
        return self.value is not None


def judged(
    name: str,
    title: str,
    unit: str,
    value: float,
    deviation: float,
    enough: float,
    *,
    moved: bool = True,
    told: float | None = None,
    least: float = -math.inf,
    most: float = math.inf,
    note: str = "",
) -> Parameter:
    """The parameter; without a value where half its interval is more than ``enough``, or where nothing ``moved``."""
    half = WIDE * deviation
    if not (moved and half <= enough):
        return Parameter(name=name, title=title, unit=unit, value=None, interval=None, told=told, note=FLY)
    low, high = (float(min(max(edge, least), most)) for edge in (value - half, value + half))
    value, told = float(min(max(value, least), most)), None if told is None else float(told)
    return Parameter(name=name, title=title, unit=unit, value=value, interval=(low, high), told=told, note=note)
