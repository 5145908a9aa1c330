"""What a flight may ask of its vehicle, beside what the vehicle can do. Config section ``[limits]``."""

from typing import Annotated

import msgspec


class LimitsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bounds on the planned flight; a trajectory that would leave them is refused before take-off."""

    max_speed_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=50.0)] | None = None
    """Fastest the reference may go [m/s]."""
    max_acceleration_m_s2: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] | None = None
    """Largest acceleration of the reference [m/s²]."""
    max_tilt_deg: Annotated[float, msgspec.Meta(gt=0.0, le=80.0)] = 45.0
    """Farthest the vehicle may lean to follow the reference in still air [deg]."""
    reserve: Annotated[float, msgspec.Meta(ge=0.0, le=0.4)] = 0.1
    """Share of the vehicle's thrust range, at either end, and of its body rates kept for wind and errors [-]."""
