"""Datagrams that leave now or never."""

import asyncio
from typing import Any


class Datagrams:
    """The sending side of a datagram endpoint.

    asyncio keeps a datagram that the kernel has no room for (EAGAIN) and sends it later, when it may have passed its
    deadline. So what is sent here goes through a second handle on the same socket, and is dropped instead.
    """

    def __init__(self, transport: asyncio.DatagramTransport) -> None:
        """Send on ``transport``, which may be connected or not."""
        self._transport = transport
        shared = transport.get_extra_info("socket")
        self._socket: Any = shared.dup() if shared is not None else None
        self._connected = transport.get_extra_info("peername") is not None

    def send(self, data: bytes, peer: Any) -> str:
        """Send ``data`` to ``peer`` (None on a connected endpoint); returns why it did not leave, or nothing."""
        if peer is None and not self._connected:
            return "no_peer"
        if self._socket is None:
            self._transport.sendto(data, peer)
            return ""
        try:
            if self._connected:
                self._socket.send(data)
            else:
                self._socket.sendto(data, peer)
        except (BlockingIOError, InterruptedError):
            return "congested"
        except OSError:
            return "undeliverable"
        return ""

    def abort(self) -> None:
        """Close both handles; nothing leaves any more."""
        if self._socket is not None:
            self._socket.close()
        self._transport.abort()
