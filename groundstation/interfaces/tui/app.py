"""Dashboard: a process of its own that shows what a feed brings, and passes on the orders.

What is pressed is confirmed where it must be, asked of the feed, and answered in words.
``groundstation tui`` and ``groundstation fly --tui`` show it.

Its feed is a running ground station, attached to again when it was lost, or a recording.
"""

import argparse
import asyncio
import math
import os
import shlex
import subprocess
import sys
from bisect import bisect_right
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import msgspec
from textual.app import App, SystemCommand
from textual.binding import Binding, BindingType
from textual.command import CommandPalette
from textual.css.query import NoMatches
from textual.notifications import SeverityLevel
from textual.screen import Screen

from groundstation.config import ConfigError, parse_toml, refuse_io, refuse_value
from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import (
    FLOWN,
    GAIN,
    Ask,
    Certificate,
    Diagnostics,
    DisturbanceMeter,
    Notice,
    PoseStatus,
    Reply,
    Request,
    Sentence,
    Severity,
    Snapshot,
    SteadyError,
    notice,
)
from groundstation.core.mission import ALARMING, FINAL, ON_GROUND, REPEAT_S, State
from groundstation.core.safety import LIVE, PREFIX
from groundstation.interfaces.api import (
    END_S,
    OrderAnswer,
    StationClient,
    open_client,
    stop_all,
)
from groundstation.interfaces.tui.drawing import flight_time
from groundstation.interfaces.tui.model import (
    BY_ASK,
    FRAME_S,
    KEPT,
    ORDERS,
    SILENCE_S,
    Feed,
    FeedTrouble,
    FlightIdentity,
    GainRow,
    Jump,
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
from groundstation.interfaces.tui.widgets import (
    TALL,
    THEMES,
    Choice,
    Dialog,
    Help,
    Knobs,
    Typed,
    require_terminal,
)
from groundstation.machine import (
    NICE,
    ApiError,
    StatusConfig,
    explain_stop,
    find_socket,
    folder_of,
    is_served,
    make_folder,
    open_private,
    served_sockets,
    socket_path,
    wait_at_most,
)
from groundstation.recording import Entry, Recording, refuse_recordings
from groundstation.runtime import Exit
from groundstation.settings import Config, is_rehearsal
from links.core import REOPEN_S, LinkStatus
from links.io import describe_exit, start_child
from links.text import printable

NAME = "tui"


class Attached:
    """Implements :class:`groundstation.interfaces.tui.model.Feed`.

    What is asked while nobody is there is not asked later.
    """

    live = True

    def __init__(self, path: Path, pid: int | None = None, gone: Callable[[], str] = str) -> None:
        """For the socket at ``path``; it may come and go.

        ``pid``: only this process is meant; ``gone`` says more about it where it does not serve.
        """
        self._path = path
        self._pid, self._gone = pid, gone
        self._client: StationClient | None = None

    async def news(self) -> AsyncIterator[News]:
        """For ever, what is served, and why nothing is."""
        while True:
            trouble = str(notice("screen.closed"))
            try:
                async with open_client(self._path, NAME) as self._client:
                    hello = self._client.hello
                    if self._pid not in (None, hello.pid):
                        raise ApiError(
                            notice("screen.other_station", path=self._path, pid=hello.pid)
                        )
                    origin = f"process {hello.pid}, groundstation {hello.groundstation}"
                    yield FlightIdentity(hello.vehicle, origin, hello.config)
                    async for message in self._client:
                        yield message
            except FileNotFoundError:
                trouble = str(notice("screen.no_station", path=self._path))
            except OSError as error:
                trouble = f"{error.strerror or error}: {self._path}"
            except ApiError as error:
                trouble = str(error)
            finally:
                self._client = None
            yield FeedTrouble(self._gone() or trouble)
            await asyncio.sleep(REOPEN_S)

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Reply:
        """Ask for ``ask`` now or never."""
        return await self._order(lambda client: client.ask(Request(ask, why), vehicle))

    async def control(self, *, take: bool) -> Reply:
        """Take control, or give it back."""
        return await self._order(
            lambda client: client.take_control() if take else client.give_control()
        )

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


SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Speeds of a playback, as multiples of the flight's."""
WIND_S = 5.0
"""Step of one key through a recording [s]."""


class Playback(Feed):
    """A recording, played back."""

    def __init__(
        self, hello: FlightIdentity, snapshots: Sequence[Snapshot], trouble: str = ""
    ) -> None:
        """Whom it is about, and the snapshots in their order.

        It begins at the first one, playing. ``trouble`` says why the rest is missing.
        """
        self._hello, self._snapshots = hello, snapshots
        self._trouble = trouble
        self._times = [snapshot.time_s for snapshot in snapshots]
        self._at_s = self._times[0] if snapshots else 0.0
        self._speed = SPEEDS.index(1.0)
        self._wound = asyncio.Event()
        self.paused = False

    async def news(self) -> AsyncIterator[News]:
        """The snapshots as their time comes.

        Where it was wound, also those before, for the plots.
        """
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
            await wait_at_most(self._wound.wait(), FRAME_S)

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
                self._speed = max(
                    0, min(len(SPEEDS) - 1, self._speed + (1 if what == "faster" else -1))
                )

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
        pace = "stopped" if self.paused else f"×{SPEEDS[self._speed]:g}"
        trouble = f"; it {self._trouble}" if self._trouble else ""
        return f"RECORDING {self.passed_s:.1f}/{whole:.1f} s {pace}{trouble}"


_TICK = ("/command", "/reference", "/estimate", "/errors", "/adaptation", "/lyapunov")
_TOPICS = (*_TICK, "/measured", "/mission", "/switch", "/request", "/lost", "/link", "/source")
_LINK = LinkStatus(state="closed", sent=0, expired=0, received=0, dropped={}, text="")


T = TypeVar("T", LinkStatus, PoseStatus)


class Tape:
    """One recording, read once.

    What is not recorded is missing: V is without b̃, pre-flight checks are events.
    """

    def __init__(self, path: Path) -> None:
        """Look at the beginning.

        Raises:
            NoRecording, OSError: see :class:`groundstation.recording.reader.Recording`.
        """
        self._recording = Recording(path)
        about = self._recording.about
        self.hello = FlightIdentity(
            about.get("vehicle", "?"), f"recording {path.name}", about.get("config", "")
        )
        try:
            config = parse_toml(self.hello.config)
        except ValueError:
            config = {}
        vehicle = config.get("vehicle", {})
        self._thrust_max_n = float(vehicle.get("thrust_max_n", math.nan))
        limits = vehicle.get("rate_limits_deg_s", ())
        self._floor_z_m = float(config.get("flight", {}).get("floor_z_m", 0.0))
        self._disturbance = DisturbanceMeter(float(vehicle.get("mass_kg", math.nan)))
        self._limits = _triple([math.radians(one) for one in limits]) if len(limits) == 3 else None
        self._state = self._reason = ""
        self._events: deque[Notice] = deque(maxlen=20)
        self._parts: dict[str, bytes] = {}
        self._arrivals: deque[float] = deque(maxlen=1000)
        self._steady = SteadyError()
        controller = config.get("controller", {})
        named = {name: controller.get(name) for name in LIVE}
        self._gains = {
            PREFIX + name: float(value) for name, value in named.items() if value is not None
        }

    @property
    def trouble(self) -> str:
        """Why the rest of it is missing, once it was read; empty where it is whole."""
        return self._recording.trouble

    def snapshots(self) -> Iterator[Snapshot]:
        """Yield the recording's snapshots to its end, or to its damage."""
        shift: float | None = None
        due = now = -math.inf
        for entry in self._recording.entries(_TOPICS):
            if shift is None:
                told = entry.value()
                shift = (
                    float(told.get("time_s", told.get("arrival_s", 0.0))) - 1e-9 * entry.stamp_ns
                )
            now = 1e-9 * entry.stamp_ns + shift
            if now >= due:
                if due > -math.inf:
                    yield self._snapshot(now)
                due = now + FRAME_S
            self._take(entry, now)
        if due > -math.inf:
            yield self._snapshot(now)

    def _take(self, entry: Entry, now: float) -> None:
        self._parts[entry.topic] = entry.data
        match entry.topic:
            case "/measured":
                self._arrivals.append(now)
            case "/errors" if self._state == State.TRACKING:
                error = _number(self._part("/errors"), "error_m")
                if math.isfinite(error):
                    self._steady.add(_number(self._part("/command"), "flight_time_s"), error)
            case "/adaptation" if self._state in FLOWN:
                estimate, adaptation = self._part("/estimate"), self._part("/adaptation")
                self._disturbance.add_parts(
                    now,
                    _quaternion(estimate),
                    _number(estimate, "thrust_n"),
                    _vector(adaptation, "d_hat_m_s2"),
                    _number(adaptation, "effectiveness", 1.0),
                    _number(adaptation, "effectiveness_deviation"),
                )
            case "/mission":
                told = entry.value()
                if told["state"] != self._state:
                    self._state, self._reason = told["state"], told["text"]
                grave = Severity.WARNING if told["state"] in ALARMING else Severity.INFO
                self._events.append(Notice(now, told["state"], told["text"], "course", grave))
            case "/switch":
                told = entry.value()
                if told["what"].startswith(GAIN):
                    self._gains[PREFIX + told["what"].removeprefix(GAIN)] = told["values"][0]
            case "/request":
                told = entry.value()
                self._events.append(
                    Notice(now, self._state, f"asked to {told['what']}: {told['reason']}")
                )
            case "/lost":
                self._events.append(
                    Notice(now, self._state, f"{entry.value()['count']} records are missing here")
                )

    def _part(self, topic: str) -> dict[str, Any]:
        data = self._parts.get(topic)
        found: dict[str, Any] = {} if data is None else msgspec.json.decode(data)
        return found

    def _snapshot(self, now: float) -> Snapshot:
        command, reference, estimate, errors, adaptation, lyapunov = (
            self._part(topic) for topic in _TICK
        )
        measured = self._part("/measured")
        here = estimate or measured
        source = _status(self._part("/source"), PoseStatus(accepted=0, dropped={}))
        while self._arrivals and self._arrivals[0] < now - 1.0:
            self._arrivals.popleft()
        return Snapshot(
            vehicle=self.hello.vehicle,
            state=self._state,
            reason=self._reason,
            time_s=now,
            flight_time_s=_number(command, "flight_time_s", 0.0),
            pose_id=int(measured.get("id", -1)),
            pose_age_s=now - _number(measured, "time_s", now),
            pose_rate_hz=float(len(self._arrivals)),
            poses_dropped=source.dropped,
            position_ned=_vector(here, "position_ned"),
            velocity_ned=_vector(estimate, "velocity_ned"),
            attitude=_quaternion(here),
            reference_ned=_vector(reference or here, "position_ned"),
            error_m=_number(errors, "error_m", 0.0),
            rms_m=self._steady.rms_m or 0.0,
            thrust_n=_number(command, "thrust_n", 0.0),
            thrust_max_n=self._thrust_max_n,
            rates_rad_s=_vector(command, "rates_rad_s"),
            saturated=bool(command.get("saturated")),
            diagnostics=_diagnostics(errors, adaptation, lyapunov) if errors else None,
            link=_status(self._part("/link"), _LINK),
            floor_z_m=self._floor_z_m,
            events=tuple(self._events),
            rate_limits_rad_s=self._limits,
            disturbance=self._disturbance.reading,
            certificate=_certificate(lyapunov) if lyapunov else None,
            pose_latency_s=source.latency_s,
            pose_latency_max_s=source.latency_max_s,
            pose_gaps=source.gaps,
            pose_clock_steps=source.clock_steps + source.clock_restarts,
            gains=dict(self._gains),
        )


def _diagnostics(
    errors: dict[str, Any], adaptation: dict[str, Any], lyapunov: dict[str, Any]
) -> Diagnostics:
    return Diagnostics(
        z1=_vector(errors, "z1_m"),
        z2=_vector(errors, "z2_m_s"),
        z3=_vector(errors, "z3_m_s2"),
        u_star=_vector(errors, "u_star_m_s2"),
        b_hat=_vector(adaptation, "b_hat_m_s2"),
        b_hat_dot=_vector(adaptation, "b_hat_dot_m_s3"),
        disturbance=_vector(adaptation, "d_hat_m_s2"),
        v_terms=_triple([_number(lyapunov, key) for key in ("v_sigma", "v_omega", "v_z3")]),
        w_terms=_triple([_number(lyapunov, key) for key in ("w_sigma", "w_rho", "w_z3")]),
        v_known=_number(lyapunov, "v_known"),
        w=_number(lyapunov, "w"),
        certificate=str(lyapunov.get("certificate", "none")),
    )


def _certificate(lyapunov: dict[str, Any]) -> Certificate:
    return Certificate(
        state=str(lyapunov["state"]),
        bound=str(lyapunov["certificate"]),
        v=_number(lyapunov, "v_known"),
        excess=_number(lyapunov, "excess"),
        violated_fraction=math.nan,
        suspended_fraction=math.nan,
        b_hat_fraction=None,
    )


def _status(part: dict[str, Any], otherwise: T) -> T:
    try:
        return msgspec.convert(part["status"], type(otherwise))
    except (KeyError, msgspec.ValidationError):
        return otherwise


def _number(part: dict[str, Any], key: str, otherwise: float = math.nan) -> float:
    """JSON knows no NaN: null is one."""
    value = part.get(key, otherwise)
    return math.nan if value is None else float(value)


def _vector(part: dict[str, Any], key: str) -> Vec3:
    value = part.get(key)
    return (0.0, 0.0, 0.0) if value is None else _triple([_number(value, axis) for axis in "xyz"])


def _quaternion(part: dict[str, Any]) -> Quat:
    attitude = part.get("attitude", {})
    w, x, y, z = (
        _number(attitude, key, default) for key, default in zip("wxyz", (1.0, 0, 0, 0), strict=True)
    )
    return w, x, y, z


def _triple(values: list[float]) -> Vec3:
    a, b, c = values
    return a, b, c


PAGE_TYPES: tuple[type[Page], ...] = (FlyPage, ControlPage, LinksPage, ConfigPage, LogPage)
SMALL = 72
"""Below it numbers and gains do not stand side by side [columns]."""
NO_SCREEN = frozenset((*ON_GROUND, *FINAL))
"""In these states a flight needs nobody to look at it."""


class Dashboard(App[None]):
    """Pages by the keys 1 to 5.

    What brings the vehicle down works on all of them and in every dialog.
    """

    DEFAULT_MODE = "fly"
    ENABLE_COMMAND_PALETTE = True
    NOTIFICATION_TIMEOUT = 10.0
    """Time for which an answer or a notice is shown [s]."""
    CSS = """
    /* what brings the vehicle down stays in sight, and can be clicked on */
    ToastRack { margin-bottom: 6; }
    .short ToastRack { margin-bottom: 2; }  /* they cover the events, never the numbers */
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        *(
            Binding(str(number), f"page('{name.lower()}')", name)
            for number, name in enumerate(PAGES, 1)
        ),
        *(
            Binding(",".join(o.keys), o.action, show=False, priority=o.always)
            for o in ORDERS
            if o.keys
        ),
        Binding("question_mark", "keys", "keys", key_display="?"),
        Binding("ctrl+p", "command_palette", "more", priority=True),
        Binding("colon", "command_palette", show=False),
        Binding("c", "control", "control"),
        Binding("space", "play('pause')", "pause"),
        Binding("left", "play('back')", "back"),
        Binding("right", "play('on')", "on"),
        Binding("home", "play('start')", show=False),
        Binding("minus", "play('slower')", show=False),
        Binding("plus,equals_sign", "play('faster')", show=False),
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
            which: The options that name this flight to other commands, for who leaves while it
                flies; without it, its vehicle's name.
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
        self._orders = feed.live and not read_only
        self._read_only = read_only
        self._take_control = take_control and self._orders
        self._which = which
        self.picture: Picture
        self._twice = Twice()
        for theme in THEMES:
            self.register_theme(theme)
        self.theme = THEMES[0].name
        for page in PAGE_TYPES:
            self.add_mode(page.NAME.lower(), partial(page, orders=self._orders))

    @property
    def _plays(self) -> bool:
        return isinstance(self._feed, Playback)

    # ---- what comes in

    def on_mount(self) -> None:
        """Begin to listen."""
        self.picture = Picture(asyncio.get_running_loop().time())
        self.run_worker(self._listen())

    def on_ready(self) -> None:
        """Begin to draw: only now are all parts of the screen there."""
        self.set_interval(FRAME_S, self.draw)
        if self._notice:
            self.notify(self._notice, severity="warning")
        taker = find_multiplexer(os.environ)
        if taker and self._orders:
            says = notice("tui.multiplexer", taker=taker)
            self.notify(says.text, severity="warning", markup=False)

    async def _listen(self) -> None:
        loop = asyncio.get_running_loop()
        async for news in self._feed.news():
            first = self.picture.hello is None
            self.picture.take(news, loop.time())
            if first and self.picture.hello is not None and self._take_control:
                self._take_control = False
                self._say(await self._feed.control(take=True))

    def draw(self) -> None:
        """Draw what is new on the page, and on the dialog above it."""
        now, picture = asyncio.get_running_loop().time(), self.picture
        if not self._feed.live:
            picture.arrived_s = now
        newest = picture.newest
        frame = PageFrame(
            picture,
            now,
            stale=now - picture.arrived_s > SILENCE_S,
            again=self._twice.waits(now),
            whose=""
            if newest is None
            else f"{_title(newest.vehicle)}  {flight_time(newest.flight_time_s)}",
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
        """Return the banner's last words: the place in a recording, or who holds control."""
        if isinstance(self._feed, Playback):
            return self._feed.where()
        if self._read_only:
            return str(notice("screen.read_only"))
        return self.picture.describe_holder()

    # ---- what goes out

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """No orders to a recording.

        A screen that may only look says so; nothing to play in a flight.
        """
        del parameters
        if action in ("order", "control", "land_all"):
            return self._orders or self._read_only
        return self._plays if action == "play" else True

    def action_order(self, ask: str) -> None:
        """Order what a key, a button or the palette says.

        What brings the vehicle down does not ask back.
        """
        order = BY_ASK[Ask(ask)]
        now = asyncio.get_running_loop().time()
        if not self._orders:
            self._only_looks()
        elif not order.always and now - self.picture.arrived_s > SILENCE_S:
            self._say(Reply.of(False, notice("screen.old", limit_s=SILENCE_S)))
        elif order.ask is Ask.KILL:
            if self._twice.press(now):
                asyncio.get_running_loop().call_later(REPEAT_S, self._kill)
            self.draw()
        elif order.always or order.ask in (Ask.HOLD, Ask.RETURN):
            self._ask(order.ask)
        else:
            self.run_worker(self._confirm(order))

    def _kill(self) -> None:
        """Kill, unless the key was held down: it has repeated itself since."""
        if self._twice.is_held:
            self._say(Reply.of(False, notice("screen.key_held")))
        else:
            self._ask(Ask.KILL)

    async def _confirm(self, order: OperatorOrder) -> None:
        """Arm and fly, once the operator has confirmed."""
        newest = self.picture.newest
        if newest is None:
            self._say(Reply.of(False, notice("screen.no_vehicle")))
        elif not self.picture.holder.yours:
            self._say(Reply.of(False, notice("screen.take_first")))
        elif not possible(order, newest.state):
            name = "mission.over" if newest.state in FINAL else "mission.not_possible"
            self._say(Reply.of(False, notice(name, ask=order.ask, state=newest.state)))
        elif order.ask is Ask.ARM:
            says = str(notice("screen.arm", vehicle=newest.vehicle))
            typed = await self.push_screen_wait(
                Typed(f"ARM {newest.vehicle}?", says, wanted=newest.vehicle)
            )
            if typed is not None:
                self._ask(order.ask, typed)
        else:
            says = str(notice("screen.fly", vehicle=newest.vehicle))
            options = [("no", "No, stay"), ("yes", "Yes, fly")]
            if await self.push_screen_wait(Choice("FLY the trajectory?", says, options)) == "yes":
                self._ask(order.ask)

    def _ask(self, ask: Ask, vehicle: str = "") -> None:
        self._later(lambda: self._feed.ask(ask, "", vehicle))

    def action_land_all(self) -> None:
        """Land this vehicle, and every other one that this user flies from this machine.

        It does not ask back.
        """
        if not self._orders:
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

    def action_control(self) -> None:
        """Take control, or give it back."""
        if self._orders:
            self._later(lambda: self._feed.control(take=not self.picture.holder.yours))
        else:
            self._only_looks()

    def on_control_page_chosen(self, event: ControlPage.Chosen) -> None:
        """A gain shall be changed."""
        self.run_worker(self._edit(event.gain))

    async def _edit(self, gain: GainRow) -> None:
        """Ask for a new value of a gain, and pass it on."""
        if not self._orders:
            self._only_looks()
            return
        if not self.picture.holder.yours:
            self._say(Reply.of(False, notice("screen.gain_control")))
            return
        typed = await self.push_screen_wait(Typed(gain.key, gain.text(), value=f"{gain.value:g}"))
        if typed is None:
            return
        value = gain.read(typed)
        self._say(
            Reply.of(False, value)
            if isinstance(value, Sentence)
            else await self._feed.set_gain(gain.key, value)
        )

    def action_help_quit(self) -> None:
        """Answer Ctrl-C, which lands from a terminal and would here be told as a wish to quit."""
        if self._orders:
            self._say(Reply.of(False, notice("screen.ctrl_c")))
        else:
            super().action_help_quit()

    def _only_looks(self) -> None:
        """Whoever tries to stop a vehicle from here must not wait for it."""
        if self._read_only:
            self._say(Reply.of(False, notice("screen.only_looks")))

    def _later(self, work: Callable[[], Awaitable[Reply]]) -> None:
        """Do it beside the screen, which goes on being drawn, and say what came of it."""

        async def do() -> None:
            self._say(await work())

        self.run_worker(do())

    def _say(self, answer: Reply) -> None:
        severity: SeverityLevel = "information" if answer.done else "error"
        self.notify(printable(answer.says), severity=severity, markup=False)

    # ---- the screen itself

    def action_page(self, name: str) -> None:
        """Go to another page."""
        self.switch_mode(name)
        self.call_after_refresh(self.draw)

    def action_play(self, what: str) -> None:
        """Steer a recording."""
        if isinstance(self._feed, Playback):
            self._feed.steer(what)
            self.call_after_refresh(self.draw)

    def action_keys(self) -> None:
        """Show all keys."""
        self.push_screen(Help(list(self._keys()), orders=self._orders))

    def _keys(self) -> Iterable[tuple[str, str]]:
        if self._orders:
            yield from (
                (order.shown, f"{order.label}: {order.says}") for order in ORDERS if order.key
            )
            yield "c", "take control, or give it back"
            yield "Enter", "on the page Control: change a gain"
        if self._plays:
            yield from (("space", "pause"), ("← →", "5 s back, 5 s on"), ("Home", "to the start"))
            yield "- +", "slower, faster: 0.25 to 16 times"
        yield "1 to 5", f"pages: {', '.join(PAGES)}"
        yield "p", "on the page Fly: plots from above, or in time"
        yield "^P/:", "all commands, and the colours"
        yield "q", "leave" if self._plays else "leave; what flies goes on flying"

    def action_command_palette(self) -> None:
        """Show the palette.

        Textual's own has an id, which the next one must not share while it is still closing.
        """
        if not isinstance(self.screen, CommandPalette):
            self.push_screen(CommandPalette())

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """The palette."""
        del screen
        if self._orders:
            for order in ORDERS:
                do = (
                    self.action_land_all
                    if order.everywhere
                    else partial(self.action_order, order.ask)
                )
                yield SystemCommand(order.label, order.says, do)
            yield SystemCommand("Control", "take control, or give it back", self.action_control)
        for name in PAGES:
            yield SystemCommand(
                f"Page {name}", "show this page", partial(self.action_page, name.lower())
            )
        for theme in THEMES:
            wear = partial(setattr, self, "theme", theme.name)
            yield SystemCommand(
                f"Colours {theme.name} (color theme)", "all eyes can tell them apart", wear
            )
        yield SystemCommand("Keys", "show all keys", self.action_keys)
        yield SystemCommand("Quit", "leave; what flies goes on flying", self.action_quit)

    async def action_quit(self) -> None:
        """Leave; what flies goes on, and the operator is told so."""
        newest = self.picture.newest
        if newest is None or not self._feed.live or newest.state in NO_SCREEN:
            self.left = True
            self.exit()
        elif not isinstance(self.screen, Dialog):
            self.run_worker(self._leave(newest.vehicle, newest.state))

    async def _leave(self, vehicle: str, state: str) -> None:
        says = str(notice("screen.leave", vehicle=vehicle, state=state))
        options: Sequence[tuple[str, str]] = [
            ("stay", "Stay"),
            ("leave", "Leave; the flight goes on"),
        ]
        if (
            await self.push_screen_wait(Choice("Leave?", says, options, orders=self._orders))
            == "leave"
        ):
            which = self._which or f"--vehicle {vehicle}"
            self.left = True
            self.exit(
                message=f"{notice('screen.left', vehicle=vehicle, state=state)}\n  see it again  "
                f"groundstation tui {which}\n  land          groundstation request land {which}"
            )


def tui_command(args: argparse.Namespace) -> int:
    """Show a flight that is going on, or a recorded one."""
    os.nice(NICE)  # what flies comes first, where both want the same processor
    if args.log is not None:
        require_terminal("groundstation report LOG.mcap writes a page about it")
        return _run(Dashboard(open_playback(args.log)), args.theme)
    require_terminal("groundstation daemon health says in a line how the flight is")
    path = args.socket or served_socket(args.vehicle)
    which = _which(args.socket)
    dashboard = Dashboard(Attached(path), read_only=args.read_only, which=which)
    return _run(dashboard, args.theme)


def fly_with_screen(args: argparse.Namespace, config: Config) -> int:
    """Start the ground station as a process that outlives this one, and show what it does."""
    path = socket_path(config.status, config.vehicle.name)
    require_terminal("groundstation fly without --tui needs none")
    if asyncio.run(is_served(path)):
        again = f"groundstation tui {_which(path)}"
        raise ConfigError("status.path", notice("screen.served", path=path, again=again))
    if stopped := explain_stop():  # before the station begins, which looks for later orders
        print(stopped, file=sys.stderr)
        return Exit.FAILED
    log = folder_of(config.recording) / f"{config.vehicle.name}.log"
    core = _start_station(args, config, log)

    def describe_end() -> str:
        if core.poll() is None:
            return ""
        how = describe_exit(core.returncode)
        return str(notice("screen.core_ended", how=how, last=_last_line(log)))

    def show(says: str) -> tuple[Dashboard, int]:
        dashboard = Dashboard(
            Attached(path, core.pid, describe_end),
            take_control=True,
            which=_which(path if config.status.path else None),
            notice=says,
        )
        return dashboard, _run(dashboard, args.theme)

    os.nice(NICE)  # what flies comes first, where both want the same processor
    dashboard, code = show("")
    # Without a terminal nobody sees it.
    while not dashboard.left and core.poll() is None and sys.stdin.isatty():
        says = str(notice("screen.begins_anew", pid=core.pid))
        print(says, file=sys.stderr)
        try:
            asyncio.run(asyncio.sleep(REOPEN_S))
        except KeyboardInterrupt:
            break
        dashboard, code = show(says)
    return _leave_station(core, log, dashboard.picture.newest, code)


def _start_station(args: argparse.Namespace, config: Config, log: Path) -> subprocess.Popen[bytes]:
    """Start a ground station for one flight, whose output goes to ``log``."""
    overrides = [word for override in args.overrides for word in ("--set", override)]
    overrides += ["--rehearse"] if args.rehearse else []
    arm = [] if args.arm is None else ["--arm", args.arm]
    words = ["daemon", str(args.config), "--once", *overrides, *arm]
    with refuse_io("recording.folder", "file.log_unwritten", log):
        make_folder(config.recording)
        output = open(log, "wb", opener=open_private)  # noqa: SIM115  # closed below; Path.open has no opener
    with output:
        return start_child("groundstation", *words, stdout=output, stderr=output)


def _leave_station(
    core: subprocess.Popen[bytes], log: Path, newest: Snapshot | None, code: int
) -> int:
    """End a station that does not fly, and say how it ended or that it goes on.

    Returns its exit code, or the screen's own ``code`` where it goes on.
    """
    if core.poll() is None and newest is not None and newest.state in NO_SCREEN:
        core.terminate()  # it ends what has not taken off; it would land what has, meanwhile
        try:
            core.wait(END_S)
        except subprocess.TimeoutExpired:
            print(notice("screen.busy", log=log))
    if core.poll() is None:
        print(notice("screen.goes_on", pid=core.pid, log=log))
        return code
    ended = _last_line(log)  # of a flight that was recorded: its error figures and the path
    if newest is not None and newest.state in FINAL:
        ended = f"{newest.vehicle} {newest.state}: {newest.reason}\n{ended}"
    print(notice("screen.station_ended", ended=ended, log=log))
    return core.returncode


def _title(vehicle: str) -> str:
    """The vehicle's name; that of a rehearsal in large letters."""
    return vehicle.upper() if is_rehearsal(vehicle) else vehicle


def _which(socket: Path | None) -> str | None:
    return None if socket is None else f"--socket {shlex.quote(str(socket))}"


def _run(dashboard: Dashboard, theme: str) -> int:
    dashboard.theme = theme
    dashboard.run()
    return dashboard.return_code or 0


def open_playback(log: Path) -> Playback:
    """Open the recording ``log`` for playback.

    Raises:
        ConfigError: it is no recording.
    """
    with refuse_recordings():
        tape = Tape(log)
    return Playback(tape.hello, list(tape.snapshots()), tape.trouble)


def served_socket(vehicle: str | None) -> Path:
    """Where the ground station that is meant serves."""
    if vehicle is not None and not asyncio.run(served_sockets(vehicle)):
        return socket_path(StatusConfig(), vehicle)  # it may come up yet
    with refuse_value("--vehicle", ApiError):
        return asyncio.run(find_socket(vehicle))


def _last_line(log: Path) -> str:
    lines = log.read_text("utf-8", "replace").split("\n")
    return next(
        (line for line in reversed(lines) if line.strip()), str(notice("screen.silent_log"))
    )
