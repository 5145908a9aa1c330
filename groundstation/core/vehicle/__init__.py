"""The vehicle as the controller is told it is: its figures, limits, model and actuators."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.vehicle.model import ZERO, Drive, Driven, Motion, carried, driven, lead, new, rolled
    from groundstation.core.vehicle.vehicle import LimitsConfig, Vehicle

_MODULES = {
    "model": ("Drive", "Driven", "Motion", "ZERO", "carried", "driven", "lead", "new", "rolled"),
    "vehicle": ("LimitsConfig", "Vehicle"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
