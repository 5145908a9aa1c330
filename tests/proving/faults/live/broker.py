"""An MQTT broker that takes all and passes nothing on: enough to be there, and then to be gone.

MQTT 5.0: a CONNACK for each CONNECT, a PUBACK for each PUBLISH with QoS 1, a PINGRESP for each PINGREQ.
"""

import asyncio
import contextlib

CONNECT, PUBLISH, PINGREQ = 1, 3, 12
CONNACK = b"\x20\x03\x00\x00\x00"
PINGRESP = b"\xd0\x00"


class Broker:
    """Listens on a free port of this machine."""

    def __init__(self) -> None:
        """Not yet."""
        self.port = 0
        self.published = 0
        """How many messages have come."""
        self._server: asyncio.Server | None = None
        self._writers: list[asyncio.StreamWriter] = []

    async def open(self) -> None:
        """Begin to listen."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]

    def kill(self) -> None:
        """Be gone, with every connection."""
        if self._server is not None:
            self._server.close()
            self._server = None
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        with contextlib.suppress(OSError, asyncio.IncompleteReadError):
            while True:
                head = (await reader.readexactly(1))[0]
                body = await reader.readexactly(await _length(reader))
                match head >> 4:
                    case c if c == CONNECT:
                        writer.write(CONNACK)
                    case c if c == PUBLISH:
                        self.published += 1
                        if head >> 1 & 3:
                            at = 2 + int.from_bytes(body[:2], "big")
                            writer.write(b"\x40\x02" + body[at : at + 2])
                    case c if c == PINGREQ:
                        writer.write(PINGRESP)


async def _length(reader: asyncio.StreamReader) -> int:
    """The remaining length: seven bits a byte, the lowest first."""
    value = shift = 0
    while True:
        byte = (await reader.readexactly(1))[0]
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value
