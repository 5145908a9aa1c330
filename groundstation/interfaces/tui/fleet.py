"""Fleet screen: all vehicles at a broker, by what they publish, read-only: a process that no
station knows of.
"""

import asyncio
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import ClassVar, NamedTuple

import msgspec
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import DataTable, Footer, Static

from groundstation.config import is_name
from groundstation.core.messages import Snapshot
from groundstation.interfaces.api import decode
from groundstation.interfaces.mqtt import (
    OFFLINE,
    SNAPSHOT,
    STATE,
    MqttBroker,
    describe_error,
    heed_cancellation,
)
from groundstation.interfaces.tui.model import (
    ALARM,
    BUSY,
    CALM,
    FLYING,
    FRAME_S,
    SILENCE_S,
    BannerText,
    headline,
)
from groundstation.interfaces.tui.terminal import TolerantDriver
from groundstation.interfaces.tui.widgets import THEMES, Banner, Events, Numbers, require_terminal
from links.core import REOPEN_S
from links.text import printable

COLUMNS = (
    ("vehicle", 10), ("state", 14), ("pose", 7), ("error", 7), ("RMS", 7), ("batt", 6), ("link",
        8), ("data", 6),
    ("newest event", 60),
)  # fmt: skip
"""Heading and width of all columns; those that do not fit are scrolled to."""
AWAY = "away"
"""Tone of a vehicle that no station flies."""
URGENCIES = {ALARM: 0, BUSY: 1, FLYING: 1, CALM: 2, AWAY: 3}
"""Urgency by tone: 0 needs somebody now, 1 is in the air, 2 on the ground, 3 away."""
TONES = (ALARM, FLYING, CALM, CALM)
"""Tone of the banner by the worst urgency."""
MARKS = ("!!", "▲ ", "· ", "  ")
"""Mark by urgency, for those who see no colours."""


class VehicleView:
    """One vehicle, by its messages."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.offline = False
        """Whether no station flies it, as the broker says."""
        self.snapshot: Snapshot | None = None
        self._arrived_s = -math.inf

    def hear(self, topic: str, payload: bytes, now_s: float) -> None:
        """Take what came on ``topic``, below the vehicle's; what is not understood is dropped."""
        # UnicodeError is a ValueError.
        with suppress(ValueError, msgspec.MsgspecError, RecursionError):
            if topic == STATE.name:
                self.offline = payload == OFFLINE.encode()
            elif topic == SNAPSHOT.name:
                snapshot = decode(b'{"snapshot":%s}' % payload)
                # A station's end before its `offline`: this one is another's will.
                if isinstance(snapshot, Snapshot):
                    self.snapshot, self._arrived_s, self.offline = snapshot, now_s, False

    def age_s(self, now_s: float) -> float:
        """Return the time since the newest snapshot came [s]; infinite before the first."""
        return now_s - self._arrived_s

    def headline(self, now_s: float) -> BannerText:
        """Choose the most important fact of now, as a dashboard of it does."""
        if self.offline:
            return BannerText("OFFLINE", AWAY, "")
        return headline(self.snapshot, self.age_s(now_s), "")


class FleetMonitor:
    """All vehicles below one prefix."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix + "/"
        self._seen: dict[str, VehicleView] = {}

    def __iter__(self) -> Iterator[VehicleView]:
        return iter(self._seen.values())

    def hear(self, topic: str, payload: bytes, now_s: float) -> None:
        """Take one message of the broker; whatever is not for us is dropped."""
        name, _, rest = topic.removeprefix(self._prefix).partition("/")
        known = topic.startswith(self._prefix) and rest in (STATE.name, SNAPSHOT.name)
        if known and is_name(name):
            self._seen.setdefault(name, VehicleView(name)).hear(rest, payload, now_s)


class FleetRow(NamedTuple):
    """One vehicle."""

    name: str
    urgency: int
    cells: tuple[str, ...]
    """As in :data:`COLUMNS`."""


def fleet_row(seen: VehicleView, now_s: float) -> FleetRow:
    """Make a vehicle's row."""
    shown = seen.headline(now_s)
    urgency = URGENCIES[shown.tone]
    state = MARKS[urgency] + shown.big.upper()
    shot = seen.snapshot
    if shot is None:
        return FleetRow(
            seen.name, urgency, (seen.name, state, "-", "-", "-", "-", "-", "never", "")
        )
    share, volts = shot.link.battery_share, shot.link.battery_v
    battery = (
        f"{100.0 * share:.0f} %"
        if share is not None
        else f"{volts:.1f}V"
        if volts is not None
        else "-"
    )
    event = shot.events[-1].says if shot.events else ""
    metres = (_short(shot.error_m, "m"), _short(shot.rms_m, "m"))
    cells = (
        seen.name, state, _short(shot.pose_age_s, "s"), *metres, battery, shot.link.state[:7],
        _short(seen.age_s(now_s), "s"), event,
    )  # fmt: skip
    return FleetRow(seen.name, urgency, tuple(map(printable, cells)))


def fleet_rows(fleet: Iterable[VehicleView], now_s: float) -> list[FleetRow]:
    """All vehicles, those that need somebody first."""
    return sorted(
        (fleet_row(seen, now_s) for seen in fleet), key=lambda one: (one.urgency, one.name)
    )


def fleet_headline(shown: list[FleetRow], trouble: str) -> BannerText:
    """The worst, and how many of each.

    ``trouble`` is why the broker is not heard, empty where it is.
    """
    if trouble:
        return BannerText("NO BROKER", ALARM, trouble)
    if not shown:
        return BannerText("NO VEHICLE", BUSY, "none has published below this prefix yet")
    count = Counter(one.urgency for one in shown)
    words = ("ALARM", "FLYING", "ON GROUND", "OFFLINE")
    worst = min(count)
    detail = ", ".join(f"{count[i]} {words[i].lower()}" for i in sorted(count))
    return BannerText(f"{count[worst]} {words[worst]}", TONES[worst], detail)


def _short(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:.2f}{unit}" if value < 9.995 else f"{value:.0f}{unit}"


STYLES = ("bold white on dark_red", "bold", "", "dim")
"""Style of the first two columns by urgency."""


def run_fleet(broker: MqttBroker, theme: str) -> int:
    """Show all vehicles at ``broker`` until the operator quits; returns the exit code.

    Raises:
        ConfigError: there is no terminal.
    """
    require_terminal("docs/reference/mqtt.md says what other programs can read there")
    screen = FleetScreen(broker)
    screen.theme = theme
    screen.run()
    return screen.return_code or 0


class FleetScreen(App[None]):
    """A table; q leaves, and the numbers and events of the vehicle under the cursor are below."""

    CSS = """
    DataTable { height: 1fr; min-height: 6; }
    #details {
        height: 33%; min-height: 7; max-height: 24; border-top: solid $primary; padding: 0 1;
    }
    #details Numbers { width: 46; }
    #details Events { width: 1fr; height: 1fr; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [("q", "quit", "quit")]
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, broker: MqttBroker) -> None:
        super().__init__(driver_class=TolerantDriver)
        for theme in THEMES:
            self.register_theme(theme)
        self.theme = THEMES[0].name
        self._broker = broker
        self.fleet = FleetMonitor(broker.config.prefix)
        """State of all vehicles."""
        self._trouble = f"connecting to {broker}"
        self._drawn: list[FleetRow] = []

    def compose(self) -> ComposeResult:
        """Banner, table, details."""
        yield Banner()
        yield DataTable(cursor_type="row", zebra_stripes=True, cell_padding=0)
        with Vertical(id="details"):
            yield Static(id="chosen")
            with Horizontal():
                yield Numbers()
                yield Events()
        yield Footer()

    def on_mount(self) -> None:
        """Begin to read and to draw."""
        self._table.focus()
        for heading, width in COLUMNS:
            self._table.add_column(heading, width=width)
        self.run_worker(self._watch())
        self.set_interval(FRAME_S, self.draw)

    def on_data_table_row_highlighted(self) -> None:
        """Tell of another vehicle."""
        self._draw_details(asyncio.get_running_loop().time())

    @property
    def _table(self) -> "DataTable[Text]":
        return self.query_one(DataTable)

    async def _watch(self) -> None:
        """Listen for ever, connecting again whenever the connection is lost."""
        import aiomqtt

        root, loop = self._broker.config.prefix, asyncio.get_running_loop()
        wanted = [(f"{root}/+/{topic.name}", topic.quality) for topic in (STATE, SNAPSHOT)]
        while True:
            try:
                async with self._broker.client() as client:
                    await client.subscribe(wanted)
                    heed_cancellation()
                    self._trouble = ""
                    async for message in client.messages:
                        self.fleet.hear(str(message.topic), message.payload, loop.time())
            except (aiomqtt.MqttError, ValueError) as error:  # ValueError: no possible host name
                self._trouble = f"{self._broker}: {describe_error(error)}"
            heed_cancellation()
            await asyncio.sleep(REOPEN_S)

    def draw(self) -> None:
        """Show what is known now."""
        now_s = asyncio.get_running_loop().time()
        shown = fleet_rows(self.fleet, now_s)
        top = fleet_headline(shown, self._trouble)
        self.query_one(Banner).show(top, f"{len(shown)} seen", "")
        self._draw_table(shown)
        self._draw_details(now_s)

    def _draw_table(self, shown: list[FleetRow]) -> None:
        """Draw the rows anew where one has changed; the cursor stays with its vehicle."""
        if shown == self._drawn:
            return
        table, at = self._table, self._under_cursor()
        self._drawn = shown
        table.clear()
        for row, one in enumerate(shown):
            style = STYLES[one.urgency]
            table.add_row(
                *(
                    Text(cell, style if i < 2 or style == "dim" else "")
                    for i, cell in enumerate(one.cells)
                )
            )
            if at is not None and one.name == at.name:
                table.move_cursor(row=row, animate=False)

    def _under_cursor(self) -> VehicleView | None:
        at = self._table.cursor_row
        names = [one.name for one in self._drawn[at : at + 1]]
        return next((seen for seen in self.fleet if seen.name in names), None)

    def _draw_details(self, now_s: float) -> None:
        seen = self._under_cursor()
        shot = None if seen is None else seen.snapshot
        chosen = (
            "no vehicle is chosen"
            if seen is None
            else f"{seen.name}: {seen.headline(now_s).big.upper()}"
        )
        if shot is not None and shot.reason:
            chosen += f" - {printable(shot.reason)}"
        self.query_one("#chosen", Static).update(Text(chosen))
        numbers, events = self.query_one(Numbers), self.query_one(Events)
        numbers.display = events.display = shot is not None
        if seen is not None and shot is not None:
            numbers.show(shot, stale=seen.age_s(now_s) > SILENCE_S)
            events.show(shot.events)
