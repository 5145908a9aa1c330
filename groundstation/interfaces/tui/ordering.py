"""From what the operator presses to what is asked of the feed: confirmed where it must be, and answered in words."""

import asyncio
from collections.abc import Awaitable, Callable

from textual.app import App
from textual.notifications import SeverityLevel

from groundstation.core.messages.requests import Ask
from groundstation.interfaces.api.stop_all import stop_all
from groundstation.interfaces.tui.parts.dialogs import Choice, Typed
from groundstation.interfaces.tui.parts.feed import Answer, Feed
from groundstation.interfaces.tui.parts.gains import Gain
from groundstation.interfaces.tui.parts.headline import SILENCE_S
from groundstation.interfaces.tui.parts.orders import Order, Twice, possible
from groundstation.interfaces.tui.parts.picture import Picture
from links.core.printable import printable


class Ordering:
    """One screen's orders."""

    def __init__(
        self, app: App[None], feed: Feed, picture: Picture, draw: Callable[[], None], *, read_only: bool
    ) -> None:
        """Ask back in dialogs of ``app``, which ``draw`` draws; orders rest on what ``picture`` shows."""
        self._app = app
        self._feed = feed
        self._picture = picture
        self._draw = draw
        self._read_only = read_only
        self._orders = feed.live and not read_only
        self._twice = Twice()

    def waits(self, now_s: float) -> bool:
        """Whether one more press now would kill."""
        return self._twice.waits(now_s)

    def order(self, order: Order) -> None:
        """Order it. What brings the vehicle down does not ask back."""
        now = asyncio.get_running_loop().time()
        if not self._orders:
            self._only_looks()
        elif not order.always and now - self._picture.arrived_s > SILENCE_S:
            self._say(Answer(done=False, says="what is shown is old: nothing is ordered by it"))
        elif order.ask is Ask.KILL and not self._twice.press(now):
            self._draw()
        elif order.always or order.ask in (Ask.HOLD, Ask.RETURN):
            self._ask(order.ask)
        else:
            self._app.run_worker(self._confirmed(order))

    async def _confirmed(self, order: Order) -> None:
        """Arm and fly, once the operator has confirmed."""
        newest = self._picture.newest
        if newest is None:
            self._say(Answer(done=False, says="there is no vehicle to see"))
        elif not self._picture.holder.yours:
            self._say(Answer(done=False, says="take control first: key c"))
        elif not possible(order, newest.state):
            self._say(Answer(done=False, says=f"{order.ask} is not possible while {newest.state}"))
        elif order.ask is Ask.ARM:
            says = f"The motors of {newest.vehicle} will start. Type its name:"
            typed = await self._app.push_screen_wait(Typed(f"ARM {newest.vehicle}?", says, wanted=newest.vehicle))
            if typed is not None:
                self._ask(order.ask, typed)
        else:
            says = f"{newest.vehicle} leaves the hold for its trajectory."
            options = [("no", "No, stay"), ("yes", "Yes, fly")]
            if await self._app.push_screen_wait(Choice("FLY the trajectory?", says, options)) == "yes":
                self._ask(order.ask)

    def _ask(self, ask: Ask, vehicle: str = "") -> None:
        self._later(lambda: self._feed.ask(ask, "", vehicle))

    def land_all(self) -> None:
        """Land this vehicle, and every other one that this user flies from this machine. It does not ask back."""
        if not self._orders:
            self._only_looks()
            return
        self._ask(Ask.LAND)
        self._later(self._stop_all)

    async def _stop_all(self) -> Answer:
        told = await stop_all(Ask.LAND, "stop-all from a dashboard")
        silent = [one.says for one in told if not one.answered]
        return Answer(done=not silent, says="; ".join(silent) or f"land all: {len(told)} have answered")

    def control(self) -> None:
        """Take control, or give it back."""
        if self._orders:
            self._later(lambda: self._feed.control(take=not self._picture.holder.yours))
        else:
            self._only_looks()

    async def take(self) -> None:
        """Take control."""
        self._say(await self._feed.control(take=True))

    async def edit(self, gain: Gain) -> None:
        """Ask for a new value of a gain, and pass it on."""
        if not self._orders:
            self._only_looks()
            return
        if not self._picture.holder.yours:
            self._say(Answer(done=False, says="gains need control: key c"))
            return
        typed = await self._app.push_screen_wait(Typed(gain.key, gain.text(), value=f"{gain.value:g}"))
        if typed is None:
            return
        value = gain.read(typed)
        if isinstance(value, str):
            self._say(Answer(done=False, says=value))
            return
        self._say(await self._feed.set_gain(gain.key, value))

    def _only_looks(self) -> None:
        """Whoever tries to stop a vehicle from here must not wait for it."""
        if self._read_only:
            self._say(Answer(done=False, says="NOTHING WAS ORDERED: this screen may only look; go to the station"))

    def _later(self, work: Callable[[], Awaitable[Answer]]) -> None:
        """Do it beside the screen, which goes on being drawn, and say what came of it."""

        async def do() -> None:
            self._say(await work())

        self._app.run_worker(do())

    def _say(self, answer: Answer) -> None:
        severity: SeverityLevel = "information" if answer.done else "error"
        self._app.notify(printable(answer.says), severity=severity, timeout=6.0, markup=False)
