"""Wires of the links: addresses, datagrams, serial ports, key files, the computer's sleep."""

from links.io.child import describe_exit, make_child_command, open_child, start_child
from links.io.key_file import KEY_BYTES, make_key, read_key
from links.io.network import format_address, is_loopback, parse_address, remote_setting
from links.io.wires import (
    NETWORK,
    OURS_S,
    Datagrams,
    Network,
    Sleep,
    advise_on_address,
    discard,
    explain_error,
    is_pseudo_terminal,
    open_port,
    waiting,
)
