"""Dashboard: a process of its own that shows what a feed brings, and passes on what the operator orders.

What is pressed is confirmed where it must be, asked of the feed, and answered in words. ``groundstation tui`` and
``groundstation fly --tui`` show it.

Its feed is a running ground station, attached to again when it was lost.
"""

import argparse
import asyncio
import os
import shlex
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from textual.app import App, SystemCommand
from textual.binding import Binding, BindingType
from textual.command import CommandPalette
from textual.css.query import NoMatches
from textual.notifications import SeverityLevel
from textual.screen import Screen

from groundstation.config import ConfigError, refuse_io
from groundstation.core.messages import (
    Ask,
    Reply,
    Request,
    Sentence,
    notice,
)
from groundstation.core.mission import FINAL, ON_GROUND, REPEAT_S
from groundstation.interfaces.api import Control, OrderAnswer, StationClient, attach, stop_all
from groundstation.interfaces.tui.drawing import flight_time
from groundstation.interfaces.tui.model import (
    BY_ASK,
    ORDERS,
    SILENCE_S,
    Feed,
    FeedTrouble,
    FlightIdentity,
    GainRow,
    Holder,
    News,
    OperatorOrder,
    Picture,
    Twice,
    possible,
)
from groundstation.interfaces.tui.pages import (
    PAGES,
    ConfigPage,
    ControlPage,
    FlyPage,
    LinksPage,
    LogPage,
    Page,
    PageFrame,
)
from groundstation.interfaces.tui.terminal import TolerantDriver, find_multiplexer
from groundstation.interfaces.tui.widgets import TALL, THEMES, Choice, Dialog, Help, Knobs, Typed, require_terminal
from groundstation.machine import (
    ApiError,
    StatusConfig,
    find_socket,
    folder_of,
    is_served,
    make_folder,
    open_private,
    served_sockets,
    socket_path,
)
from groundstation.settings import Config, is_rehearsal
from links.io import start_child
from links.text import printable

RETRY_S = 0.5
"""Time between two tries to attach [s]."""
NAME = "tui"


class Attached:
    """Implements :class:`groundstation.interfaces.tui.model.Feed`.

    What is asked while nobody is there is not asked later.
    """

    def __init__(self, path: Path, pid: int | None = None, gone: Callable[[], str] = str) -> None:
        """For the socket at ``path``; it may come and go.

        ``pid``: only this process is meant; ``gone`` says more about it where it does not serve, or nothing.
        """
        self._path = path
        self._pid, self._gone = pid, gone
        self._client: StationClient | None = None

    async def news(self) -> AsyncIterator[News]:
        """For ever, what is served, and why nothing is."""
        while True:
            trouble = str(notice("screen.closed"))
            try:
                self._client = await attach(self._path, NAME)
                hello = self._client.hello
                if self._pid not in (None, hello.pid):
                    raise ApiError(str(notice("screen.other_station", path=self._path, pid=hello.pid)))
                origin = f"process {hello.pid}, groundstation {hello.groundstation}"
                yield FlightIdentity(hello.vehicle, origin, hello.config)
                async for message in self._client:
                    if isinstance(message, Control):
                        yield Holder(message.holder or "", message.yours)
                    else:
                        yield message
            except FileNotFoundError:
                trouble = str(notice("screen.no_station", path=self._path))
            except OSError as error:
                trouble = f"{error.strerror or error}: {self._path}"
            except ApiError as error:
                trouble = str(error)
            finally:
                self._close()
            yield FeedTrouble(self._gone() or trouble)
            await asyncio.sleep(RETRY_S)

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Reply:
        """Ask for ``ask`` now or never."""
        return await self._order(lambda client: client.ask(Request(ask, why), vehicle))

    async def control(self, *, take: bool) -> Reply:
        """Take control, or give it back."""
        return await self._order(lambda client: client.take_control() if take else client.give_control())

    async def set_gain(self, key: str, value: float) -> Reply:
        """Change a gain in flight."""
        return await self._order(lambda client: client.set_gains({key: value}))

    async def _order(self, order: Callable[[StationClient], Awaitable[OrderAnswer]]) -> Reply:
        if self._client is None:
            return Reply.of(False, notice("screen.not_sent"))
        try:
            answer = await order(self._client)
        except ApiError as error:
            return Reply.of(False, notice("screen.no_answer", why=error))
        return Reply(answer.done, answer.says, answer.message, answer.numbers)

    def _close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()


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
        self._twice = Twice()

    def waits(self, now_s: float) -> bool:
        """Whether one more press now would kill."""
        return self._twice.waits(now_s)

    def order(self, order: OperatorOrder) -> None:
        """Order it. What brings the vehicle down does not ask back."""
        now = asyncio.get_running_loop().time()
        if self._read_only:
            self._only_looks()
        elif not order.always and now - self._picture.arrived_s > SILENCE_S:
            self._say(Reply.of(False, notice("screen.old", limit_s=SILENCE_S)))
        elif order.ask is Ask.KILL:
            if self._twice.press(now):
                asyncio.get_running_loop().call_later(REPEAT_S, self._kill)
            self._draw()
        elif order.always or order.ask in (Ask.HOLD, Ask.RETURN):
            self._ask(order.ask)
        else:
            self._app.run_worker(self._confirm(order))

    def _kill(self) -> None:
        """Kill, unless the key was held down: it has repeated itself since."""
        if self._twice.is_held:
            self._say(Reply.of(False, notice("screen.key_held")))
        else:
            self._ask(Ask.KILL)

    async def _confirm(self, order: OperatorOrder) -> None:
        """Arm and fly, once the operator has confirmed."""
        newest = self._picture.newest
        if newest is None:
            self._say(Reply.of(False, notice("screen.no_vehicle")))
        elif not self._picture.holder.yours:
            self._say(Reply.of(False, notice("screen.take_first")))
        elif not possible(order, newest.state):
            self._say(Reply.of(False, notice("mission.not_possible", ask=order.ask, state=newest.state)))
        elif order.ask is Ask.ARM:
            says = str(notice("screen.arm", vehicle=newest.vehicle))
            typed = await self._app.push_screen_wait(Typed(f"ARM {newest.vehicle}?", says, wanted=newest.vehicle))
            if typed is not None:
                self._ask(order.ask, typed)
        else:
            says = str(notice("screen.fly", vehicle=newest.vehicle))
            options = [("no", "No, stay"), ("yes", "Yes, fly")]
            if await self._app.push_screen_wait(Choice("FLY the trajectory?", says, options)) == "yes":
                self._ask(order.ask)

    def _ask(self, ask: Ask, vehicle: str = "") -> None:
        self._later(lambda: self._feed.ask(ask, "", vehicle))

    def land_all(self) -> None:
        """Land this vehicle, and every other one that this user flies from this machine. It does not ask back."""
        if self._read_only:
            self._only_looks()
            return
        self._ask(Ask.LAND)
        self._later(self._stop_all)

    async def _stop_all(self) -> Reply:
        told = await stop_all(Ask.LAND, "stop-all from a dashboard")
        silent = [one.says for one in told if not one.answered]
        if silent:
            return Reply.of(False, notice("screen.some_silent", says="; ".join(silent)))
        return Reply.of(True, notice("screen.all_landed", count=len(told)))

    def control(self) -> None:
        """Take control, or give it back."""
        if self._read_only:
            self._only_looks()
        else:
            self._later(lambda: self._feed.control(take=not self._picture.holder.yours))

    async def take(self) -> None:
        """Take control."""
        self._say(await self._feed.control(take=True))

    async def edit(self, gain: GainRow) -> None:
        """Ask for a new value of a gain, and pass it on."""
        if self._read_only:
            self._only_looks()
            return
        if not self._picture.holder.yours:
            self._say(Reply.of(False, notice("screen.gain_control")))
            return
        typed = await self._app.push_screen_wait(Typed(gain.key, gain.text(), value=f"{gain.value:g}"))
        if typed is None:
            return
        value = gain.read(typed)
        if isinstance(value, Sentence):
            self._say(Reply.of(False, value))
            return
        self._say(await self._feed.set_gain(gain.key, value))

    def _only_looks(self) -> None:
        """Whoever tries to stop a vehicle from here must not wait for it."""
        self._say(Reply.of(False, notice("screen.only_looks")))

    def _later(self, work: Callable[[], Awaitable[Reply]]) -> None:
        """Do it beside the screen, which goes on being drawn, and say what came of it."""

        async def do() -> None:
            self._say(await work())

        self._app.run_worker(do())

    def _say(self, answer: Reply) -> None:
        severity: SeverityLevel = "information" if answer.done else "error"
        self._app.notify(printable(answer.says), severity=severity, timeout=6.0, markup=False)


FRAME_S = 0.2
"""Time between two drawings [s]."""
NOTICE_S = 20.0
"""Time for which the notice of a new dashboard is shown [s]."""
PAGE_TYPES: tuple[type[Page], ...] = (FlyPage, ControlPage, LinksPage, ConfigPage, LogPage)
SMALL = 72
"""Below it numbers and gains do not stand side by side [columns]."""
NO_SCREEN = frozenset((*ON_GROUND, *FINAL))
"""In these states a flight needs nobody to look at it."""


class Dashboard(App[None]):
    """Pages by the keys 1 to 5; what brings the vehicle down works on all of them and in every dialog."""

    DEFAULT_MODE = "fly"
    ENABLE_COMMAND_PALETTE = True
    CSS = """
    ToastRack { margin-bottom: 6; }  /* what brings the vehicle down stays in sight, and can be clicked on */
    .short ToastRack { margin-bottom: 2; }  /* they cover the events, never the numbers */
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        *(Binding(str(number), f"page('{name.lower()}')", name) for number, name in enumerate(PAGES, 1)),
        *(Binding(",".join(o.keys), o.action, show=False, priority=o.always) for o in ORDERS if o.keys),
        Binding("question_mark", "keys", "keys", key_display="?"),
        Binding("ctrl+p", "command_palette", "more", priority=True),
        Binding("colon", "command_palette", show=False),
        Binding("c", "control", "control"),
        Binding("q", "quit", "quit"),
    ]

    def __init__(
        self,
        feed: Feed,
        *,
        read_only: bool = False,
        take_control: bool = False,
        which: str | None = None,
        notice: str = "",
    ) -> None:
        """Show ``feed``.

        Args:
            feed: What to show, and whom to ask.
            read_only: Nothing can be ordered at all.
            take_control: Take control as soon as somebody is there; after that only when told to.
            which: The options that name this flight to other commands, for who leaves while it flies; without it, its
                vehicle's name.
            notice: What is said to the operator at first.
        """
        super().__init__(driver_class=TolerantDriver)
        self.left = False
        """Whether the operator has left it; else it has failed, where it has ended."""
        self._notice = notice
        self.title = "groundstation"
        self.HORIZONTAL_BREAKPOINTS = [(0, "-small"), (SMALL, "-narrow"), (120, "-wide")]
        self.VERTICAL_BREAKPOINTS = [(0, "short"), (TALL, "tall")]
        self._feed = feed
        self._orders = not read_only
        self._read_only = read_only
        self._take_control = take_control and self._orders
        self._which = which
        self.picture: Picture
        self._ordering: Ordering
        for theme in THEMES:
            self.register_theme(theme)
        self.theme = THEMES[0].name
        for page in PAGE_TYPES:
            self.add_mode(page.NAME.lower(), partial(page, orders=self._orders))

    # ---- what comes in

    def on_mount(self) -> None:
        """Begin to listen."""
        self.picture = Picture(asyncio.get_running_loop().time())
        self._ordering = Ordering(self, self._feed, self.picture, self.draw, read_only=self._read_only)
        self.run_worker(self._listen())

    def on_ready(self) -> None:
        """Begin to draw: only now are all parts of the screen there."""
        self.set_interval(FRAME_S, self.draw)
        if self._notice:
            self.notify(self._notice, severity="warning", timeout=NOTICE_S)
        taker = find_multiplexer(os.environ)
        if taker and self._orders:
            says = notice("tui.multiplexer", taker=taker)
            self.notify(says.text, severity="warning", timeout=NOTICE_S, markup=False)

    async def _listen(self) -> None:
        loop = asyncio.get_running_loop()
        async for news in self._feed.news():
            first = self.picture.hello is None
            self.picture.take(news, loop.time())
            if first and self.picture.hello is not None and self._take_control:
                self._take_control = False
                await self._ordering.take()

    def draw(self) -> None:
        """Draw what is new on the page, and on the dialog above it."""
        now, picture = asyncio.get_running_loop().time(), self.picture
        newest = picture.newest
        frame = PageFrame(
            picture,
            now,
            stale=now - picture.arrived_s > SILENCE_S,
            again=self._ordering.waits(now),
            whose="" if newest is None else f"{_title(newest.vehicle)}  {flight_time(newest.flight_time_s)}",
            holder=self._beside(),
        )
        for screen in self.screen_stack:
            if isinstance(screen, Page):
                with suppress(NoMatches):  # one that is coming or going has not all its parts
                    screen.show(frame)
            elif isinstance(screen, Dialog):
                for knobs in screen.query(Knobs):
                    knobs.show(None if newest is None else newest.state, frame.again)

    def _beside(self) -> str:
        """Return the banner's last words: who holds control."""
        if self._read_only:
            return str(notice("screen.read_only"))
        holder = self.picture.holder
        if holder.yours:
            return str(notice("control.yours"))
        return str(notice("control.held", client=holder.name) if holder.name else notice("screen.control_free"))

    # ---- what goes out

    def action_order(self, ask: str) -> None:
        """Do what a key, a button or the palette says."""
        self._ordering.order(BY_ASK[Ask(ask)])

    def action_land_all(self) -> None:
        """Land this vehicle, and every other one that this user flies from this machine."""
        self._ordering.land_all()

    def action_control(self) -> None:
        """Take control, or give it back."""
        self._ordering.control()

    def on_control_page_chosen(self, event: ControlPage.Chosen) -> None:
        """A gain shall be changed."""
        self.run_worker(self._ordering.edit(event.gain))

    # ---- the screen itself

    def action_page(self, name: str) -> None:
        """Go to another page."""
        self.switch_mode(name)
        self.call_after_refresh(self.draw)

    def action_keys(self) -> None:
        """Show all keys."""
        self.push_screen(Help(list(self._keys()), orders=self._orders))

    def _keys(self) -> Iterable[tuple[str, str]]:
        if self._orders:
            yield from ((order.shown, f"{order.label}: {order.says}") for order in ORDERS if order.key)
            yield "c", "take control, or give it back"
            yield "Enter", "on the page Control: change a gain"
        yield "1 to 5", f"pages: {', '.join(PAGES)}"
        yield "p", "on the page Fly: plots from above, or in time"
        yield "^P/:", "all commands, and the colours"
        yield "q", "leave; what flies goes on flying"

    def action_command_palette(self) -> None:
        """Show the palette; Textual's own has an id, which the next one must not share while it is still closing."""
        if not isinstance(self.screen, CommandPalette):
            self.push_screen(CommandPalette())

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """The palette."""
        del screen
        if self._orders:
            for order in ORDERS:
                do = self.action_land_all if order.everywhere else partial(self.action_order, order.ask)
                yield SystemCommand(order.label, order.says, do)
            yield SystemCommand("Control", "take control, or give it back", self.action_control)
        for name in PAGES:
            yield SystemCommand(f"Page {name}", "show this page", partial(self.action_page, name.lower()))
        for theme in THEMES:
            wear = partial(setattr, self, "theme", theme.name)
            yield SystemCommand(f"Colours {theme.name} (color theme)", "all eyes can tell them apart", wear)
        yield SystemCommand("Keys", "show all keys", self.action_keys)
        yield SystemCommand("Quit", "leave; what flies goes on flying", self.action_quit)

    async def action_quit(self) -> None:
        """Leave; what flies goes on, and the operator is told so."""
        newest = self.picture.newest
        if newest is None or newest.state in NO_SCREEN:
            self.left = True
            self.exit()
        elif not isinstance(self.screen, Dialog):
            self.run_worker(self._leave(newest.vehicle, newest.state))

    async def _leave(self, vehicle: str, state: str) -> None:
        says = str(notice("screen.leave", vehicle=vehicle, state=state))
        options: Sequence[tuple[str, str]] = [("stay", "Stay"), ("leave", "Leave; the flight goes on")]
        if await self.push_screen_wait(Choice("Leave?", says, options, orders=self._orders)) == "leave":
            which = self._which or f"--vehicle {vehicle}"
            self.left = True
            self.exit(
                message=f"{notice('screen.left', vehicle=vehicle, state=state)}\n"
                f"  see it again  groundstation tui {which}\n  land          groundstation request land {which}"
            )


NICE = 5
"""Nice value of the dashboard, below the flight: a key still gets through on a busy machine."""
END_S = 20.0
"""Timeout for a ground station on the ground to end [s]."""
AGAIN_S = 1.0
"""A dashboard that has failed begins anew no sooner [s]."""


def tui_command(args: argparse.Namespace) -> int:
    """Show a flight that is going on."""
    if args.browser is not None:
        raise ConfigError("--browser", notice("screen.no_browser"))
    if args.config is not None:
        raise ConfigError("CONFIG.toml", notice("screen.no_recording", path=args.config))
    require_terminal("groundstation daemon health says in a line how the flight is")
    path = args.socket or served_socket(args.vehicle)
    which = _which(args.socket)
    dashboard = Dashboard(Attached(path), read_only=args.read_only, which=which)
    return _run(dashboard, args.theme)


def fly_with_screen(args: argparse.Namespace, config: Config) -> int:
    """Start the ground station as a process of its own, which outlives this one, and show what it does."""
    vehicle = config.vehicle.name
    path = socket_path(config.status, vehicle)
    require_terminal("groundstation fly without --tui needs none")
    if asyncio.run(is_served(path)):
        again = f"groundstation tui {_which(path)}"
        raise ConfigError("status.path", notice("screen.served", path=path, again=again))
    log = folder_of(config.recording) / f"{vehicle}.log"
    overrides = [word for override in args.overrides for word in ("--set", override)]
    overrides += ["--rehearse"] if args.rehearse else []
    arm = [] if args.arm is None else ["--arm", args.arm]
    words = ["daemon", str(args.config), "--once", *overrides, *arm]
    with refuse_io("recording.folder", "file.log_unwritten", log):
        make_folder(config.recording)
        output = open(log, "wb", opener=open_private)  # noqa: SIM115  # closed below; Path.open has no opener
    with output:
        core = start_child("groundstation", *words, stdout=output, stderr=output)

    def describe_end() -> str:
        if core.poll() is None:
            return ""
        return str(notice("screen.core_ended", code=core.returncode, last=_last_line(log)))

    which = _which(path if config.status.path else None)

    def make(notice: str) -> Dashboard:
        return Dashboard(Attached(path, core.pid, describe_end), take_control=True, which=which, notice=notice)

    dashboard = make("")
    code = _run(dashboard, args.theme)
    while not dashboard.left and core.poll() is None and sys.stdin.isatty():  # without a terminal nobody sees it
        says = str(notice("screen.begins_anew", pid=core.pid))
        print(says, file=sys.stderr)
        try:
            asyncio.run(asyncio.sleep(AGAIN_S))
        except KeyboardInterrupt:
            break
        dashboard = make(says)
        code = _show(dashboard, args.theme)
    newest = dashboard.picture.newest
    if core.poll() is None and newest is not None and newest.state in NO_SCREEN:
        core.terminate()  # it ends what has not taken off; it would land what has, meanwhile
        try:
            core.wait(END_S)
        except subprocess.TimeoutExpired:
            print(notice("screen.busy", log=log))
    if core.poll() is None:
        print(notice("screen.goes_on", pid=core.pid, log=log))
        return code
    told = newest is not None and newest.state in FINAL
    last = _last_line(log)  # of a flight that was recorded: its error figures and the path
    ended = f"{vehicle} {newest.state}: {newest.reason}\n{last}" if told and newest is not None else last
    print(notice("screen.station_ended", ended=ended, log=log))
    return core.returncode


def _title(vehicle: str) -> str:
    """The vehicle's name; that of a rehearsal in large letters."""
    return vehicle.upper() if is_rehearsal(vehicle) else vehicle


def _which(socket: Path | None) -> str | None:
    return None if socket is None else f"--socket {shlex.quote(str(socket))}"


def _run(dashboard: Dashboard, theme: str) -> int:
    os.nice(NICE)  # what flies comes first, where both want the same processor
    return _show(dashboard, theme)


def _show(dashboard: Dashboard, theme: str) -> int:
    dashboard.theme = theme
    dashboard.run()
    return dashboard.return_code or 0


def served_socket(vehicle: str | None) -> Path:
    """Where the ground station that is meant serves."""
    served = asyncio.run(served_sockets(vehicle))
    if len(served) == 1:
        return served[0]
    if not served and vehicle is not None:
        return socket_path(StatusConfig(), vehicle)  # it may come up yet
    if not served:
        raise ConfigError("tui", notice("screen.nobody"))
    try:
        return asyncio.run(find_socket(vehicle))
    except ApiError as error:
        raise ConfigError("--vehicle", str(error)) from None


def _last_line(log: Path) -> str:
    lines = log.read_text("utf-8", "replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), str(notice("screen.silent_log")))
