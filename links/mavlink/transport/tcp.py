"""MAVLink over TCP, as a client: simulators, and telemetry radios with a network port.

TCP repeats what got lost until it arrives, so a command may arrive late. Against that:

- A frame is dropped where older ones have waited for their acknowledgement for longer than ``QUEUE_S``.
- After ``STALL_S`` of that the connection is cut so that nothing in it arrives any more (SO_LINGER 0: a reset).

What the other end has acknowledged and not read yet is out of our hands: prefer UDP where there is a choice.
"""

import asyncio
import fcntl
import struct
import termios
from collections import deque
from typing import Any

from links.io import parse_address
from links.mavlink.protocol import MavlinkLinkConfig
from links.mavlink.transport.wire import Ear

QUEUE_S = 0.1
"""Frames may wait for the other end this long [s]; a delayed acknowledgement takes 0.04."""
STALL_S = 0.25
"""After this long the connection is cut [s]."""
OPEN_S = 5.0
"""How long the other end may take to accept [s]."""

_SOL_SOCKET, _SO_LINGER = 1, 13  # the same on every Linux that Python runs on


class TcpWire(asyncio.Protocol):
    """Implements :class:`links.mavlink.transport.wire.Wire`."""

    datagrams = False
    speaks_first = True

    def __init__(self, ear: Ear) -> None:
        """Opened by the event loop."""
        self._ear: Ear | None = ear
        self._transport: Any = None
        self._loop = asyncio.get_running_loop()
        self._sent = 0
        self._unacknowledged: deque[tuple[int, float]] = deque()
        """For each frame: bytes sent up to its end, and when."""
        self._watch: asyncio.TimerHandle | None = None

    def leave(self, frame: bytes, to: Any) -> str:
        """Send one frame."""
        transport = self._transport
        if transport.is_closing() or transport.get_write_buffer_size() or self._waited_s() > QUEUE_S:
            return "full"
        transport.write(frame)
        self._sent += len(frame)
        self._unacknowledged.append((self._sent, self._loop.time()))
        if self._watch is None:
            self._watch = self._loop.call_later(QUEUE_S, self._look)
        return ""

    def _look(self) -> None:
        """While anything waits, see for how long."""
        self._watch = None
        if self._ear is None:
            return
        if self._waited_s() > STALL_S:
            self._end("the other end acknowledges nothing any more")
        elif self._unacknowledged:
            self._watch = self._loop.call_later(QUEUE_S / 4, self._look)

    def _waited_s(self) -> float:
        """How long ago the oldest frame left that is not acknowledged yet [s]."""
        waiting = self._unacknowledged
        if waiting:
            queued = _queued(self._transport.get_extra_info("socket")) + self._transport.get_write_buffer_size()
            while waiting and waiting[0][0] <= self._sent - queued:
                waiting.popleft()
        return self._loop.time() - waiting[0][1] if waiting else 0.0

    def cut(self) -> None:
        """Reset the connection."""
        self._ear = None
        if self._watch is not None:
            self._watch.cancel()
        self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep it (called by the event loop)."""
        self._transport = transport
        transport.get_extra_info("socket").setsockopt(_SOL_SOCKET, _SO_LINGER, struct.pack("ii", 1, 0))

    def data_received(self, data: bytes) -> None:
        """Pass it on (called by the event loop)."""
        if self._ear is not None:
            self._ear.hear(data, None)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass it on (called by the event loop)."""
        self._end("the other end closed the TCP connection" if exc is None else f"the TCP connection broke ({exc})")

    def _end(self, why: str) -> None:
        ear, self._ear = self._ear, None
        if self._watch is not None:
            self._watch.cancel()
        self._transport.abort()
        if ear is not None:
            ear.gone(why)


def _queued(socket: Any) -> int:
    """Bytes that the other end has not acknowledged yet."""
    try:
        count: int = struct.unpack("i", fcntl.ioctl(socket.fileno(), termios.TIOCOUTQ, b"\0\0\0\0"))[0]
    except OSError:  # closed meanwhile, or a system that can't tell
        return 0
    return count


async def open_tcp(config: MavlinkLinkConfig, ear: Ear) -> TcpWire:
    """Connect to ``tcp``; raises OSError."""
    assert config.tcp is not None, "the caller has looked"
    host, port = parse_address(config.tcp)
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(OPEN_S):
            _, wire = await loop.create_connection(lambda: TcpWire(ear), host, port)
    except TimeoutError:
        raise OSError(f"nobody accepts within {OPEN_S:g} s") from None
    return wire
