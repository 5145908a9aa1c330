"""The feed of a running ground station: attaches by its socket, and again whenever it is lost."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

from groundstation.core.messages import Ask, Request
from groundstation.interfaces.api import Client, Control, attach, messages
from groundstation.interfaces.tui.parts import Answer, Hello, Holder, News, Trouble
from groundstation.runtime import ApiError

RETRY_S = 0.5
"""Time between two tries to attach [s]."""
NAME = "tui"


class Attached:
    """Implements :class:`groundstation.interfaces.tui.parts.feed.Feed`.

    What is asked while nobody is there is not asked later.
    """

    live = True

    def __init__(self, path: Path, pid: int | None = None, gone: Callable[[], str] = str) -> None:
        """For the socket at ``path``; it may come and go.

        ``pid``: only this process is meant; ``gone`` says more about it where it does not serve, or nothing.
        """
        self._path = path
        self._pid, self._gone = pid, gone
        self._client: Client | None = None

    async def news(self) -> AsyncIterator[News]:
        """For ever, what is served, and why nothing is."""
        while True:
            trouble = "The ground station closed its status socket."
            try:
                self._client = await attach(self._path, NAME)
                hello = self._client.hello
                if self._pid not in (None, hello.pid):
                    raise ApiError(f"{self._path}: another ground station (process {hello.pid}) serves there")
                origin = f"process {hello.pid}, groundstation {hello.groundstation}"
                yield Hello(hello.vehicle, origin, hello.config)
                async for message in self._client:
                    yield _holder(message) if isinstance(message, Control) else message
            except FileNotFoundError:
                trouble = f"No ground station serves {self._path}."
            except OSError as error:
                trouble = f"{error.strerror or error}: {self._path}"
            except ApiError as error:
                trouble = str(error)
            finally:
                self._close()
            yield Trouble(self._gone() or trouble)
            await asyncio.sleep(RETRY_S)

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Answer:
        """Ask for ``ask`` now or never."""
        return await self._asked(lambda client: client.ask(Request(ask, why), vehicle))

    async def control(self, *, take: bool) -> Answer:
        """Take control, or give it back."""
        return await self._asked(lambda client: client.take_control() if take else client.give_control())

    async def set_gain(self, key: str, value: float) -> Answer:
        """Change a gain in flight."""
        return await self._asked(lambda client: client.set_gains({key: value}))

    async def _asked(self, order: Callable[[Client], Awaitable[messages.Answer]]) -> Answer:
        if self._client is None:
            return Answer(done=False, says="NOT SENT: no ground station is there")
        try:
            answer = await order(self._client)
        except ApiError as error:
            return Answer(done=False, says=f"NO ANSWER, it may not have been heard: {error}")
        return Answer(answer.done, answer.says)

    def _close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()


def _holder(control: Control) -> Holder:
    return Holder(control.holder or "", control.yours)
