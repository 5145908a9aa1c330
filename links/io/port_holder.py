"""Port holder: which program of this machine has a UDP port open, and what else is wrong with an address.

Linux only, and only where that may be seen.

Source: proc(5): /proc/net/udp lists local ports (hexadecimal) with the inode of their socket; a process
holds a socket where one of its /proc/PID/fd leads to that inode.
"""

import socket
from contextlib import suppress
from errno import EACCES, EADDRNOTAVAIL
from pathlib import Path

from links.text import link_notice, printable

_TABLES = ("/proc/net/udp", "/proc/net/udp6")
LONGEST_COMMAND = 80
"""Shown length of a program's command line [characters]."""


def name_holder(port: int) -> str:
    """The program that holds the UDP ``port``, such as ``groundstation fly (process 1234)``; else empty."""
    inodes = _find_inodes(port)
    if not inodes:
        return ""
    sockets = {f"socket:[{inode}]" for inode in inodes}
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended, or is another user's
            if any(str(one.readlink()) in sockets for one in (process / "fd").iterdir()):
                words = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
                command = " ".join(Path(word).name if word.startswith("/") else word for word in words)
                return f"{printable(' '.join(command.split()))[:LONGEST_COMMAND]} (process {process.name})"
    return "a program of another user"


def advise_on_address(error: OSError) -> str:
    """Return what to do about an address that ``error`` refuses for itself, not for who else has it; else empty."""
    if isinstance(error, socket.gaierror):
        return link_notice("address.unknown_host").text
    causes = {EADDRNOTAVAIL: "address.not_ours", EACCES: "address.forbidden"}
    return link_notice(causes[error.errno]).text if error.errno in causes else ""


def _find_inodes(port: int) -> set[str]:
    found = set()
    for table in _TABLES:
        with suppress(OSError):
            for line in Path(table).read_text("ascii").splitlines()[1:]:
                _, local, *_, inode = line.split()[:10]  # the local address is HEX:HEXPORT
                if int(local.rpartition(":")[2], 16) == port:
                    found.add(inode)
    return found
