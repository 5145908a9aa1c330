"""The live screen: its widgets on a status socket, and the whole program in a real terminal."""

import asyncio
import contextlib
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from textual.pilot import Pilot
from textual.widget import Widget

from groundstation.api.place import StatusConfig
from groundstation.api.server import Server
from groundstation.broadcast import Latest
from groundstation.snapshot import Snapshot
from groundstation.tui.app import StatusScreen
from groundstation.tui.letters import big
from groundstation.tui.panels import Banner, ErrorHistory, Events, Numbers, TopView
from tests.sample_flight import Sampled, sample


@contextlib.asynccontextmanager
async def served(path: Path, latest: Latest[Snapshot]) -> AsyncIterator[None]:
    task = asyncio.create_task(Server(StatusConfig(path=str(path), rate_hz=50.0), "mqx", latest, Sampled()).serve())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def text(pilot: Pilot[None], part: type[Widget]) -> str:
    return str(pilot.app.query_one(part).render())


def says(pilot: Pilot[None], words: str) -> bool:
    return all(row in text(pilot, Banner) for row in big(words))


async def until(pilot: Pilot[None], true: Callable[[], bool]) -> None:
    async with asyncio.timeout(20.0):
        while not true():
            await pilot.pause(0.02)


def play(
    scene: Callable[[Pilot[None]], Coroutine[Any, Any, None]], path: Path, size: tuple[int, int] = (80, 24)
) -> None:
    async def with_screen() -> None:
        async with StatusScreen(path).run_test(size=size) as pilot:
            await scene(pilot)

    asyncio.run(with_screen())


def test_every_part_shows_the_newest_snapshot(tmp_path: Path) -> None:
    path = tmp_path / "mqx.sock"

    async def scene(pilot: Pilot[None]) -> None:
        latest: Latest[Snapshot] = Latest()
        async with served(path, latest):
            latest.put(sample(10.0))
            await until(pilot, lambda: says(pilot, "tracking"))
            latest.put(sample(11.0))
            await until(pilot, lambda: "11.0 s" in text(pilot, Banner))
            await pilot.pause(0.3)
            assert "following the trajectory" in text(pilot, Banner)
            north, east, down = sample(11.0).position_ned
            assert f"{north:+.3f}   {east:+.3f}   {-down:+.3f} m" in text(pilot, Numbers)
            for words in ("b̂          +0.100   -0.050   +0.200", "d̂          +0.110", "age 12 ms  50 Hz  drops 3"):
                assert words in text(pilot, Numbers)
            for words in ("armed  sent 488  expired 0  drops 1", "Armed by us", "0.70 /1.37 N"):
                assert words in text(pilot, Numbers)
            assert "●" in text(pilot, TopView)
            assert "█" in text(pilot, ErrorHistory)
            assert "100.000 tracking: following the trajectory" in text(pilot, Events)

    play(scene, path)


@pytest.mark.parametrize("size", [(80, 24), (200, 60), (30, 8)])
def test_nothing_is_drawn_outside_a_terminal_of_any_size(tmp_path: Path, size: tuple[int, int]) -> None:
    path = tmp_path / "mqx.sock"

    async def scene(pilot: Pilot[None]) -> None:
        latest: Latest[Snapshot] = Latest()
        async with served(path, latest):
            latest.put(sample(10.0))
            await until(pilot, lambda: "10.0 s" in text(pilot, Banner) or size[0] < 40)
            await pilot.pause(0.3)
            for part in (Banner, TopView, ErrorHistory, Numbers, Events):
                widget = pilot.app.query_one(part)
                rows = text(pilot, part).split("\n")
                assert max(map(len, rows)) <= widget.size.width + 2  # two hats take no room
                if size == (80, 24):
                    assert len(rows) <= widget.size.height, part

    play(scene, path, size)


def test_no_data_is_said_in_large_letters_and_goes_away_when_the_core_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "mqx.sock"

    async def scene(pilot: Pilot[None]) -> None:
        await until(pilot, lambda: says(pilot, "NO DATA"))
        await until(pilot, lambda: "No ground station serves" in text(pilot, Banner).replace("\n", " "))
        latest: Latest[Snapshot] = Latest()
        async with served(path, latest):
            latest.put(sample(1.0))
            await until(pilot, lambda: says(pilot, "tracking"))
        await until(pilot, lambda: says(pilot, "NO DATA"))
        assert "it was tracking" in text(pilot, Banner)
        async with served(path, latest):
            latest.put(sample(2.0))
            await until(pilot, lambda: says(pilot, "tracking"))

    play(scene, path)


def test_a_core_that_hangs_with_its_socket_open_is_no_data_too(tmp_path: Path) -> None:
    path = tmp_path / "mqx.sock"

    async def scene(pilot: Pilot[None]) -> None:
        latest: Latest[Snapshot] = Latest()
        async with served(path, latest):
            latest.put(sample(1.0))
            await until(pilot, lambda: says(pilot, "tracking"))
            await until(pilot, lambda: says(pilot, "NO DATA"))
            assert "it was tracking" in text(pilot, Banner)

    play(scene, path)


def test_something_else_at_the_socket_is_told_and_does_not_end_the_screen(tmp_path: Path) -> None:
    path = tmp_path / "mqx.sock"

    async def scene(pilot: Pilot[None]) -> None:
        async def say(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(b"hello\n")
            writer.close()

        server = await asyncio.start_unix_server(say, path)
        await until(pilot, lambda: "no snapshot of this version" in text(pilot, Banner))
        server.close()

    play(scene, path)


def test_a_new_flight_begins_with_empty_plots(tmp_path: Path) -> None:
    path = tmp_path / "mqx.sock"

    async def scene(pilot: Pilot[None]) -> None:
        latest: Latest[Snapshot] = Latest()
        async with served(path, latest):
            for time_s in (50.0, 51.0, 52.0):
                latest.put(sample(time_s))
                await until(pilot, lambda wanted=f"{time_s:.1f} s": wanted in text(pilot, Banner))  # type: ignore[misc]
            assert text(pilot, ErrorHistory).split("\n")[-1].count("█") > 1
            latest.put(msgspec.structs.replace(sample(0.5), error_m=0.01))
            await until(pilot, lambda: text(pilot, ErrorHistory).split("\n")[-1].strip() == "█")

    play(scene, path)


def test_q_leaves(tmp_path: Path) -> None:
    async def scene(pilot: Pilot[None]) -> None:
        await pilot.press("q")
        await pilot.pause(0.1)
        assert not pilot.app.is_running

    play(scene, tmp_path / "mqx.sock")


class Terminal:
    """A real terminal of 80 x 24, in a tmux of our own."""

    def __init__(self, tmux: str, folder: Path) -> None:
        self._tmux = [tmux, "-S", str(folder / "tmux")]

    def _do(self, *command: str) -> str:
        return subprocess.run([*self._tmux, *command], check=True, capture_output=True, text=True, timeout=20).stdout

    def start(self, command: str) -> None:
        self._do(
            "-f", "/dev/null", "new-session", "-d", "-x", "80", "-y", "24", f"{command}; echo left with $?; sleep 60"
        )

    def type(self, keys: str) -> None:
        self._do("send-keys", keys)

    def wait_for(self, *rows: str) -> str:
        screen = ""
        for _ in range(400):
            screen = self._do("capture-pane", "-p")
            if all(row in screen for row in rows):
                return screen
            time.sleep(0.05)
        raise AssertionError(f"{rows} did not appear on:\n{screen}")

    def close(self) -> None:
        subprocess.run([*self._tmux, "kill-server"], check=False, capture_output=True)


@pytest.fixture
def terminal(needs_program: Callable[..., str], tmp_path: Path) -> Iterator[Terminal]:
    made = Terminal(needs_program("tmux"), tmp_path)
    yield made
    made.close()


def test_the_screen_in_a_terminal_follows_a_core_that_dies_and_comes_back(terminal: Terminal, tmp_path: Path) -> None:
    path = tmp_path / "mqx.sock"
    core = [sys.executable, "-m", "tests.sample_flight", str(path)]
    code = f"from pathlib import Path; from groundstation.tui.app import run; raise SystemExit(run(Path('{path}')))"
    flying, no_data = big("tracking"), big("no data")
    with contextlib.ExitStack() as stack:
        first = subprocess.Popen(core)
        stack.callback(first.wait)
        stack.callback(first.kill)
        terminal.start(f'{sys.executable} -c "{code}"')
        screen = terminal.wait_for(*flying, "Armed by us", "following the trajectory", "age 12 ms")
        assert all(len(line) <= 80 for line in screen.splitlines())
        first.kill()
        first.wait()
        terminal.wait_for(*no_data, "since 3 s")
        second = subprocess.Popen(core)
        stack.callback(second.wait)
        stack.callback(second.kill)
        screen = terminal.wait_for(*flying, "Armed by us")
        terminal.type("q")
        terminal.wait_for("left with 0")
