"""The dashboard: what it shows of a served flight, and the whole program in a real terminal."""

import asyncio
import contextlib
import math
import shlex
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import msgspec
import pytest
from textual.pilot import Pilot
from textual.widgets import Static
from textual.widgets._footer import FooterKey

from groundstation.config import ConfigError
from groundstation.interfaces.tui.app import served_socket
from groundstation.interfaces.tui.drawing import big
from groundstation.interfaces.tui.widgets import Banner, Curves, Events, Help, Numbers, TopView
from tests.dashboards import Fixed, Stage, dashboard, flown, play, says, text, until
from tests.e2e.stations import beside, program, wait_until
from tests.sample_flight import sample


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    return Stage(tmp_path / "mqx.sock")


def test_every_key_is_explained_in_full_on_a_narrow_terminal(stage: Stage) -> None:
    async def scene(pilot: Pilot[None]) -> None:
        await pilot.press("question_mark")
        await until(pilot, lambda: isinstance(pilot.app.screen, Help))
        await pilot.pause(0.2)
        shown = [row for row in pilot.app.screen.query(".says") if isinstance(row, Static)]
        assert len(shown) > 8
        for row in shown:
            assert row.parent is not None
            assert row.region.width <= pilot.app.screen.query_one("#box").size.width - 11
            assert row.size.height * row.size.width >= len(str(row.content))

    play(scene, stage.path, size=(60, 24))


@pytest.mark.tried(1)  # sizes
@pytest.mark.parametrize("size", [(80, 24), (30, 8)])
def test_nothing_is_drawn_outside_a_terminal_of_any_size(size: tuple[int, int]) -> None:
    async def scene(pilot: Pilot[None]) -> None:
        await until(pilot, lambda: "10.0 s" in text(pilot, Banner) or size[0] < 40)
        await pilot.pause(0.3)
        for key in "12345":
            await pilot.press(key)
            await pilot.pause(0.05)
        await pilot.press("1")
        for part in (Banner, TopView, Curves, Numbers, Events):
            widget = pilot.app.screen.query(part).first()
            rows = text(pilot, part).split("\n")
            assert max(map(len, rows)) <= widget.size.width + 2  # two hats take no room
            if size == (80, 24):
                assert len(rows) <= max(1, widget.size.height), part

    play(scene, Fixed(flown(10.0)), size)


@dashboard()
async def test_no_data_is_said_until_the_core_comes_back(pilot: Pilot[None], stage: Stage) -> None:
    await until(pilot, lambda: says(pilot, "NO DATA"))
    await until(pilot, lambda: "no ground station" in text(pilot, Banner).replace("\n", " "))
    async with stage.up():
        stage.latest.put(sample(1.0))
        await until(pilot, lambda: says(pilot, "tracking"))
    await until(pilot, lambda: says(pilot, "NO DATA"))
    assert pilot.app.screen.has_class("alarm")
    assert "it was tracking" in " ".join(text(pilot, Banner).split())
    async with stage.up():
        stage.latest.put(sample(2.0))
        await until(pilot, lambda: says(pilot, "tracking"))


@dashboard(size=(160, 40))
async def test_something_else_at_the_socket_is_told_and_does_not_end_the_screen(
    pilot: Pilot[None], stage: Stage
) -> None:
    async def say(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"hello\n")
        writer.close()

    server = await asyncio.start_unix_server(say, stage.path)
    await until(pilot, lambda: "not a ground" in " ".join(text(pilot, Banner).split()))
    server.close()


def test_without_a_flight_it_says_how_to_start_one(
    short_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_path))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    folder = short_path / "groundstation"
    folder.mkdir(mode=0o700)
    says = r"nobody flies a vehicle here.*`groundstation fly CONFIG --tui` starts one"
    with pytest.raises(ConfigError, match=says):
        served_socket(None)
    assert served_socket("mqx") == folder / "mqx.sock"  # it may come up yet


class Terminal:
    """A real terminal of 80 x 24, in a tmux of our own."""

    def __init__(self, tmux: str, folder: Path) -> None:
        self.program = tmux
        self._tmux = [tmux, "-S", str(folder / "tmux")]
        self.attach = ("env", "-u", "TMUX", *self._tmux, "attach")
        """Words that show it in another terminal."""

    def _do(self, *command: str) -> str:
        return subprocess.run(
            [*self._tmux, *command], check=True, capture_output=True, text=True, timeout=60
        ).stdout

    def start(self, *words: str | Path, environment: Mapping[str, str] = {}) -> None:
        command = shlex.join(map(str, words))
        settings = [
            word for name, value in environment.items() for word in ("-e", f"{name}={value}")
        ]
        self._do(
            "-f", "/dev/null", "new-session", "-d", "-x", "80", "-y", "24", *settings,
            f"{command}; echo left with $?; sleep 60",
        )  # fmt: skip

    def set(self, option: str, value: str) -> None:
        self._do("set-option", "-g", option, value)

    def type(self, keys: str) -> None:
        self._do("send-keys", keys)

    def paste(self, data: bytes) -> None:
        """Have it typed as it is, without the marks of a paste."""
        subprocess.run([*self._tmux, "load-buffer", "-"], input=data, check=True, timeout=60)
        self._do("paste-buffer", "-r")

    def wait_for(self, *rows: str) -> str:
        # tmux tells no blanks at the end of a line.
        wait_until(lambda: all(row.rstrip() in self.screen() for row in rows), self.screen)
        return self.screen()

    def screen(self) -> str:
        return self._do("capture-pane", "-p")

    def close(self) -> None:
        subprocess.run([*self._tmux, "kill-server"], check=False, capture_output=True)


@pytest.fixture
def terminal(needs_program: Callable[..., str], tmp_path: Path) -> Iterator[Terminal]:
    made = Terminal(needs_program("tmux"), tmp_path)
    yield made
    made.close()


def core_at(path: Path, **more: Any) -> AbstractContextManager["subprocess.Popen[str]"]:
    """The core of the made-up flight, whose socket is at ``path``."""
    return beside(program("tests.sample_flight", path), **more)


def test_the_screen_in_a_terminal_follows_a_core_that_dies_and_comes_back(
    terminal: Terminal, tmp_path: Path
) -> None:
    path, flying = tmp_path / "mqx.sock", big("tracking")
    with core_at(path) as first:
        terminal.start(*program("groundstation", "tui", "--socket", path))
        screen = terminal.wait_for(*flying, "Armed by us", "following the trajectory", "age 12 ms")
        assert all(len(line.replace("\u0302", "")) <= 80 for line in screen.splitlines())
        first.kill()
        first.wait()
        terminal.wait_for(*big("no data"), "since 3 s")
    with core_at(path):
        terminal.wait_for(*flying, "Armed by us")
        terminal.type("q")
        terminal.wait_for("Leave?")
        terminal.type("Down")
        terminal.type("Enter")
        terminal.wait_for("left with 0", "groundstation request land --socket")


@contextlib.contextmanager
def orders_shown(terminal: Terminal, folder: Path) -> Iterator[Path]:
    """The dashboard in ``terminal``, and the file of the orders that left it, one a line."""
    path, asked = folder / "mqx.sock", folder / "asked"
    with asked.open("wb") as output, core_at(path, stdout=output):
        terminal.start(*program("groundstation", "tui", "--socket", path))
        terminal.wait_for(*big("tracking"))
        yield asked


def wait_for_order(asked: Path, order: str) -> None:
    wait_until(lambda: order in asked.read_text().split(), asked.read_text)


@pytest.mark.parametrize(
    ("taken", "free", "order"), [("C-a", "C-e", "land"), ("C-y", "C-k", "kill")]
)
def test_where_a_multiplexer_takes_one_key_of_an_emergency_order_the_other_one_orders_it(
    terminal: Terminal, tmp_path: Path, taken: str, free: str, order: str
) -> None:
    with orders_shown(terminal, tmp_path) as asked, multiplexed(terminal, tmp_path, taken) as outer:
        for _ in range(2):
            outer.type(taken)
            outer.type("Escape")  # the prefix, and a key that it has no command for
        time.sleep(0.3)
        assert asked.read_text() == ""
        outer.type(free)
        outer.type(free)
        wait_for_order(asked, order)


@contextlib.contextmanager
def multiplexed(inner: Terminal, folder: Path, prefix: str) -> Iterator[Terminal]:
    """Another terminal that shows ``inner``; its keys come by a tmux with that prefix."""
    folder = folder / "outer"
    folder.mkdir()
    outer = Terminal(inner.program, folder)
    inner.set("prefix", prefix)
    try:
        outer.start(*inner.attach)
        outer.wait_for("LAND ALL")
        yield outer
    finally:
        outer.close()


def test_a_paste_orders_nothing_and_the_kill_key_works_after_it(
    terminal: Terminal, tmp_path: Path
) -> None:
    with orders_shown(terminal, tmp_path) as asked:
        terminal.paste(b"a stray paste\nq\x0c\x18\x01\x0b\x0b of a text")
        terminal.wait_for("keys dropped: a paste?")
        assert asked.read_text() == ""
        terminal.paste(b"\x0b\x0b")
        wait_for_order(asked, "kill")
        assert set(asked.read_text().split()) == {"kill"}


@pytest.mark.parametrize("columns", [60, 200])
def test_at_every_width_the_banner_the_numbers_and_the_way_out_are_whole(columns: int) -> None:
    dropped = {"late (older as it came than a command may rest on)": 1234}
    link = msgspec.structs.replace(
        sample(1.0).link, state="connected", sent=1234567, expired=123, dropped=dropped,
        battery_v=15.52,
        battery_share=1.0, rtt_s=0.1121,
    )  # fmt: skip
    turned = (0.0, 0.3826834, 0.0, 0.9238795)

    async def scene(pilot: Pilot[None]) -> None:
        await until(pilot, lambda: "10.0 s" in text(pilot, Banner))
        await pilot.pause(0.3)
        assert "…" not in text(pilot, Numbers) + text(pilot, Banner)
        assert text(pilot, Numbers).count("drops 1234") == 2 and "rms -" in text(pilot, Numbers)
        assert "control is free: c takes it" in text(pilot, Banner)
        keys = [key for key in pilot.app.screen.query(FooterKey) if key.region.right <= columns]
        footer = [str(key.render()) for key in keys]
        assert columns < 80 or any("quit" in key for key in footer)

    more = {"poses_dropped": dropped, "link": link, "attitude": turned, "rms_m": math.nan}
    play(scene, Fixed(flown(10.0, **more)), (columns, 24))
