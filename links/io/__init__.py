"""What the links open: sockets' addresses, serial ports, key files, shared memory."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.io.address import beyond, is_loopback, parse_address
    from links.io.datagrams import Datagrams
    from links.io.key_file import make_key, read_key
    from links.io.mailbox import CAPACITY_BYTES, Mailbox
    from links.io.serial_port import create_serial_connection, is_pseudo_terminal, open_serial_connection
    from links.io.suspend import Sleep

_MODULES = {
    "address": ("beyond", "is_loopback", "parse_address"),
    "datagrams": ("Datagrams",),
    "key_file": ("make_key", "read_key"),
    "mailbox": ("CAPACITY_BYTES", "Mailbox"),
    "serial_port": ("create_serial_connection", "is_pseudo_terminal", "open_serial_connection"),
    "suspend": ("Sleep",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
