"""Excitation: small motions of many frequencies about a point, from which `groundstation identify` learns a vehicle.

Each axis, and the heading, is a sum of sines at whole multiples of 1/period, no two of them at the same frequency, so
that what one axis does to another can be told apart. All sines of an axis have the same acceleration; Schroeder's
phases (IEEE Trans. Inf. Theory 16, 1970) keep their sum flat. The whole is scaled to the acceleration that is asked
for. It begins and ends at rest, its pace rising and falling as in paced.py.
"""

import math
from itertools import cycle
from typing import Annotated, NamedTuple

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.paced import Paced
from groundstation.core.trajectory.port import Acceleration, Degrees, Point, Reference

LINES = 10
"""Sines an axis; fewer where there are not so many multiples."""
LOOKS = 16
"""The peak is looked for so often within the period of the fastest sine: it is met to 1 %."""

Frequency = Annotated[float, msgspec.Meta(ge=0.05, le=10.0)]


class ExcitationConfig(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="excitation"
):
    """Motions of many frequencies about a point, to identify the vehicle from their recording."""

    position_ned: Point = (0.0, 0.0, -1.0)
    """The point about which it moves [m], world NED; 1 m up is -1 in the third place."""
    acceleration_m_s2: Acceleration = 3.0
    """Largest acceleration [m/s²]; at the frequencies below it keeps within 0.2 m of the point on each axis."""
    lowest_hz: Frequency = 0.4
    """Slowest sine [Hz]; gusts are slower, and take more room."""
    highest_hz: Frequency = 1.6
    """Fastest sine [Hz]; lags are best seen at 1/(2 pi lag), where body rates allow it."""
    yaw_swing_deg: Annotated[float, msgspec.Meta(ge=0.0, le=90.0)] = 10.0
    """How far the heading swings to either side [deg]; 0 leaves the lag of the yaw rate unknown."""
    yaw_deg: Degrees = 0.0
    """Heading in the middle [deg], from north towards east."""
    period_s: Annotated[float, msgspec.Meta(ge=5.0, le=100.0)] = 20.0
    """After this time it begins anew [s]."""
    laps: Annotated[int, msgspec.Meta(ge=1, le=20)] = 3
    """How many periods are flown."""
    ramp_s: Annotated[float, msgspec.Meta(ge=1.0, le=5.0)] = 2.0
    """From rest to full speed in this time, and back to rest at the end [s]."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: there is no room for a sine of each axis and of the heading.
        """
        if math.floor(self.highest_hz * self.period_s) - math.ceil(self.lowest_hz * self.period_s) < 7:
            needed = self.lowest_hz + 8.0 / self.period_s
            raise ValueError(f"highest_hz: expected at least {needed:.3g} Hz with this lowest_hz and period_s")

    def build(self) -> Paced:
        """The trajectory of this config."""
        return Paced(Excitation(self), self.ramp_s, self.laps * self.period_s, self.period_s)


class Sine(NamedTuple):
    """amplitude · sin(rate · t + phase)."""

    amplitude: float
    rate: float
    phase: float


class Excitation:
    """The sines at full speed, for ever. See the port for ``at`` and ``position_at``."""

    __slots__ = ("_axes", "_middle", "_yaw", "_yaw_sines", "period_s")

    duration_s: float | None = None
    """It never ends."""

    def __init__(self, config: ExcitationConfig) -> None:
        self.period_s = config.period_s
        self._middle = config.position_ned
        self._yaw = math.radians(config.yaw_deg)
        first = math.ceil(config.lowest_hz * config.period_s)
        last = math.floor(config.highest_hz * config.period_s)
        lines: tuple[list[int], ...] = ([], [], [], [])
        for line, axis in zip(range(first, last + 1), cycle(lines), strict=False):
            axis.append(line)
        north, east, down, heading = (_spread(axis) for axis in lines)
        looks = [config.period_s * i / (LOOKS * last) for i in range(LOOKS * last)]
        # The same acceleration, or yaw rate, at every frequency of an axis: it decides what actuators must do.
        axes = [_sines(axis, config.period_s, 2) for axis in (north, east, down)]
        peak = max(math.hypot(*(_sum(sines, t)[2] for sines in axes)) for t in looks)
        self._axes = tuple(_scaled(sines, config.acceleration_m_s2 / peak) for sines in axes)
        yaws = _sines(heading[: max(1, len(heading) // 2)], config.period_s, 1)
        swing = max(abs(_sum(yaws, t)[0]) for t in looks)
        self._yaw_sines = _scaled(yaws, math.radians(config.yaw_swing_deg) / swing)

    @property
    def joints_s(self) -> tuple[float, float]:
        """One period [s]."""
        return (0.0, self.period_s)

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        return self.at(time_s).position_ned

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        # Whole periods are taken off the time, exactly, so that late times cost no digits.
        t = math.remainder(time_s, self.period_s)
        (north, east, down), (x, y, z) = self._middle, (_sum(sines, t) for sines in self._axes)
        yaw = _sum(self._yaw_sines, t)
        return Reference(
            (north + x[0], east + y[0], down + z[0]),
            (x[1], y[1], z[1]),
            (x[2], y[2], z[2]),
            (x[3], y[3], z[3]),
            self._yaw + yaw[0],
            yaw[1],
        )


def _spread(lines: list[int]) -> list[int]:
    """At most :data:`LINES` of them, evenly."""
    if len(lines) <= LINES:
        return lines
    return [lines[round(i * (len(lines) - 1) / (LINES - 1))] for i in range(LINES)]


def _sines(lines: list[int], period_s: float, order: int) -> list[Sine]:
    """Sines at these multiples of 1/period, whose derivatives of that ``order`` all have amplitude 1."""
    rates = [2.0 * math.pi * line / period_s for line in lines]
    return [Sine(rate**-order, rate, -math.pi * i * i / len(rates)) for i, rate in enumerate(rates)]


def _scaled(sines: list[Sine], factor: float) -> tuple[Sine, ...]:
    return tuple(Sine(factor * one.amplitude, one.rate, one.phase) for one in sines)


def _sum(sines: tuple[Sine, ...] | list[Sine], t: float) -> tuple[float, float, float, float]:
    """The sum and its first three derivatives at ``t`` [s]."""
    a = b = c = d = 0.0
    for amplitude, w, phase in sines:
        s, k = amplitude * math.sin(w * t + phase), amplitude * math.cos(w * t + phase)
        a, b, c, d = a + s, b + w * k, c - w * w * s, d - w * w * w * k
    return a, b, c, d
