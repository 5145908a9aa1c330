"""What the links open: network addresses and datagrams, serial ports, key files; and whether the computer slept."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.io.key_file import make_key, read_key
    from links.io.network import Datagrams, beyond, is_loopback, parse_address
    from links.io.serial_port import (
        create_serial_connection,
        discard,
        is_pseudo_terminal,
        open_port,
        open_serial_connection,
        waiting,
    )
    from links.io.suspend import Sleep

_MODULES = {
    "key_file": ("make_key", "read_key"),
    "network": ("Datagrams", "beyond", "is_loopback", "parse_address"),
    "serial_port": (
        "create_serial_connection",
        "discard",
        "is_pseudo_terminal",
        "open_port",
        "open_serial_connection",
        "waiting",
    ),
    "suspend": ("Sleep",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
