"""Taps on the wires of a flight: every byte in and out, seen at the event loop, whatever link or source opens them.

A context variable says whose code opens a wire: in virtual time the simulated side lives on the same loop. What the
pacer's own process opens is not seen.
"""

import asyncio
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

from groundstation.recording.records import NO_PORT, Opened, Peer, Received, Record, Sent
from links.io import open_serial_connection

_TAPPED: "ContextVar[Wires | None]" = ContextVar("tapped", default=None)


class Wires:
    """The wires of one flight."""

    def __init__(self, give: Callable[[Record], None]) -> None:
        """``give`` takes each record as it happens."""
        self._give = give
        self._opened = 0
        self._turn = 0
        self._turn_begun = False
        self._loop: Any = None

    def tap(self) -> None:
        """Tap every UDP, TCP or serial wire that this task, or one that it starts, opens from now on."""
        self._loop = asyncio.get_running_loop()
        _TAPPED.set(self)
        if not getattr(self._loop.create_datagram_endpoint, "taps", False):
            self._loop.create_datagram_endpoint = _tapping(self._loop.create_datagram_endpoint, "udp")
            self._loop.create_connection = _tapping(self._loop.create_connection, "tcp")
            own = getattr(self._loop, "create_serial_connection", open_serial_connection)
            self._loop.create_serial_connection = _tapping(own, "serial")

    def opened(self, kind: str, local: Any, remote: Any) -> int:
        """A wire was opened; returns its number."""
        number = self._opened
        self._opened += 1
        self._give(Opened(self._loop.time(), number, kind, _peer(local), _peer(remote)))
        return number

    def received(self, wire: int, data: bytes, peer: Any) -> None:
        """Bytes came in."""
        if not self._turn_begun:
            self._turn_begun = True
            self._loop.call_soon(self._next_turn)
        self._give(Received(self._loop.time(), wire, self._turn, _peer(peer), data))

    def sent(self, wire: int, data: bytes, peer: Any) -> None:
        """Bytes left."""
        self._give(Sent(self._loop.time(), wire, _peer(peer), bytes(data)))

    def _next_turn(self) -> None:
        self._turn += 1
        self._turn_begun = False


def _peer(address: Any) -> Peer:
    return None if address is None else (address[0], address[1])


def _tapping(open_wire: Callable[..., Any], kind: str) -> Callable[..., Any]:
    """The loop's method ``open_wire`` with a tap on what it opens."""

    async def tapped(factory: Callable[[], Any], *args: Any, **options: Any) -> Any:
        wires = _TAPPED.get()
        if wires is None:
            return await open_wire(factory, *args, **options)
        if kind == "tcp":
            local, remote = None, args[:2] or (options.get("host"), options.get("port"))
        elif kind == "serial":
            local, remote = None, (args[0], NO_PORT)
        else:
            local, remote = (*args, None, None)[:2]
            local, remote = options.get("local_addr", local), options.get("remote_addr", remote)
        tap = Tap(wires, kind, local, remote)
        await open_wire(lambda: tap.around(factory()), *args, **options)
        return tap.transport, tap.inner

    tapped.taps = True  # type: ignore[attr-defined]  # so that it is done once
    return tapped


class Tap(asyncio.DatagramProtocol, asyncio.Protocol):
    """Stands between the loop and the protocol of one wire."""

    def __init__(self, wires: Wires, kind: str, local: Any, remote: Any) -> None:
        """``kind`` of wire, with the addresses that were asked for."""
        self._wires = wires
        self._asked = kind, local, remote
        self._wire = -1
        self.inner: Any = None
        self.transport: Any = None

    def around(self, inner: Any) -> "Tap":
        """Take the protocol that is to be served."""
        self.inner = inner
        return self

    def connection_made(self, transport: Any) -> None:
        """The wire is open: give it a transport that is tapped too."""
        self._wire = self._wires.opened(*self._asked)
        self.transport = TappedTransport(transport, self._wires, self._wire)
        self.inner.connection_made(self.transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Note it, and pass it on."""
        self._wires.received(self._wire, data, addr)
        self.inner.datagram_received(data, addr)

    def data_received(self, data: bytes) -> None:
        """Note it, and pass it on."""
        self._wires.received(self._wire, data, None)
        self.inner.data_received(data)

    def error_received(self, exc: Exception) -> None:
        """Pass it on."""
        self.inner.error_received(exc)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass it on."""
        self.inner.connection_lost(exc)

    def eof_received(self) -> bool | None:
        """Pass it on."""
        kept: bool | None = self.inner.eof_received()
        return kept

    def pause_writing(self) -> None:
        """Pass it on."""
        self.inner.pause_writing()

    def resume_writing(self) -> None:
        """Pass it on."""
        self.inner.resume_writing()


class TappedTransport:
    """A transport, or a socket, whose sending is noted; all else is the original's."""

    def __init__(self, original: Any, wires: Wires, wire: int) -> None:
        """``original`` does the work."""
        self._original = original
        self._wires = wires
        self._wire = wire

    def __getattr__(self, name: str) -> Any:
        """The original's."""
        return getattr(self._original, name)

    def write(self, data: bytes) -> None:
        """Of a connection."""
        self._original.write(data)
        self._wires.sent(self._wire, data, None)

    def sendto(self, data: bytes, addr: Any = None) -> Any:
        """Of a datagram endpoint or of a socket."""
        done = self._original.sendto(data, addr)
        self._wires.sent(self._wire, data, addr)
        return done

    def send(self, data: bytes) -> Any:
        """Of a socket, or of a serial port."""
        done = self._original.send(data)
        self._wires.sent(self._wire, data, None)
        return done

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """The socket is tapped too: some send past the transport, so that nothing waits in it."""
        found = self._original.get_extra_info(name, default)
        return TappedTransport(found, self._wires, self._wire) if name == "socket" and found is not None else found

    def dup(self) -> Any:
        """Of a socket: a second handle."""
        return TappedTransport(self._original.dup(), self._wires, self._wire)
