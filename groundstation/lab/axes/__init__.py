"""Axis calibration: a tracker's axes and latency from a vehicle carried by hand."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.lab.axes.command import carry

_MODULES = {"command": ("carry",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
