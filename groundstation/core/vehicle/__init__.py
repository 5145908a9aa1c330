"""The vehicle as the controller is told it is: its figures, limits, model and actuators."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.vehicle.vehicle import (
        ZERO,
        Drive,
        Driven,
        LimitsConfig,
        Motion,
        Vehicle,
        carried,
        driven,
        lead,
        new,
        rolled,
    )

_MODULES = {
    "vehicle": (
        "Drive",
        "Driven",
        "LimitsConfig",
        "Motion",
        "Vehicle",
        "ZERO",
        "carried",
        "driven",
        "lead",
        "new",
        "rolled",
    )
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
