"""All vehicles at a broker on one screen, read-only: a process of its own, which no station knows of."""

import asyncio
from typing import ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import BindingType
from textual.widgets import DataTable, Footer, Static

from groundstation.interfaces.mqtt import EVENT as EVENT_TOPIC
from groundstation.interfaces.mqtt import SNAPSHOT, STATE, Broker, Fleet, Seen, heed_cancellation, in_words
from groundstation.interfaces.tui.fleet_rows import COLUMNS, EVENT, ORDERS, Row, details, headline, rows
from groundstation.interfaces.tui.parts import ALARM, BUSY, CALM, FLYING, big

FRAME_S = 0.5
"""Time between two drawings [s]."""
RETRY_S = 1.0
"""Time between two tries to connect [s]."""
HEARD_QUEUE = 5000
STYLES = {ALARM: "bold white on dark_red", FLYING: "bold", BUSY: "bold", CALM: ""}


def run_fleet(broker: Broker) -> int:
    """Show all vehicles at ``broker`` until the operator quits; returns the exit code."""
    screen = FleetScreen(broker)
    screen.run()
    return screen.return_code or 0


class FleetScreen(App[None]):
    """A table; q leaves, s sorts, and the vehicle under the cursor is told of below."""

    CSS = """
    #banner { height: 4; padding: 0 1; }
    DataTable { height: 1fr; min-height: 6; scrollbar-size-horizontal: 0; }
    #details {
        height: 33%; min-height: 7; max-height: 24; border-top: solid $primary; padding: 0 1;
        text-wrap: nowrap; text-overflow: ellipsis;
    }
    """
    BINDINGS: ClassVar[list[BindingType]] = [("q", "quit", "quit"), ("s", "sort", "sort")]
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, broker: Broker) -> None:
        """Connect to ``broker`` as soon as the screen is up."""
        super().__init__()
        self._broker = broker
        self.fleet = Fleet(broker.config.prefix)
        """What is known."""
        self._order = next(iter(ORDERS))
        self._trouble = f"connecting to {broker}"
        self._drawn: list[Row] = []

    def compose(self) -> ComposeResult:
        """Banner, table, details."""
        yield Static(id="banner")
        yield DataTable(cursor_type="row", zebra_stripes=True, cell_padding=0)
        yield Static(id="details")
        yield Footer()

    def on_mount(self) -> None:
        """Begin to read and to draw."""
        table = self._table
        for heading, width in COLUMNS:
            table.add_column(heading, width=width, key=heading)
        table.add_column(EVENT, key=EVENT)
        table.focus()
        self.run_worker(self._watch())
        self.set_interval(FRAME_S, self.draw)

    def action_sort(self) -> None:
        """Sort by the next order."""
        names = list(ORDERS)
        self._order = names[(names.index(self._order) + 1) % len(names)]
        self.draw()

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
        wanted = [(f"{root}/+/{topic.name}", topic.quality) for topic in (STATE, SNAPSHOT, EVENT_TOPIC)]
        while True:
            try:
                async with self._broker.client(max_queued_incoming_messages=HEARD_QUEUE) as client:
                    await client.subscribe(wanted)
                    heed_cancellation()
                    self._trouble = ""
                    async for message in client.messages:
                        self.fleet.hear(str(message.topic), message.payload, loop.time())
            except (aiomqtt.MqttError, ValueError) as error:  # ValueError: no possible host name
                self._trouble = f"{self._broker}: {in_words(error)}"
            heed_cancellation()
            await asyncio.sleep(RETRY_S)

    def draw(self) -> None:
        """Show what is known now."""
        now_s = asyncio.get_running_loop().time()
        shown = rows(self.fleet, self._order, now_s)
        top = headline(shown, self._trouble)
        banner = Text(no_wrap=True, overflow="crop")
        banner.append("\n".join(f" {line} " for line in big(top.big)), style=STYLES[top.tone])
        banner.append(f"\n{top.detail}; sorted by {self._order}")
        self.query_one("#banner", Static).update(banner)
        self._draw_table(shown)
        self._draw_details(now_s)

    def _draw_table(self, shown: list[Row]) -> None:
        """Change the cells that have changed; begin anew where the rows are others."""
        table = self._table
        if [one.name for one in shown] != [one.name for one in self._drawn]:
            at = self._under_cursor()
            table.clear()
            for one in shown:
                table.add_row(*self._cells(one), key=one.name)
            names = [one.name for one in shown]
            if at is not None and at.name in names:
                table.move_cursor(row=names.index(at.name), animate=False)
        else:
            headings = [*(heading for heading, _ in COLUMNS), EVENT]
            for old, new in zip(self._drawn, shown, strict=True):
                if old == new:
                    continue
                for heading, before, after, cell in zip(headings, old.cells, new.cells, self._cells(new), strict=True):
                    if before != after or old.urgency != new.urgency:
                        table.update_cell(new.name, heading, cell)
        self._drawn = shown

    def _cells(self, one: Row) -> list[Text]:
        style = STYLES[(ALARM, FLYING, CALM, CALM)[one.urgency]] or ("dim" if one.urgency == 3 else "")
        return [Text(cell, style=style if i < 2 or one.urgency == 3 else "") for i, cell in enumerate(one.cells)]

    def _under_cursor(self) -> Seen | None:
        at = self._table.cursor_row
        names = [one.name for one in self._drawn[at : at + 1]]
        return next((seen for seen in self.fleet if seen.name in names), None)

    def _draw_details(self, now_s: float) -> None:
        seen = self._under_cursor()
        lines = ["no vehicle is chosen"] if seen is None else details(seen, now_s)
        self.query_one("#details", Static).update(Text("\n".join(lines)))
