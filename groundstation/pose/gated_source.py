"""Gated source: a source behind the gate, as the flight gets it."""

import asyncio
from collections import Counter
from collections.abc import Callable

import msgspec

from groundstation.core.messages import Pose, PoseEvent, PoseSource, PoseStatus
from groundstation.pose.gate import Gate, GateConfig, Outbreaks

LOOK_S = 0.0493717
"""How often counters are looked at: drops are told of, and lost poses found, no later than that [s].

No round number: on the very instants of cameras and frames a timer more would move a simulation in its last bits."""


class GatedSource:
    """Implements :class:`groundstation.core.messages.pose.PoseSource`: the poses of another one that can be true."""

    def __init__(
        self, source: PoseSource, config: GateConfig, *, lost_s: float, tell: Callable[[PoseEvent], None]
    ) -> None:
        """``tell`` hears what happens to the poses; they are lost after ``lost_s`` [s] without one.

        One that is older than that as it comes is counted and does not pass: no command could ever have rested on it.
        """
        self._source = source
        self._lost_s = lost_s
        self._gate = Gate(config)
        self._outbreaks = Outbreaks(lost_s)
        self._tell = tell
        self._next_look: asyncio.TimerHandle | None = None

    @property
    def status(self) -> PoseStatus:
        """The source's, and what the gate has dropped."""
        status, dropped = self._source.status, self._gate.dropped
        if not dropped:
            return status
        return msgspec.structs.replace(
            status,
            accepted=status.accepted - dropped.total(),
            dropped=dict(Counter(status.dropped) + dropped),
        )

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Start the source; ``deliver`` gets each pose that passes.

        Raises:
            SourceError: it can't be started.
        """

        def take(pose: Pose) -> None:
            if pose.arrival_s - pose.time_s > self._lost_s:
                self._gate.dropped["late"] += 1
                return
            passed, event = self._gate.take(pose)
            if event is not None:
                self._tell(event)
            if passed is not None:
                deliver(passed)

        await self._source.start(take)
        self._look()

    async def close(self) -> None:
        """Close the source."""
        if self._next_look is not None:
            self._next_look.cancel()
            self._next_look = None
        await self._source.close()

    def _look(self) -> None:
        loop = asyncio.get_running_loop()
        status = self.status
        for event in self._outbreaks.look(loop.time(), status.dropped, self._gate.newest, status.late_s):
            self._tell(event)
        self._next_look = loop.call_later(LOOK_S, self._look)
