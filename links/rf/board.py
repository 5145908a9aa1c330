"""A Betaflight board by its own port: armed or not by MSP, settings by its command line.

While the command line is open the board can't be armed. To leave it restarts the board, which ends
a USB port: it is opened again when it is back.
"""

import asyncio
from io import DEFAULT_BUFFER_SIZE
from typing import Any, Self

from links.core import LinkError, LinkLost, LinkRejected
from links.io import NETWORK, explain_error, parse_address
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
from links.rf.pacer import REOPEN_S
from links.text import link_notice

BAUD = 115200
"""Speed of the port [bit/s]; a USB port takes any."""
PATIENCE_S = 5.0
"""Timeout of a board's first answer, and of each by the command line [s]."""
RESTART_S = 20.0
"""Timeout of a board's answer after a restart [s]."""
ANSWER_S = 0.5
"""Timeout of an answer by MSP [s]."""


class Board:
    """One board.

    ``open`` it, ``enter`` its command line, ``tell`` it lines; ``leave`` restarts it.
    """

    def __init__(self, port: str) -> None:
        """Nothing is opened yet.

        ``port`` is a path, or host:port of a bridge to it, as the simulated firmware has.

        Raises:
            ValueError: it is neither.
        """
        self.port = port
        self._address = None if "/" in port else parse_address(port)
        self.version, self.uid = "", ""
        """Version of the firmware, and the board's unique id."""
        self.in_command_line = False
        self._reader: asyncio.StreamReader
        self._transport: Any = None

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def open(self, within_s: float = PATIENCE_S) -> None:
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
                    why = explain_error(error) if isinstance(error, OSError) else str(error)
                    raise LinkLost(
                        link_notice(
                            "board.port", port=self.port, why=why.removeprefix(f"{self.port}: ")
                        )
                    ) from None
                await asyncio.sleep(REOPEN_S)
        if (variant := (await self.ask(MspCommand.FC_VARIANT)).payload) != VARIANT:
            raise LinkRejected(
                link_notice(
                    "board.other_firmware", port=self.port, found=variant.decode("ascii", "replace")
                )
            )
        version = (await self.ask(MspCommand.FC_VERSION)).payload
        uid = (await self.ask(MspCommand.UID)).payload.hex()
        if self.uid and uid != self.uid:
            raise LinkRejected(link_notice("board.other", port=self.port))
        self.version, self.uid = ".".join(map(str, version[:3])), uid

    async def _connect(self) -> None:
        self._reader, self.in_command_line = asyncio.StreamReader(), False
        protocol = asyncio.StreamReaderProtocol(self._reader)
        if self._address is None:
            self._transport, _ = await NETWORK.get().open_serial(lambda: protocol, self.port, BAUD)
        else:
            async with asyncio.timeout(PATIENCE_S):
                self._transport, _ = await NETWORK.get().open_stream(
                    lambda: protocol, *self._address
                )
        await self.ask(MspCommand.FC_VARIANT)

    async def ask(self, command: int) -> MspAnswer:
        """Its answer by MSP.

        Raises:
            LinkLost: none comes.
            LinkRejected: it does not know the command.
        """
        reader = MspReader()
        until_s = await self._write(encode_request(command), ANSWER_S)
        while data := await self._read(until_s):
            for answer in reader.feed(data):
                if answer.command == command and not answer.known:
                    raise LinkRejected(
                        link_notice("board.unknown_command", port=self.port, command=command)
                    )
                if answer.command == command:
                    return answer
        raise LinkLost(link_notice("board.silent"))

    async def ensure_disarmed(self) -> None:
        """Ask it whether it is armed.

        Raises:
            LinkRejected: it is, or does not say.
            LinkLost: it does not answer.
        """
        try:
            armed = is_armed((await self.ask(MspCommand.STATUS)).payload)
        except ValueError as error:
            raise LinkRejected(link_notice("board.armed_unknown", why=error)) from None
        if armed:
            raise LinkRejected(link_notice("board.armed"))

    async def enter(self) -> None:
        """Open the command line, unless it is open; the board can't be armed from then on.

        Raises:
            LinkRejected: it is armed.
            LinkLost: it does not answer.
        """
        if not self.in_command_line:
            await self.ensure_disarmed()
            self.in_command_line = True
            await self._prompt_after("#", b"#")
        status = await self.tell("status")
        flags = next(
            (line for line in status.splitlines() if line.startswith("Arming disable flags:")), ""
        )
        if "CLI" not in flags.split():
            raise LinkRejected(link_notice("board.may_arm"))

    async def tell(self, line: str) -> str:
        """Its answer to ``line`` on the command line.

        Raises:
            LinkRejected: it refuses.
            LinkLost: it says nothing.
        """
        answer = await self._prompt_after(line, line.encode("ascii") + b"\n")
        if (why := find_refusal(answer)) is not None:
            raise LinkRejected(link_notice("board.refuses", line=line, why=why))
        return answer

    async def save(self) -> None:
        """Keep what was set, restart, and connect again; raises as :meth:`open`."""
        await self._restart("save")
        await self.open(RESTART_S)

    async def close(self) -> None:
        """Leave the command line, which restarts the board and forgets what was not saved.

        And close the port.
        """
        if self._transport is not None and self.in_command_line and not self._has_ended:
            await self._restart("exit")
        self._cut()

    async def _restart(self, word: str) -> None:
        said = b""
        try:
            until_s = await self._write(word.encode() + b"\n", PATIENCE_S)
            while b"Rebooting" not in said and (data := await self._read(until_s)):
                said += data
        except LinkError:
            pass  # it is gone already
        await asyncio.sleep(REOPEN_S)
        self._cut()

    async def _prompt_after(self, line: str, data: bytes) -> str:
        """Send ``data``, which means ``line``; returns the answer, up to the prompt behind it."""
        said = b""
        until_s = await self._write(data, PATIENCE_S)
        while data := await self._read(until_s):
            said += data
            text = said.decode("ascii", "replace").replace("\r", "")
            if text.endswith(PROMPT):
                return text
        raise LinkLost(link_notice("board.no_answer", line=line))

    async def _read(self, until_s: float) -> bytes:
        """Return what comes before ``until_s``, on the event loop's clock.

        Nothing at its end, or at the port's.
        """
        try:
            async with asyncio.timeout_at(until_s):
                return await self._reader.read(DEFAULT_BUFFER_SIZE)
        except (TimeoutError, OSError):
            return b""

    @property
    def _has_ended(self) -> bool:
        return self._reader.at_eof() or self._reader.exception() is not None

    async def _write(self, data: bytes, patience_s: float) -> float:
        """Send ``data``, and return until when an answer counts; what has come before is none."""
        now_s = asyncio.get_running_loop().time()
        while await self._read(now_s):
            pass
        try:
            if self._has_ended:
                raise OSError(link_notice("board.port_ended").text)
            (self._transport.send if self._address is None else self._transport.write)(data)
        except OSError as error:
            raise LinkLost(
                link_notice("board.port", port=self.port, why=error.strerror or error)
            ) from None
        return now_s + patience_s

    def _cut(self) -> None:
        if self._transport is not None:
            self._transport.abort()
            self._transport = None
