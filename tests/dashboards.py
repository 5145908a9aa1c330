"""Dashboards for tests: on a served flight that is made up, or on a fixed list of news."""

import asyncio
import contextlib
import inspect
import math
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import msgspec
from textual.pilot import Pilot
from textual.widget import Widget

from groundstation.config import dump
from groundstation.core.messages import Ask, Check, Reply, Sentence, Snapshot, Verdict
from groundstation.interfaces.api import Server, snapshots
from groundstation.interfaces.tui.app import Attached, Dashboard
from groundstation.interfaces.tui.drawing import big, huge
from groundstation.interfaces.tui.model import Feed, FlightIdentity, News
from groundstation.interfaces.tui.widgets import Banner
from groundstation.machine import Latest, StatusConfig
from groundstation.settings import Config
from tests.sample_flight import Sampled, sample

Scene = Callable[[Pilot[None]], Coroutine[Any, Any, None]]


class Fixed:
    """A feed of what is known beforehand; it is asked for nothing."""

    def __init__(self, news: Sequence[News], *, live: bool = True) -> None:
        self.all = news
        self.live = live

    async def news(self) -> AsyncIterator[News]:
        for one in self.all:
            yield one
        await asyncio.Event().wait()

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Reply:
        raise AssertionError(f"asked for {ask} {why} {vehicle}")

    async def control(self, *, take: bool) -> Reply:
        raise AssertionError(f"asked for control: {take}")

    async def set_gain(self, key: str, value: float) -> Reply:
        raise AssertionError(f"asked for {key} = {value}")


HELLO = FlightIdentity("mqx", "process 7, groundstation 0.1.0", dump(Config()))
CHECKS = (
    Check("pose rate", Verdict.PASS, "50 poses a second"),
    Check("battery", Verdict.WARN, "it is at 7.41 V, 35 %"),
    Check(
        "floor",
        Verdict.FAIL,
        "position +1.00 m (down) at rest, flight.floor_z_m is +0.00 m: correct it",
    ),
    Check("fence", Verdict.OFF, "there is none"),
)


def flown(until_s: float, **more: Any) -> list[News]:
    """The made-up flight until then, five snapshots a second; the last is changed by ``more``."""
    shown: list[News] = [sample(0.2 * i) for i in range(round(5.0 * until_s))]
    return [HELLO, *shown, msgspec.structs.replace(sample(until_s), **more)]


def on_ground(**more: Any) -> list[News]:
    """It stands, ready."""
    return [HELLO, standing(**more)]


def standing(**more: Any) -> Snapshot:
    """It stands, ready to be armed."""
    still = msgspec.structs.replace(
        sample(0.0),
        state="ready",
        reason="link and poses are available",
        diagnostics=None,
        certificate=None,
        thrust_n=0.0,
        rates_rad_s=(0.0, 0.0, 0.0),
        error_m=0.0,
        rms_m=math.nan,
        checks=CHECKS,
        position_ned=(0.5, -0.25, 0.0),
        reference_ned=(0.5, -0.25, 0.0),
    )
    return msgspec.structs.replace(still, **more)


class Stage:
    """A served flight that is made up, and whoever is asked in its place."""

    def __init__(self, path: Path, *, beats: bool = False) -> None:
        """``beats``: its newest snapshot is served again and again, as if it were new."""
        self.path = path
        self.beats = beats
        self.latest: Latest[Snapshot] = Latest()
        self.core = Sampled()
        self.log: list[str] = []
        self.config_text = dump(Config())

    @property
    def asked(self) -> list[Ask]:
        """What was asked for, in order."""
        return [request.ask for request in self.core.asked]

    def server(self, rate_hz: float = 50.0) -> Server:
        """Server of the station's socket."""
        config = StatusConfig(path=str(self.path), rate_hz=rate_hz)

        def log(told: Sentence) -> None:
            self.log.append(told.text)

        return Server(config, "mqx", self.latest, self.core, config_text=self.config_text, log=log)

    @contextlib.asynccontextmanager
    async def up(self, rate_hz: float = 50.0) -> AsyncIterator[None]:
        """It is served."""
        server = self.server(rate_hz)
        await server.open()
        tasks = [asyncio.create_task(server.publish()), asyncio.create_task(self._beat())]
        try:
            yield
        finally:
            await asyncio.sleep(0.02)  # a visitor is let in whole before the door is closed
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            server.close()
            await asyncio.sleep(0.02)  # both ends of every connection are closed by then

    async def first(self) -> Snapshot:
        """The first snapshot that a client gets."""
        return await anext(aiter(snapshots(self.path)))

    async def _beat(self) -> None:
        while True:
            await asyncio.sleep(0.2)
            if self.beats and self.latest.newest is not None:
                self.latest.put(self.latest.newest[1])


def play(scene: Scene, feed: Feed | Path, size: tuple[int, int] = (80, 24), **options: Any) -> None:
    """Have ``scene`` played on a dashboard of ``feed``, or of the socket at a path."""

    async def with_screen() -> None:
        dashboard = Dashboard(Attached(feed) if isinstance(feed, Path) else feed, **options)
        async with dashboard.run_test(size=size, notifications=True) as pilot:
            await until(pilot, lambda: bool(dashboard.screen.query(Banner)))
            if isinstance(feed, Fixed):
                await keep_fresh(pilot, dashboard, feed)
            await scene(pilot)

    asyncio.run(with_screen())


Played = Callable[..., Coroutine[Any, Any, None]]


def dashboard(**options: Any) -> Callable[[Played], Callable[..., None]]:
    """Give a test a dashboard of ``stage`` with ``options`` of ``play``."""

    def decorate(test: Played) -> Callable[..., None]:
        @wraps(test)
        def run(stage: Stage, **others: Any) -> None:
            play(lambda pilot: test(pilot, stage, **others), stage.path, **options)

        signature = inspect.signature(test)
        wanted = [one for name, one in signature.parameters.items() if name != "pilot"]
        run.__signature__ = signature.replace(parameters=wanted)  # type: ignore[attr-defined]  # pytest reads it
        return run

    return decorate


def text(pilot: Pilot[None], part: type[Widget]) -> str:
    """What a part of the page shows."""
    return str(pilot.app.screen_stack[0].query_one(part).render())


def says(pilot: Pilot[None], words: str) -> bool:
    """Whether the banner says ``words`` in large letters."""
    shown = text(pilot, Banner)
    return any(all(row.rstrip() in shown for row in letters(words)) for letters in (big, huge))


def told(pilot: Pilot[None], words: str) -> bool:
    """Whether the operator was told ``words``."""
    return any(words in note.message for note in pilot.app._notifications)


async def keep_fresh(pilot: Pilot[None], dashboard: Dashboard, feed: Fixed) -> None:
    """Wait until all of ``feed`` is there; it never gets old, however long a page takes to draw."""
    await until(pilot, lambda: dashboard.picture.count == len(feed.all))
    dashboard.picture.arrived_s = math.inf


async def until(pilot: Pilot[None], true: Callable[[], bool]) -> None:
    """Wait for it."""
    async with asyncio.timeout(60.0):
        while not true():
            await pilot.pause(0.02)
