"""MAVLink over a serial port: USB, a telemetry radio, or an autopilot's TELEM port."""

import asyncio
import os
from typing import Any

from links.mavlink_config import MavlinkLinkConfig
from links.mavlink_wire import Ear
from links.serial_port import close_port, open_port, waiting

QUEUE_S = 0.02
"""A frame is dropped where what waits before it takes the port longer than this [s]."""
STALL_S = 0.25
"""What has waited for this long is thrown away [s]: a flow control that blocks must not keep a stale command."""


class SerialWire:
    """Implements :class:`links.mavlink_wire.Wire`."""

    datagrams = False
    speaks_first = True

    def __init__(self, fd: int, baud: int, ear: Ear) -> None:
        """Take over the open port ``fd``."""
        self._fd = fd
        self._ear: Ear | None = ear
        self._room = max(64.0, QUEUE_S * baud / 10.0)  # a byte takes 10 bits
        self._loop = asyncio.get_running_loop()
        self._full_since_s: float | None = None
        self._loop.add_reader(fd, self._read)

    def leave(self, frame: bytes, to: Any) -> str:
        """Send one frame."""
        if self._ear is None:
            return "full"
        if waiting(self._fd) <= self._room and self._written(frame):
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
            return os.write(self._fd, frame) == len(frame)
        except BlockingIOError:
            return False
        except OSError as error:
            self._end(f"the port is gone ({error.strerror})")
            return False

    def cut(self) -> None:
        """Close the port."""
        if self._ear is not None:
            self._ear = None
            self._loop.remove_reader(self._fd)
            close_port(self._fd)

    def _read(self) -> None:
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(f"the port is gone ({error.strerror})")
            return
        if not data:
            self._end("the port is gone (unplugged)")
        elif self._ear is not None:
            self._ear.hear(data, None)

    def _end(self, why: str) -> None:
        ear = self._ear
        self.cut()
        if ear is not None:
            ear.gone(why)


async def open_serial(config: MavlinkLinkConfig, ear: Ear) -> SerialWire:
    """Open ``serial``; raises OSError."""
    assert config.serial is not None, "the caller has looked"
    return SerialWire(open_port(config.serial, config.baud), config.baud, ear)
