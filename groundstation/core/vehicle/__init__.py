"""The vehicle as the controller is told it is: its figures, limits, model and actuators."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.vehicle.vehicle import (
        GRAVITY,
        ZERO,
        ActuatorCommand,
        ActuatorResponse,
        LimitsConfig,
        Motion,
        Vehicle,
        integrate,
        integrate_actuators,
        integrate_motion,
        lead,
        new,
        schedule,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
