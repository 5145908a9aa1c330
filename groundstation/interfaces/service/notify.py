"""Tells the service manager how we are: the protocol of sd_notify(3), without its library."""

import asyncio
import os
import socket as sockets  # names the family; opens no socket
from collections.abc import Mapping

WATCHDOG_SHARE = 1.0 / 3.0
"""The watchdog is fed so often, as a share of the time after which it bites."""
WAITING_MAX_BYTES = 4096
"""While so much waits for a manager that does not read, nothing is added."""


class Notify:
    """Datagrams to ``$NOTIFY_SOCKET``, if there is one. Never raises: a manager that is gone is no fault."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Read where to, and how often the watchdog wants to be fed."""
        self._address = environment.get("NOTIFY_SOCKET", "")
        usec = environment.get("WATCHDOG_USEC", "")
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.feed_s = float(usec) / 1e6 * WATCHDOG_SHARE if usec.isdigit() and ours and int(usec) > 0 else None
        """How often to feed the watchdog [s]; None for never."""
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Open the socket; an ``@`` stands for the zero byte of an abstract name."""
        if self._address[:1] not in ("/", "@"):
            return
        name = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        try:
            self._transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
                _Silent,
                remote_addr=name,
                family=sockets.AF_UNIX,
            )
        except OSError:
            self._transport = None

    def ready(self) -> None:
        """All that is needed is open."""
        self._send("READY=1")

    def status(self, text: str) -> None:
        """One line for ``systemctl status``."""
        self._send("STATUS=" + text.replace("\n", " "))

    def feed(self) -> None:
        """The event loop is alive."""
        self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """On the way out: landing first, where it flies."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """No more to tell."""
        if self._transport is not None:
            self._transport.abort()

    def _send(self, text: str) -> None:
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() < WAITING_MAX_BYTES:  # type: ignore[attr-defined]  # it has, since 3.4
            transport.sendto(text.encode())


class _Silent(asyncio.DatagramProtocol):
    def error_received(self, exc: Exception) -> None:
        """The manager has gone, or is slow: it will see."""
