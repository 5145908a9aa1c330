"""A wire that is opened again when it is lost (unplugged, closed by the other end), with growing pauses."""

import asyncio
from collections import Counter
from collections.abc import Callable
from typing import Any

from links.core import LinkError, LinkLost
from links.mavlink.protocol import MavlinkLinkConfig
from links.mavlink.transport.wire import Wire, opener

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 8.0
"""Before opening a lost wire again [s]; each pause is twice the one before."""


class LastingWire:
    """The :class:`links.mavlink.transport.wire.Ear` of one wire after the other. Opened and cut by whoever owns it."""

    def __init__(
        self,
        config: MavlinkLinkConfig,
        dropped: Counter[str],
        *,
        hear: Callable[[bytes, Any], None],
        lose: Callable[[str], None],
        tell: Callable[[str], None],
    ) -> None:
        """Nothing is opened yet. Frames of ours that do not leave or come back are counted in ``dropped``.

        ``hear(data, source)`` takes what arrives; ``lose(why)`` is called when the wire has ended by itself, and
        ``tell`` with what is being done about it, for the operator.
        """
        self._config = config
        self._dropped = dropped
        self._hear, self._lose, self._tell = hear, lose, tell
        self.wire: Wire | None = None
        """The open one; None while there is none."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._returning: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Open it for the first time.

        Raises:
            LinkLost: it can't be opened.
            LinkError: it was cut before it was open.
        """
        self._loop = asyncio.get_running_loop()
        config = self._config
        try:
            wire = await opener(config)(config, self)
        except OSError as error:
            raise LinkLost(
                f"cannot open {config.address} for MAVLink ({error.strerror or error}): stop the program that "
                "holds this port, or give an address of this machine"
                if config.tcp is None and config.serial is None
                else f"cannot open {config.address} for MAVLink ({error.strerror or error}): check that it is there, "
                "that you may open it, and that no other program has it"
            ) from error
        if self._loop is None:
            wire.cut()
            raise LinkError("the link was closed before it was open")
        self.wire = wire

    def cut(self) -> None:
        """Release it, and open it no more."""
        wire, returning = self.wire, self._returning
        self.wire = self._returning = self._loop = None
        if returning is not None:
            returning.cancel()
        if wire is not None:
            wire.cut()

    def leave(self, frame: bytes, to: Any) -> bool:
        """Send ``frame`` to the address ``to``, and tell whether it left; nothing leaves on a lost wire."""
        if self.wire is None:
            return False
        why = self.wire.leave(frame, to)
        if why:
            self._dropped[why] += 1
        return not why

    def hear(self, data: bytes, source: Any) -> None:
        """Pass on what arrived from the address ``source`` (called by the wire)."""
        if self.wire is not None:
            self._hear(data, source)

    def undeliverable(self) -> None:
        """Count what the network gave back (called by the wire)."""
        self._dropped["undeliverable"] += 1

    def gone(self, why: str) -> None:
        """Begin to open it again (called by the wire)."""
        if self._loop is None:
            return
        self.wire = None
        self._lose(why)
        if self._returning is not None:
            self._returning.cancel()
        self._returning = self._loop.create_task(self._return(why))

    async def _return(self, why: str) -> None:
        """Open the wire again, as often as it takes."""
        pause_s = FIRST_PAUSE_S
        while self.wire is None:
            self._tell(f"the link is lost: {why}; trying again in {pause_s:g} s")
            await asyncio.sleep(pause_s)
            try:
                self.wire = await opener(self._config)(self._config, self)
            except OSError as error:
                why = f"cannot open {self._config.address} ({error.strerror or error})"
                pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
        self._tell("the wire is back: waiting for the autopilot's HEARTBEAT")
