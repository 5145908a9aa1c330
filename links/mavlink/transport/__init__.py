"""What carries MAVLink: UDP, TCP or a serial port, opened again when it is lost."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.mavlink.transport.reconnecting import LastingWire

_MODULES = {"reconnecting": ("LastingWire",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
