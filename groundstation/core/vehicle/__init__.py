"""The configured vehicle: figures, limits, model and actuators."""

from groundstation.core.vehicle.vehicle import (
    GRAVITY,
    ActuatorCommand,
    ActuatorResponse,
    Delay,
    Drag,
    FramePeriod,
    Lag,
    LimitsConfig,
    Mass,
    Motion,
    RateLimit,
    Thrust,
    Vehicle,
    begin_response,
    integrate,
    integrate_actuators,
    integrate_motion,
    lead,
    schedule,
)
