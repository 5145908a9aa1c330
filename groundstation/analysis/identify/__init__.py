"""Thrust, lags, delay, drag and noise of a vehicle from a recorded flight."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.identify.command import identify_command

_MODULES = {"command": ("identify_command",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
