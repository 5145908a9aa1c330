"""MAVLink over a serial port: USB, a telemetry radio, or an autopilot's TELEM port."""

import asyncio
from typing import Any

from links.io import create_serial_connection
from links.mavlink.protocol import MavlinkLinkConfig
from links.mavlink.transport.wire import Ear

QUEUE_S = 0.02
"""A frame is dropped where what waits before it takes the port longer than this [s]."""
STALL_S = 0.25
"""What has waited for this long is thrown away [s]: a flow control that blocks must not keep a stale command."""


class SerialWire:
    """Implements :class:`links.mavlink.transport.wire.Wire`, and :class:`links.io.serial_port.PortProtocol`."""

    datagrams = False
    speaks_first = True

    def __init__(self, baud: int, ear: Ear) -> None:
        """Opened by :func:`open_serial`."""
        self._port: Any = None
        self._ear: Ear | None = ear
        self._room = max(64.0, QUEUE_S * baud / 10.0)  # a byte takes 10 bits
        self._loop = asyncio.get_running_loop()
        self._full_since_s: float | None = None

    def leave(self, frame: bytes, to: Any) -> str:
        """Send one frame."""
        if self._ear is None:
            return "full"
        if self._port.waiting() <= self._room and self._written(frame):
            self._full_since_s = None
            return ""
        now = self._loop.time()
        if self._full_since_s is None:
            self._full_since_s = now
        elif now - self._full_since_s > STALL_S:
            self._end("the port takes nothing any more: check flow control and wiring")
        return "full"

    def _written(self, frame: bytes) -> bool:
        try:
            self._port.send(frame)
        except BlockingIOError:
            return False
        except OSError as error:
            self._end(f"the port is gone ({error.strerror})")
            return False
        return True

    def cut(self) -> None:
        """Close the port."""
        self._ear = None
        self._port.abort()

    def connection_made(self, transport: Any) -> None:
        """Keep it (called by the port)."""
        self._port = transport

    def data_received(self, data: bytes) -> None:
        """Pass it on (called by the port)."""
        if self._ear is not None:
            self._ear.hear(data, None)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass it on (called by the port)."""
        self._end(f"the port is gone ({getattr(exc, 'strerror', None) or 'unplugged'})")

    def _end(self, why: str) -> None:
        ear = self._ear
        self.cut()
        if ear is not None:
            ear.gone(why)


async def open_serial(config: MavlinkLinkConfig, ear: Ear) -> SerialWire:
    """Open ``serial``; raises OSError."""
    assert config.serial is not None, "the caller has looked"
    _, wire = await create_serial_connection(lambda: SerialWire(config.baud, ear), config.serial, config.baud)
    return wire
