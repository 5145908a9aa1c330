"""Disturbance as it is shown: the observable sum, and its split into wind and thrust scale with their intervals.

While thrust stays as it is, only the sum of wind and thrust scale is observable. Every screen, summary, report and
MQTT message shows this reading, so one flight has one number.
"""

import math
from collections import deque

from groundstation.core.geometry import Vec3, third_column
from groundstation.core.messages.snapshot import DisturbanceReading, Estimate

MEAN_S = 1.0
"""A reading is the mean of the commands of so long [s]: pose noise and gusts are faster."""
QUANTILE_95 = 1.96
"""Half of the interval that holds 95 % of normal errors, over their standard deviation [-]."""
FLOWN = frozenset({"hold", "tracking", "moving", "returning"})
"""Mission states whose commands count: near the floor, ground effect and the floor's push would."""


class DisturbanceMeter:
    """Makes the reading of a flight from its commands."""

    def __init__(self, mass_kg: float) -> None:
        """Begin with a vehicle that is configured to have ``mass_kg``."""
        self._mass = mass_kg
        self._rows: deque[tuple[float, Vec3, float]] = deque()
        self._newest: Estimate | None = None

    def add(self, time_s: float, estimate: Estimate) -> None:
        """Take the estimate of one command at ``time_s`` [s]."""
        if not math.isfinite(estimate.effectiveness):
            return  # a controller of the user's own may run without this observer
        push = (estimate.effectiveness - 1.0) * estimate.motion.thrust / self._mass
        axis, (north, east, down) = third_column(estimate.motion.attitude), estimate.disturbance
        total = north - push * axis[0], east - push * axis[1], down - push * axis[2]
        self._rows.append((time_s, total, down))
        self._newest = estimate
        while self._rows[0][0] <= time_s - MEAN_S:
            self._rows.popleft()

    @property
    def reading(self) -> DisturbanceReading | None:
        """The reading now; None before the first command."""
        estimate, rows = self._newest, self._rows
        if estimate is None:
            return None
        share = 1.0 / len(rows)
        north, east, down = (share * sum(total[i] for _, total, _ in rows) for i in range(3))
        half = QUANTILE_95 * estimate.effectiveness_deviation
        push, known = estimate.motion.thrust / self._mass, math.isfinite(half)
        return DisturbanceReading(
            ned_m_s2=(north, east, down),
            wind_down_m_s2=share * sum(wind for _, _, wind in rows),
            wind_down_error_m_s2=half * push * abs(third_column(estimate.motion.attitude)[2]) if known else None,
            thrust_scale=estimate.effectiveness,
            thrust_scale_error=half if known else None,
        )
