"""One connection to QTM by qtm-rt's QTMProtocol on our transport, with a guard before it.

qtm-rt trusts its server: a packet or component of size 0 makes it loop for ever, a large one fills
the memory, an unknown type raises inside the event loop. So packets are split and checked before
qtm-rt gets them. The module imports qtm-rt: it is imported only where Qualisys is used.
"""

import asyncio
import struct
from collections.abc import Callable
from typing import Any

from qtm_rt import QRTConnection
from qtm_rt.protocol import QRTCommandException, QTMProtocol

from groundstation.core.messages import SourceError, notice
from groundstation.pose.sources.qualisys_codec import Framer, RtPacket, read_type, split_components
from links.core import REOPEN_S
from links.io import NETWORK
from links.text import printable

VERSIONS = tuple(f"1.{minor}" for minor in range(25, 7, -1))
"""Versions, the newest first. 6D data are the same in all; qtm-rt speaks none before 1.8."""


class QtmConnection(asyncio.Protocol):
    """One TCP connection: packets that are whole and sane go to qtm-rt."""

    def __init__(self, timeout_s: float, drop: Callable[[str], object]) -> None:
        """``timeout_s`` is that of every answer [s]; ``drop`` counts unusable packets by reason."""
        self.lost = asyncio.Event()
        """Set at the end of the connection."""
        self._qtm = QTMProtocol(loop=asyncio.get_running_loop())
        self._requests = QRTConnection(self._qtm, timeout=timeout_s)
        self._timeout = timeout_s
        self._drop = drop
        self._framer = Framer()
        self._transport: asyncio.BaseTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by the event loop."""
        self._transport = transport
        self._qtm.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Take the next bytes (called by the event loop)."""
        for packet in self._framer.feed(data):
            kind = read_type(packet)
            if kind == RtPacket.NO_DATA:
                self._drop("no_data")
            elif kind == RtPacket.EVENT:
                continue  # none is needed, and qtm-rt raises on those that it does not know
            try:
                if kind == RtPacket.DATA:
                    split_components(packet[8:])  # qtm-rt loops or raises on what this refuses
                self._qtm.data_received(packet)
            except (struct.error, ValueError, TypeError):
                self._end("malformed")  # qtm-rt keeps it, and would fail again
                return
        if self._framer.broken:
            self._end("broken_stream")

    def _end(self, reason: str) -> None:
        if not self.lost.is_set():
            self._drop(reason)
            self.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by the event loop."""
        self._qtm.connection_lost(exc)
        self.lost.set()

    def close(self) -> None:
        """Disconnect."""
        if self._transport is not None:
            self._transport.close()
        self.lost.set()

    async def parameters(self) -> bytes:
        """The 6D parameters, as XML.

        Raises:
            SourceError: no answer, or a refusal.
        """
        request = self._requests.get_parameters(["6d"])
        return bytes(
            await self._request(request, "qualisys.silent_bodies", "qualisys.refused_bodies")
        )

    async def stream(self, take: Callable[[bytes], None]) -> None:
        """Have every frame's bodies streamed to ``take``.

        Raises:
            SourceError: no frame came, or a refusal.
        """
        request = self._requests.stream_frames(
            frames="allframes", components=["6d"], on_packet=lambda packet: take(packet.data)
        )
        await self._request(request, "qualisys.silent_stream", "qualisys.refused_stream")

    async def agree(self, version: str) -> bool:
        """Ask for ``version`` of the protocol; return whether QTM speaks it.

        Raises:
            SourceError: no answer.
        """
        try:
            async with asyncio.timeout(self._timeout):
                await self._qtm.set_version(version)
        except TimeoutError:
            raise SourceError(notice("qualisys.no_version", version=version)) from None
        except QRTCommandException:
            return False
        return True

    async def _request(self, request: Any, silent: str, refused: str) -> Any:
        """Return the answer to ``request``.

        ``silent`` and ``refused`` are the ids of the sentences without one.
        """
        try:
            return await request
        except TimeoutError:
            raise SourceError(notice(silent)) from None
        except QRTCommandException as error:
            why = (
                error.value.decode(errors="replace")
                if isinstance(error.value, bytes)
                else str(error)
            )
            raise SourceError(notice(refused, why=printable(why))) from None


async def connect(
    host: str, port: int, timeout_s: float, drop: Callable[[str], object]
) -> QtmConnection:
    """Connect to the QTM at ``host``:``port`` and agree on the newest version that it speaks.

    QTM may refuse one version a connection: each is tried on a new one. ``drop``: see the class.

    Raises:
        SourceError: it can't be reached, or speaks none of the versions.
    """
    for version in VERSIONS:
        connection = await _open(host, port, timeout_s, drop)
        try:
            if await connection.agree(version):
                return connection
        except BaseException:
            connection.close()
            raise
        connection.close()
    raise SourceError(
        notice("qualisys.too_old", server=f"{host}:{port}", newest=VERSIONS[0], oldest=VERSIONS[-1])
    )


async def _open(
    host: str, port: int, timeout_s: float, drop: Callable[[str], object]
) -> QtmConnection:
    """Open a connection; a refused one is tried again: QTM takes a while to start."""
    connection: QtmConnection
    try:
        async with asyncio.timeout(timeout_s):
            while True:
                try:
                    _, connection = await NETWORK.get().open_stream(
                        lambda: QtmConnection(timeout_s, drop), host, port
                    )
                    return connection
                except ConnectionRefusedError:
                    await asyncio.sleep(REOPEN_S)
    except OSError as error:
        why = error.strerror or str(error) or "no answer"
        raise SourceError(
            notice("qualisys.unreachable", server=f"{host}:{port}", why=why)
        ) from error
