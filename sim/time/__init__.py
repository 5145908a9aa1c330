"""Virtual time: an event loop whose clock jumps, with datagrams and streams in memory."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.time.turns import in_turns, percentile
    from sim.time.virtual_time import Address, VirtualTimeLoop

_MODULES = {"turns": ("in_turns", "percentile"), "virtual_time": ("Address", "VirtualTimeLoop")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
