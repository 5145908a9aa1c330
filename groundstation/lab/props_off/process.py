"""The hand's process, as its guide has it."""

import asyncio
import os
import signal
from contextlib import suppress

import msgspec

from groundstation.config import dump
from groundstation.lab.props_off.hand import News
from groundstation.lab.props_off.steps import Trouble
from groundstation.settings import Config
from links.core import make_child_command

OFF_S = 12.0
"""Longest wait for a hand to let go [s]: an order that nobody acknowledges is repeated for 5 s."""


class HandProcess:
    """Implements :class:`groundstation.lab.props_off.steps.Hand`."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        """Take a process that :func:`open_hand` started."""
        assert process.stdin is not None and process.stdout is not None, "both are pipes"
        self._process = process
        self._in, self._out = process.stdin, process.stdout
        self.heard: list[News] = []

    async def until(self, event: str, within_s: float) -> News:
        """The news of ``event``; see there."""
        async with asyncio.timeout(within_s):
            while True:
                news = await self._next()
                if news is None:
                    raise Trouble("the program that holds the vehicle has ended by itself")
                if news.event == event:
                    return news
                if news.event == "failed":
                    raise Trouble(news.text)

    async def listen(self, for_s: float) -> None:
        """Hear for a while what is told."""
        with suppress(TimeoutError):
            async with asyncio.timeout(for_s):
                while await self._next() is not None:
                    pass

    async def _next(self) -> News | None:
        line = await self._out.readline()
        if not line:
            return None
        news = msgspec.json.decode(line, type=News)
        self.heard.append(news)
        return news

    async def off(self) -> News | None:
        """Let go; see there."""
        self._in.close()
        try:
            await self.listen(OFF_S)
            if self._process.returncode is None:
                async with asyncio.timeout(1.0):
                    await self._process.wait()
        except TimeoutError:
            await self.kill()
        return next((news for news in self.heard if news.event == "off"), None)

    async def kill(self) -> None:
        """End it at once, as the kernel does."""
        with suppress(ProcessLookupError):
            os.kill(self._process.pid, signal.SIGKILL)
        await self._process.wait()


async def open_hand(config: Config, *words: str) -> HandProcess:
    """Start a hand; with the word ``disarm`` one that disarms only."""
    process = await asyncio.create_subprocess_exec(
        *make_child_command("groundstation.lab.props_off", *words),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        start_new_session=True,  # what the terminal sends reaches the guide alone
    )
    hand = HandProcess(process)
    assert process.stdin is not None, "it is a pipe"
    process.stdin.write(msgspec.json.encode(dump(config)) + b"\n")
    await process.stdin.drain()
    return hand
