"""The feed of a recording: it can be stopped, wound on and back, and played from a quarter to sixteen times as fast."""

import asyncio
from bisect import bisect_right
from collections.abc import AsyncIterator, Sequence

from groundstation.core.messages import Ask, Snapshot
from groundstation.interfaces.tui.parts import KEPT, Answer, Hello, Jump, News

SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
TURN_S = 0.1
"""How often it looks whether something is to be shown [s]."""
WIND_S = 5.0
"""So far one key winds [s]."""
NOBODY = Answer(done=False, says="a recording can't be asked for anything")


class Playback:
    """Implements :class:`groundstation.interfaces.tui.parts.feed.Feed`."""

    live = False

    def __init__(self, hello: Hello, snapshots: Sequence[Snapshot]) -> None:
        """Whom it is about, and the snapshots in their order; it begins at the first one, playing."""
        self._hello, self._snapshots = hello, snapshots
        self._times = [snapshot.time_s for snapshot in snapshots]
        self._at_s = self._times[0] if snapshots else 0.0
        self._speed = SPEEDS.index(1.0)
        self._wound = asyncio.Event()
        self.paused = False

    async def news(self) -> AsyncIterator[News]:
        """The snapshots as their time comes; where it was wound, also those before, for the plots."""
        loop = asyncio.get_running_loop()
        yield self._hello
        shown, last_s = 0, loop.time()
        while True:
            now = loop.time()
            if not self.paused:
                self._at_s += SPEEDS[self._speed] * (now - last_s)
            last_s = now
            if self._times and self._at_s >= self._times[-1]:
                self._at_s, self.paused = self._times[-1], True
            until = bisect_right(self._times, self._at_s)
            if self._wound.is_set():
                self._wound.clear()
                yield Jump()
                shown = max(0, until - KEPT)
            for snapshot in self._snapshots[shown:until]:
                yield snapshot
            shown = max(shown, until)
            try:
                async with asyncio.timeout(TURN_S):
                    await self._wound.wait()
            except TimeoutError:
                pass

    def steer(self, what: str) -> None:
        """``pause`` (and on again), ``back``, ``on``, ``start``, ``slower`` or ``faster``."""
        match what:
            case "pause":
                if self.paused and self._times and self._at_s >= self._times[-1]:
                    self.seek(0.0)
                self.paused = not self.paused
            case "back" | "on":
                self.seek(self.passed_s + (WIND_S if what == "on" else -WIND_S))
            case "start":
                self.seek(0.0)
            case "slower" | "faster":
                self._speed = max(0, min(len(SPEEDS) - 1, self._speed + (1 if what == "faster" else -1)))

    def seek(self, passed_s: float) -> None:
        """Go on from ``passed_s`` after its beginning [s]."""
        if self._times:
            self._at_s = max(self._times[0], min(self._times[-1], self._times[0] + passed_s))
            self._wound.set()

    @property
    def passed_s(self) -> float:
        """Time since its beginning [s]."""
        return self._at_s - self._times[0] if self._times else 0.0

    def where(self) -> str:
        """For the operator: where it is, and how fast it goes."""
        whole = self._times[-1] - self._times[0] if self._times else 0.0
        pace = "stopped" if self.paused else f"× {SPEEDS[self._speed]:g}"
        return f"RECORDING {self.passed_s:.1f} of {whole:.1f} s, {pace}"

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Answer:
        """Nothing flies."""
        del ask, why, vehicle
        return NOBODY

    async def control(self, *, take: bool) -> Answer:
        """Nothing flies."""
        del take
        return NOBODY

    async def set_gain(self, key: str, value: float) -> Answer:
        """Nothing flies."""
        del key, value
        return NOBODY
