"""What a flight owes its vehicle at the end, and that nothing leaves after it."""

import asyncio
from collections.abc import Callable
from contextlib import suppress

from groundstation.core.messages import Distrusts, PoseSource
from links.core import CommandLink, LinkError

FEED_LOOK_S = 0.1
"""How often it is looked whether poses still serve the autopilot after the flight [s]."""


class Ending:
    """One flight's: the bring-down, or a kill; poses to an autopilot that may rest on them; closed wires."""

    closed = False
    """True once nothing leaves any more."""

    def __init__(self, link: CommandLink, source: PoseSource, say: Callable[[str], None], *, forwards: bool) -> None:
        """``forwards``: the autopilot gets the poses of ``source``."""
        self._link = link
        self._source = source
        self._say = say
        self._forwards = forwards
        self._feeding: asyncio.Event | None = None
        self._kill: asyncio.Task[None] | None = None

    @property
    def killed(self) -> bool:
        """Whether the motors were told to stop at once."""
        return self._kill is not None

    def kill(self) -> None:
        """Have the motors stop at once."""
        self._kill = asyncio.ensure_future(self._link.kill())

    @property
    def feeds(self) -> bool:
        """Whether commands have ended, and poses go on to the autopilot."""
        return self._feeding is not None

    def starve(self) -> None:
        """End those poses, too."""
        if self._feeding is not None:
            self._feeding.set()

    def distrust(self) -> None:
        """Our poses are wrong: nobody gets them any more, and no LAND is asked for that may rest on them."""
        self._forwards = False
        self.starve()
        for part in (self._source, self._link):
            if isinstance(part, Distrusts):
                part.distrust()

    async def close(self) -> None:
        """Close the link, which may have to bring down first, and the source, and tell what is done."""
        link = self._link
        if self._kill is None and link.status.phase in ("fresh", "bring_down"):
            self._say("bringing down: the link levels, sinks and stops by itself")
            await link.silent()
            if not self.killed and not link.status.unmet:
                taken = link.status.taken
                whose = f"the autopilot is in {taken}, and not by us" if taken else "the bring-down is over"
                self._say(f"{whose}: nothing leaves any more")
        if not self.killed and link.status.unmet:
            self._say(f"NOT brought down from here: {link.status.unmet}")
        await self._feed()
        if self._kill is not None:
            try:
                await self._kill
                self._say("the vehicle has acknowledged: motors off")
            except LinkError as error:
                self._say(f"NOT acknowledged: {error}")
        self.closed = True
        await link.close()
        await self._source.close()

    async def _feed(self) -> None:
        """The autopilot may fly by the poses that it gets from us: they do not end with our commands."""
        if not (self._forwards and self._turns()):
            return
        asked = self._feeding = asyncio.Event()
        self._say("poses go on to the autopilot until its motors stop; a second Ctrl-C ends them too")
        while self._turns() and not asked.is_set():
            with suppress(TimeoutError):
                await asyncio.wait_for(asked.wait(), FEED_LOOK_S)
        why = "as asked" if asked.is_set() else "its motors have stopped, or it is heard no more"
        self._say(f"no more poses to the autopilot: {why}")
        self._feeding = None

    def _turns(self) -> bool:
        return self._kill is None and self._link.status.state == "armed"
