"""Disturbance as it is shown: the observable sum, and its split into wind and thrust scale with
their intervals.

While thrust stays as it is, only the sum of wind and thrust scale is observable. Every screen,
summary, report and MQTT message shows this reading, so one flight has one number.
"""

import math
from collections import deque

from groundstation.core.geometry import Quat, Vec3, third_column
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
        self._scale, self._deviation, self._lift_m_s2, self._upright = 1.0, 0.0, 0.0, 1.0

    def add(self, time_s: float, estimate: Estimate) -> None:
        """Take the estimate of one command at ``time_s`` [s]."""
        motion = estimate.motion
        self.add_parts(
            time_s, motion.attitude, motion.thrust, estimate.disturbance, estimate.effectiveness,
            estimate.effectiveness_deviation,
        )  # fmt: skip

    def add_parts(
        self,
        time_s: float,
        attitude: Quat,
        thrust_n: float,
        disturbance: Vec3,
        scale: float,
        deviation: float,
    ) -> None:
        """Take what a recording holds of an estimate: ``scale`` is λ̂ [-], ``deviation`` its
        standard deviation [-].
        """
        if not math.isfinite(scale):
            return  # a controller of the user's own may run without this observer
        axis, (north, east, down) = third_column(attitude), disturbance
        push = (scale - 1.0) * thrust_n / self._mass
        total = north - push * axis[0], east - push * axis[1], down - push * axis[2]
        self._rows.append((time_s, total, down))
        self._scale, self._deviation = scale, deviation
        self._lift_m_s2, self._upright = thrust_n / self._mass, abs(axis[2])
        while self._rows[0][0] <= time_s - MEAN_S:
            self._rows.popleft()

    @property
    def reading(self) -> DisturbanceReading | None:
        """The reading now; None before the first command."""
        rows = self._rows
        if not rows:
            return None
        share = 1.0 / len(rows)
        north, east, down = (
            share * sum(axis) for axis in zip(*(total for _, total, _ in rows), strict=True)
        )
        half = QUANTILE_95 * self._deviation
        known = math.isfinite(half)
        return DisturbanceReading(
            ned_m_s2=(north, east, down),
            wind_down_m_s2=share * sum(wind for _, _, wind in rows),
            wind_down_error_m_s2=half * self._lift_m_s2 * self._upright if known else None,
            thrust_scale=self._scale,
            thrust_scale_error=half if known else None,
        )
