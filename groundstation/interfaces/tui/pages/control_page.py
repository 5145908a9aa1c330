"""The page of the control law: its errors, V against its bound, and the gains."""

from collections.abc import Mapping
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.message import Message
from textual.widgets import DataTable, Static

from groundstation.core.messages import Snapshot
from groundstation.interfaces.tui.pages.page import Frame, Page
from groundstation.interfaces.tui.parts import (
    AXES,
    ERROR,
    LABEL,
    WARNING,
    Curves,
    Gain,
    Spans,
    content,
    gains,
    row,
    three,
)
from links.core import printable


class ControlPage(Page):
    """Control."""

    _shown: tuple[Gain, ...] = ()

    class Chosen(Message):
        """A gain shall be changed."""

        def __init__(self, gain: Gain) -> None:
            """This one."""
            super().__init__()
            self.gain = gain

    NAME: ClassVar[str] = "Control"
    DEFAULT_CSS = """
    ControlPage #body { height: 1fr; }
    ControlPage #left { width: 1fr; padding: 0 1 0 0; }
    ControlPage #right { width: 34; }
    ControlPage #law { height: auto; }
    ControlPage DataTable { height: 1fr; }
    """

    def matter(self) -> ComposeResult:
        """Errors and V beside the gains."""
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield Static(id="law")
                yield Curves("", [("|z1| m", AXES[0]), ("|z2| m/s", AXES[1]), ("|z3| m/s²", AXES[2])], 0.01)
                yield Curves("", [("V", ERROR)], 0.001)
            with Vertical(id="right"):
                table: DataTable[str] = DataTable(cursor_type="row", zebra_stripes=True)
                table.add_columns("gain", "now", "begun with")
                yield table

    def draw(self, frame: Frame) -> None:
        """All of it."""
        picture = frame.picture
        if picture.newest is not None:
            self.query_one("#law", Static).update(content(law(picture.newest), self.query_one("#left").size.width - 1))
            self._gains(picture.config(), picture.newest.gains)
        errors, v = self.query(Curves)
        errors.show([[one.errors[i] for one in picture.flown] for i in range(3)])
        v.show([[one.v for one in picture.flown]])

    def _gains(self, config: Mapping[str, object], now: Mapping[str, float]) -> None:
        known = gains(config, now)
        if tuple(known) == self._shown:
            return
        self._shown = tuple(known)
        table = self.query_one(DataTable)
        at = table.cursor_row
        table.clear()
        for gain in known:
            name = gain.key.removeprefix("controller.")
            table.add_row(Text(printable(name)), f"{gain.value:.4g}", f"{gain.begun:.4g}", key=gain.key)
        table.move_cursor(row=at)

    def on_data_table_row_selected(self, event: "DataTable.RowSelected") -> None:
        """Change this one."""
        self.post_message(self.Chosen(next(one for one in self._shown if one.key == event.row_key.value)))


def law(snapshot: Snapshot) -> list[Spans]:
    """Errors, V with its terms, W, and what is promised of them."""
    d, seen = snapshot.diagnostics, snapshot.certificate
    if d is None:
        return [[("no control law runs", LABEL)]]
    rows: list[Spans] = [[("              north     east     down", LABEL)]]
    rows += [row(name, f"{three(z)} {unit}") for name, z, unit in (("z1", d.z1, "m"), ("z2", d.z2, "m/s"))]
    rows += [row("z3", f"{three(d.z3)} m/s²"), row("u*", f"{three(d.u_star)} m/s²")]
    rows += [row("b̂ rate", f"{three(d.b_hat_dot)} m/s³")]
    v, w = d.v_terms, d.w_terms
    rows.append(row("V known", f"{d.v_known:.4g} = φ {v[0]:.3g} + Ω {v[1]:.3g} + z3 {v[2]:.3g}"))
    rows.append(row("W", f"{d.w:.4g} = σ {w[0]:.3g} + ρ {w[1]:.3g} + z3 {w[2]:.3g}"))
    if seen is None:
        return [*rows, row("bound", printable(d.certificate))]
    bad = seen.state == "violated"
    shares = f"violated {_share(seen.violated_fraction)}  suspended {_share(seen.suspended_fraction)} of the time"
    excess = f"{seen.state}{'!' if bad else ''}, {seen.excess:.3g} above its bound"
    rows += [row("V", f"{seen.v:.4g}  {printable(excess)}", WARNING if bad else ""), row("", shares)]
    fraction = "-" if seen.b_hat_fraction is None else f"{100.0 * seen.b_hat_fraction:.0f} % of what it may be"
    return [*rows, row("b̂", fraction), row("bound", printable(seen.bound))]


def _share(fraction: float) -> str:
    return f"{100.0 * fraction:.1f} %" if fraction >= 0.0 else "?"
