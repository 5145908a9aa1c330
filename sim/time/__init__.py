"""Virtual time: an event loop whose clock jumps, with datagrams and streams in memory."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.time.virtual_time import Address, VirtualTimeLoop, in_virtual_time


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
