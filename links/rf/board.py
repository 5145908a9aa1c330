"""A Betaflight board by its own port: asked by MSP whether it is armed, and read and changed by its command line.

While the command line is open the board can't be armed. To leave it restarts the board, which ends a USB port: it is
opened again when it is back.
"""

import asyncio
from typing import Any, Self

from links.core import LinkError, LinkLost, LinkRejected
from links.io import NETWORK, parse_address
from links.rf.betaflight_codec import (
    PROMPT,
    VARIANT,
    MspAnswer,
    MspCommand,
    MspReader,
    encode_request,
    find_refusal,
    is_armed,
)

BAUD = 115200
"""Speed of the port [bit/s]; a USB port takes any."""
OPEN_S = 3.0
"""Timeout of a board's first answer [s]."""
RESTART_S = 20.0
"""Timeout of a board's answer after a restart [s]."""
ANSWER_S = 0.5
"""Timeout of an answer by MSP [s]."""
LINE_S = 5.0
"""Timeout of an answer by the command line [s]."""
TRIES = 3
"""Attempts at each question."""
APART_S = 0.2
"""Between the two questions whether it is armed [s]."""
AGAIN_S = 0.25
"""Wait before a port that is not there is tried again [s]."""


class _Ear(asyncio.Protocol):
    """Receiver of the port's bytes; implements :class:`links.io.wires.PortProtocol` too."""

    def __init__(self) -> None:
        self.heard = bytearray()
        self.news = asyncio.Event()
        self.ended = False

    def data_received(self, data: bytes) -> None:
        self.heard += data
        self.news.set()

    def connection_lost(self, exc: Exception | None) -> None:
        self.ended = True
        self.news.set()


class Board:
    """One board. ``open`` it, ``enter`` its command line, ``tell`` it lines; ``leave`` restarts it."""

    def __init__(self, port: str) -> None:
        """Nothing is opened yet; ``port`` is a path, or host:port of a bridge to it, as the simulated firmware has.

        Raises:
            ValueError: it is neither.
        """
        self.port = port
        self._address = None if "/" in port else parse_address(port)
        self.version, self.uid = "", ""
        """Version of the firmware, and the board's unique id."""
        self.in_command_line = False
        self._ear = _Ear()
        self._transport: Any = None

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def open(self, within_s: float = OPEN_S) -> None:
        """Connect, and hear what it is; for a port that comes back, ``within_s`` [s].

        Raises:
            LinkLost: there is no such port, or nothing on it answers.
            LinkRejected: it is no Betaflight, or another board than before.
        """
        loop = asyncio.get_running_loop()
        until = loop.time() + within_s
        while True:
            try:
                await self._connect()
                break
            except (LinkLost, OSError) as error:
                self._cut()
                if loop.time() > until:
                    why = error.strerror or str(error) if isinstance(error, OSError) else str(error)
                    raise LinkLost(f"{self.port}: {why.removeprefix(f'{self.port}: ')}") from None
                await asyncio.sleep(AGAIN_S)
        if (variant := (await self.ask(MspCommand.FC_VARIANT)).payload) != VARIANT:
            raise LinkRejected(f"{self.port}: expected Betaflight, this is {variant.decode('ascii', 'replace')!r}")
        version = (await self.ask(MspCommand.FC_VERSION)).payload
        uid = (await self.ask(MspCommand.UID)).payload.hex()
        if self.uid and uid != self.uid:
            raise LinkRejected(f"{self.port}: another board than before answers there; nothing more was changed")
        self.version, self.uid = ".".join(map(str, version[:3])), uid

    async def _connect(self) -> None:
        self._ear, self.in_command_line = _Ear(), False
        if self._address is None:
            self._transport, _ = await NETWORK.get().open_serial(lambda: self._ear, self.port, BAUD)
        else:
            async with asyncio.timeout(OPEN_S):
                self._transport, _ = await NETWORK.get().open_stream(lambda: self._ear, *self._address)
        await self.ask(MspCommand.FC_VARIANT)

    async def ask(self, command: int) -> MspAnswer:
        """Its answer by MSP.

        Raises:
            LinkLost: none comes.
            LinkRejected: it does not know the command.
        """
        for _ in range(TRIES):
            reader = MspReader()
            self._ear.heard.clear()
            self._write(encode_request(command))
            async for data in self._hear(ANSWER_S):
                for answer in reader.feed(data):
                    if answer.command == command and not answer.known:
                        raise LinkRejected(f"{self.port}: the board does not know MSP command {command}")
                    if answer.command == command:
                        return answer
        raise LinkLost(
            "nothing there answers MSP: is it the flight controller's own port, and nobody else's? One whose command "
            "line was left open answers once it was switched off and on"
        )

    async def ensure_disarmed(self) -> None:
        """Ask it twice whether it is armed.

        Raises:
            LinkRejected: it is, or does not say.
            LinkLost: it does not answer.
        """
        for wait_s in (0.0, APART_S):
            await asyncio.sleep(wait_s)
            try:
                armed = is_armed((await self.ask(MspCommand.STATUS)).payload)
            except ValueError as error:
                raise LinkRejected(f"nobody knows whether it is armed: {error}") from None
            if armed:
                raise LinkRejected("the vehicle is armed: settings are looked at and changed only while it is not")

    async def enter(self) -> None:
        """Open the command line, unless it is open; the board can't be armed from then on.

        Raises:
            LinkRejected: it is armed.
            LinkLost: it does not answer.
        """
        if not self.in_command_line:
            await self.ensure_disarmed()
            self._ear.heard.clear()
            self.in_command_line = True
            self._write(b"#")
            await self._wait_for_prompt("#")
        status = await self.tell("status")
        flags = next((line for line in status.splitlines() if line.startswith("Arming disable flags:")), "")
        if "CLI" not in flags.split():
            raise LinkRejected("the board does not say that its command line keeps it from arming: nothing is changed")

    async def tell(self, line: str) -> str:
        """Its answer to ``line`` on the command line.

        Raises:
            LinkRejected: it refuses.
            LinkLost: it says nothing.
        """
        self._ear.heard.clear()
        self._write(line.encode("ascii") + b"\n")
        answer = await self._wait_for_prompt(line)
        if (why := find_refusal(answer)) is not None:
            raise LinkRejected(f"the board refuses `{line}`: {why}")
        return answer

    async def save(self) -> None:
        """Keep what was set, restart, and connect again; raises as :meth:`open`."""
        await self._restart("save")
        await self.open(RESTART_S)

    async def close(self) -> None:
        """Leave the command line, which restarts the board and forgets what was not saved; and close the port."""
        if self._transport is not None and self.in_command_line and not self._ear.ended:
            await self._restart("exit")
        self._cut()

    async def _restart(self, word: str) -> None:
        self._ear.heard.clear()
        try:
            self._write(word.encode() + b"\n")
            async for _ in self._hear(LINE_S):
                if b"Rebooting" in self._ear.heard:
                    await asyncio.sleep(AGAIN_S)
                    break
        except LinkError:
            pass  # it is gone already
        self._cut()

    async def _wait_for_prompt(self, line: str) -> str:
        async for _ in self._hear(LINE_S):
            said = self._ear.heard.decode("ascii", "replace").replace("\r", "")
            if said.endswith(PROMPT):
                return said
        raise LinkLost(f"the board's command line says nothing to `{line}`")

    async def _hear(self, within_s: float) -> Any:
        """Yield the bytes received so far, at each arrival, for ``within_s`` [s]; the port's end ends it."""
        seen, loop = 0, asyncio.get_running_loop()
        until = loop.time() + within_s
        while True:
            ear = self._ear
            if len(ear.heard) > seen:
                piece, seen = bytes(ear.heard[seen:]), len(ear.heard)
                yield piece
                continue
            if ear.ended:
                return
            ear.news.clear()
            try:
                async with asyncio.timeout_at(until):
                    await ear.news.wait()
            except TimeoutError:
                return

    def _write(self, data: bytes) -> None:
        try:
            if self._ear.ended:
                raise OSError("the port has ended")
            (self._transport.send if self._address is None else self._transport.write)(data)
        except OSError as error:
            raise LinkLost(f"{self.port}: {error.strerror or error}") from None

    def _cut(self) -> None:
        if self._transport is not None:
            self._transport.abort()
            self._transport = None
