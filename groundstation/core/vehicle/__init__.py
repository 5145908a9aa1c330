"""The configured vehicle: figures, limits, model and actuators."""

from groundstation.core.vehicle.vehicle import (
    GRAVITY,
    ActuatorCommand,
    ActuatorResponse,
    LimitsConfig,
    Motion,
    Vehicle,
    begin_response,
    integrate,
    integrate_actuators,
    integrate_motion,
    lead,
    schedule,
)
