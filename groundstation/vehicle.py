"""The vehicle as the controller is told it is. Config section ``[vehicle]``."""

import math
from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class Vehicle(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Mass, limits and lags. Defaults: the paper's Blade mQX."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_.-]{1,24}$")] = "mqx"
    """What the operator calls it; asked for before arming."""
    mass_kg: Positive = 0.080
    """With battery and markers [kg]."""
    thrust_max_n: Positive = 1.37
    """Thrust at full command [N]."""
    thrust_min_n: Positive = 0.02
    """Least thrust to command in the air [N]; the law needs T > 0."""
    rate_limits_deg_s: tuple[Positive, Positive, Positive] = (200.0, 200.0, 300.0)
    """Largest commanded roll, pitch and yaw rate [deg/s]."""
    thrust_lag_s: NonNegative = 1.0 / (2.0 * math.pi * 1.5)
    """Time constant from commanded to actual thrust [s]."""
    rate_lag_s: NonNegative = 1.0 / (2.0 * math.pi * 1.5)
    """Time constant from commanded to actual body rates [s]."""
    command_delay_s: NonNegative = 0.0
    """From a command leaving us to the actuators seeing it [s]."""
    frame_period_s: Positive = 0.0225
    """How long a command is held: the period of command frames [s]."""
