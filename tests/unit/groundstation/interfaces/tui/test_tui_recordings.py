"""Recordings on the dashboard: what is read of them, and how they are played."""

import asyncio
import math
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import pytest

from groundstation.core.messages import Ask, Snapshot
from groundstation.interfaces.tui import app
from groundstation.interfaces.tui.app import Playback, Tape, open_playback
from groundstation.interfaces.tui.model import FRAME_S, FlightIdentity, Jump, News
from groundstation.machine import note_stop
from groundstation.settings import Config
from sim.time import VirtualTimeLoop
from tests.recordings import recorded
from tests.sample_flight import sample

HELLO = FlightIdentity("mqx", "recording a.mcap", "")


@pytest.fixture
def flight() -> Path:
    return recorded()[0]


def test_a_recording_becomes_five_snapshots_a_second(flight: Path) -> None:
    tape = Tape(flight)
    shown = list(tape.snapshots())
    assert tape.hello.vehicle == "mqx"
    steps = [b.time_s - a.time_s for a, b in zip(shown, shown[1:], strict=False)]
    assert min(steps[:-1]) >= 0.999 * FRAME_S
    assert max(steps) < 1.5 * FRAME_S


def test_they_hold_what_was_flown(flight: Path) -> None:
    last = [one for one in Tape(flight).snapshots() if one.state == "tracking"][-1]
    assert math.dist(last.position_ned, last.reference_ned) == pytest.approx(last.error_m)
    assert math.dist(last.position_ned, (0.0, 0.0, 0.0)) > 0.1
    assert last.thrust_max_n == 1.37
    assert last.pose_rate_hz == pytest.approx(50.0, abs=1.0)
    assert last.link.state == "armed"
    assert last.link.sent > 100
    assert last.diagnostics is not None
    assert sum(last.diagnostics.v_terms) == pytest.approx(last.diagnostics.v_known)
    assert any("tracking: " in event.line for event in last.events)
    assert last.rms_m == 0.0  # not steady yet
    assert last.gains["controller.k2"] == 2.0


def test_a_recording_that_was_cut_off_is_read_up_to_the_cut(flight: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    whole = flight.read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    assert 0 < len(list(Tape(cut).snapshots())) < len(list(Tape(flight).snapshots()))
    assert open_playback(cut).where().endswith("; it was cut off")


def played(steer: Callable[[Playback], None], seconds: float) -> list[News]:
    """Snapshots of a playback of 60 s in so many seconds, steered first, in virtual time."""

    async def listen() -> list[News]:
        playback = Playback(HELLO, [sample(0.1 * i) for i in range(601)])
        heard: list[News] = []

        async def hear() -> None:
            async for news in playback.news():
                heard.append(news)

        task = asyncio.create_task(hear())
        await asyncio.sleep(0.01)
        steer(playback)
        await asyncio.sleep(seconds)
        task.cancel()
        return heard

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(listen())


def newest(news: list[News]) -> Snapshot:
    return [one for one in news if isinstance(one, Snapshot)][-1]


@pytest.mark.parametrize(
    ("keys", "at_s"),
    [
        ([], 4.0),
        (["faster"], 8.0),
        (["faster"] * 9, 60.0),
        (["slower", "slower", "slower"], 1.0),
        (["pause"], 0.0),
    ],
)
def test_it_plays_as_fast_as_it_is_told(keys: list[str], at_s: float) -> None:
    def steer(playback: Playback) -> None:
        for key in keys:
            playback.steer(key)

    heard = played(steer, 4.0)
    assert heard[0] == HELLO
    assert newest(heard).flight_time_s == pytest.approx(at_s, abs=0.25)


def test_winding_shows_what_came_before_too() -> None:
    heard = played(lambda playback: playback.seek(30.0), 0.5)
    after = heard[heard.index(Jump()) + 1 :]
    times = [one.flight_time_s for one in after if isinstance(one, Snapshot)]
    assert times[0] == 0.0
    assert times == sorted(times)
    assert times[-1] == pytest.approx(30.4, abs=0.2)


def test_a_recording_can_not_be_asked_for_anything() -> None:
    playback = Playback(HELLO, [])
    assert not asyncio.run(playback.ask(Ask.KILL, "")).done
    assert not asyncio.run(playback.control(take=True)).done
    assert not asyncio.run(playback.set_gain("controller.k2", 1.0)).done


def test_a_screen_begins_no_station_once_all_were_ordered_to_land(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(app, "require_terminal", lambda instead: None)
    monkeypatch.setattr(app, "_start_station", Mock(side_effect=AssertionError("it begins")))
    note_stop()
    assert app.fly_with_screen(Namespace(), Config()) == 1
