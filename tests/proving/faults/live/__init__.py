"""Faults that need processes of their own, in real time."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.faults.live.live import fly_live_cells

_MODULES = {"live": ("fly_live_cells",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
