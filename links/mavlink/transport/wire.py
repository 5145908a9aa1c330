"""The seam between MAVLink and the medium that carries it: UDP, TCP or a serial port.

A frame leaves at once or never: one that would have to wait is dropped, as it would be stale when it left.
"""

from collections.abc import Awaitable, Callable
from typing import Any, Protocol

from links.mavlink.protocol import MavlinkLinkConfig


class Wire(Protocol):
    """An open medium."""

    datagrams: bool
    """True where what is heard at once holds whole frames; a stream may be cut anywhere."""
    speaks_first: bool
    """True where it is known whom to send to before anybody has been heard."""

    def leave(self, frame: bytes, to: Any) -> str:
        """Send ``frame`` to the address ``to`` (None: the only one there is).

        Returns why it was dropped instead, or an empty string.
        """
        ...

    def cut(self) -> None:
        """Release the medium at once, with all that waits in it. Nothing is heard afterwards."""
        ...


class Ear(Protocol):
    """What an open medium reports to."""

    def hear(self, data: bytes, source: Any) -> None:
        """``data`` came from the address ``source``."""
        ...

    def undeliverable(self) -> None:
        """The network gave back a datagram of ours."""
        ...

    def gone(self, why: str) -> None:
        """The medium has ended by itself; ``why`` completes "the link is lost: "."""
        ...


Opener = Callable[[MavlinkLinkConfig, Ear], Awaitable[Wire]]


def opener(config: MavlinkLinkConfig) -> Opener:
    """The function that opens the medium of ``config``; it raises OSError."""
    if config.serial is not None:
        from links.mavlink.transport.serial import open_serial

        return open_serial
    if config.tcp is not None:
        from links.mavlink.transport.tcp import open_tcp

        return open_tcp
    from links.mavlink.transport.udp import open_udp

    return open_udp
