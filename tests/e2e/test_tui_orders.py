"""Orders that leave a dashboard: each by its key, from every page, and no other."""

from pathlib import Path

import pytest
from textual.command import CommandPalette
from textual.pilot import Pilot
from textual.screen import ModalScreen
from textual.widgets import Input

from groundstation.core.messages import Ask
from groundstation.interfaces.api.client import StopReport
from groundstation.interfaces.tui import app as ordering, model as feed
from groundstation.interfaces.tui.app import Dashboard
from groundstation.interfaces.tui.widgets import Knob, Typed
from tests.dashboards import Fixed, Stage, dashboard, flown, play, says, standing, told, until
from tests.sample_flight import sample

STOPS = [Ask.LAND, Ask.ABORT, Ask.KILL]
STOP_KEYS = ["ctrl+l", "ctrl+x", "ctrl+k", "ctrl+k"]
SECOND_STOP_KEYS = ["ctrl+d", "ctrl+r", "ctrl+y", "ctrl+y"]


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that is busy may take long from one key to the next."""
    monkeypatch.setattr(feed, "TWICE_S", 20.0)


def knows(pilot: Pilot[None]) -> bool:
    app = pilot.app
    assert isinstance(app, Dashboard)
    return app.picture.newest is not None


async def in_control(pilot: Pilot[None]) -> None:
    app = pilot.app
    assert isinstance(app, Dashboard)
    await until(pilot, lambda: knows(pilot))
    await pilot.press("c")
    await until(pilot, lambda: app.picture.holder.yours)


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    stage = Stage(tmp_path / "mqx.sock", beats=True)
    stage.latest.put(sample(10.0))
    return stage


@dashboard()
async def test_ctrl_c_tells_the_key_that_lands(pilot: Pilot[None], stage: Stage) -> None:
    async with stage.up():
        await until(pilot, lambda: knows(pilot))
        await pilot.press("ctrl+c")
        await until(pilot, lambda: told(pilot, "Ctrl-L lands"))
        assert stage.asked == []


@pytest.mark.parametrize("size", [(120, 36), (48, 12)])
def test_what_brings_the_vehicle_down_shows_the_key_that_no_multiplexer_takes(
    size: tuple[int, int],
) -> None:
    async def scene(pilot: Pilot[None]) -> None:
        await pilot.pause(0.2)
        knobs = [knob for knob in pilot.app.screen.query(Knob) if knob.order.always]
        shown = [str(knob.render()).rpartition("^")[2] for knob in knobs]
        assert shown == ["D LAND", "E LAND ALL", "R ABORT", "Y×2 KILL"]
        assert all(knob.region.right <= size[0] for knob in pilot.app.screen.query(Knob))

    play(scene, Fixed(flown(3.0)), size=size)


@pytest.mark.usefixtures("patient")
def test_stops_leave_at_once_from_every_page_and_dialog(stage: Stage) -> None:
    pages: list[list[str]] = [[], ["2"], ["3"], ["4"], ["5"]]
    dialogs = [["question_mark"], ["escape", "q"], ["escape", "ctrl+p"]]

    async def scene(pilot: Pilot[None]) -> None:
        async with stage.up():
            await until(pilot, lambda: knows(pilot))
            for way in [*pages, *dialogs]:
                await pilot.press(*way)
                if "ctrl+p" in way:
                    await until(pilot, lambda: isinstance(pilot.app.screen, CommandPalette))
                for keys in (
                    (STOP_KEYS, SECOND_STOP_KEYS) if way in dialogs else (SECOND_STOP_KEYS,)
                ):
                    stage.core.asked.clear()
                    await pilot.press(*keys)
                    await until(pilot, lambda: stage.asked == STOPS)
            assert isinstance(pilot.app.screen, CommandPalette)

    play(scene, stage.path)


@pytest.mark.parametrize("key", ["ctrl+a", "ctrl+e", "click"])
def test_one_key_lands_every_vehicle(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, key: str
) -> None:
    asked = list[Ask]()

    async def stop_all(ask: Ask, why: str) -> list[StopReport]:
        asked.append(ask)
        return [StopReport(True, "ant: landing"), StopReport(False, f"bee: NOT ANSWERED ({why})")]

    monkeypatch.setattr(ordering, "stop_all", stop_all)
    stage.latest.put(standing())

    async def scene(pilot: Pilot[None]) -> None:
        async with stage.up():
            await in_control(pilot)
            await pilot.press("a", "m", "q")
            await until(pilot, lambda: isinstance(pilot.app.screen, Typed))
            if key == "click":
                (knob,) = (knob for knob in pilot.app.screen.query(Knob) if knob.order.everywhere)
                await pilot.click(knob)
            else:
                await pilot.press(key)
            await until(pilot, lambda: (stage.asked, asked) == ([Ask.LAND], [Ask.LAND]))
            await until(pilot, lambda: told(pilot, "bee: NOT ANSWERED (stop-all from a dashboard)"))

    play(scene, stage.path)


def test_a_dashboard_in_a_multiplexer_says_that_it_takes_keys(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("STY", "7.lab")

    async def scene(pilot: Pilot[None]) -> None:
        await until(pilot, lambda: told(pilot, "GNU screen ($STY) takes some keys"))

    play(scene, Fixed(flown(1.0)))


@dashboard()
async def test_letters_that_are_typed_order_nothing(pilot: Pilot[None], stage: Stage) -> None:
    stage.latest.put(standing())
    async with stage.up():
        await in_control(pilot)
        await pilot.press("a")
        await until(pilot, lambda: isinstance(pilot.app.screen, Typed))
        await pilot.press(*"hrtack")
        await pilot.pause(0.1)
        assert pilot.app.screen.query_one(Input).value == "hrtack"
        await pilot.press("escape")
        assert stage.asked == []


@dashboard()
async def test_neither_one_press_nor_a_late_second_one_kills(
    pilot: Pilot[None], stage: Stage
) -> None:
    async with stage.up():
        await until(pilot, lambda: knows(pilot))
        await pilot.press("ctrl+k")
        knob = pilot.app.screen.query(Knob).filter(".kill").first()
        assert "AGAIN" in str(knob.render())
        await pilot.pause(1.3)
        assert "AGAIN" not in str(knob.render())
        await pilot.press("ctrl+k")
        await pilot.pause(0.2)
        assert stage.asked == []
        await pilot.press("ctrl+k")
        await until(pilot, lambda: stage.asked == [Ask.KILL])


@dashboard()
async def test_arming_asks_for_the_name_and_for_no_other(pilot: Pilot[None], stage: Stage) -> None:
    stage.latest.put(standing())
    async with stage.up():
        await in_control(pilot)
        await pilot.press("a", *"mqy", "enter")
        await until(pilot, lambda: isinstance(pilot.app.screen, Typed))
        # It is not typed onto.
        await until(pilot, lambda: not pilot.app.screen.query_one(Input).value)
        await pilot.press("escape")
        await pilot.pause(0.1)
        await pilot.press("a", *"mq", "escape", "a")
        await pilot.pause(0.1)
        await pilot.press("enter")
        await pilot.pause(0.1)
        assert stage.asked == []
        await pilot.press(*"mqx", "enter")
        await until(pilot, lambda: stage.asked == [Ask.ARM])
        await until(pilot, lambda: told(pilot, "arm"))


@dashboard()
async def test_flying_the_trajectory_asks_once_more_and_enter_alone_means_no(
    pilot: Pilot[None], stage: Stage
) -> None:
    stage.latest.put(sample(1.0, state="hold"))
    async with stage.up():
        await in_control(pilot)
        await pilot.press("t")
        await until(pilot, lambda: isinstance(pilot.app.screen, ModalScreen))
        await pilot.press("enter")
        await until(pilot, lambda: not isinstance(pilot.app.screen, ModalScreen))
        await pilot.press("t")
        await until(pilot, lambda: isinstance(pilot.app.screen, ModalScreen))
        assert stage.asked == []
        await pilot.press("down", "enter")
        await until(pilot, lambda: stage.asked == [Ask.TRACK])


@dashboard()
async def test_what_needs_control_is_asked_with_it_alone(pilot: Pilot[None], stage: Stage) -> None:
    stage.latest.put(standing())
    async with stage.up():
        await until(pilot, lambda: knows(pilot))
        await pilot.press("a")
        await until(pilot, lambda: told(pilot, "take control first"))
        await pilot.press("h")
        await until(pilot, lambda: told(pilot, "needs control"))
        assert stage.asked == []
        await in_control(pilot)
        await pilot.press("h")
        await until(pilot, lambda: told(pilot, "hold is not possible while landing"))
        await pilot.press("c")
        await until(pilot, lambda: told(pilot, "nobody holds control now"))


@dashboard()
async def test_a_gain_is_changed_and_what_is_no_number_changes_none(
    pilot: Pilot[None], stage: Stage
) -> None:
    async with stage.up():
        await in_control(pilot)
        await pilot.press("2")
        await until(pilot, lambda: bool(pilot.app.screen.query("DataTable")))
        await pilot.pause(0.4)
        pilot.app.screen.query_one("DataTable").focus()
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(pilot.app.screen, Typed))
        await pilot.press("backspace", *"2x", "enter")
        await until(pilot, lambda: told(pilot, "'2x' is no number"))
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(pilot.app.screen, Typed))
        await pilot.press("backspace", *"2.5", "enter")
        await until(pilot, lambda: stage.core.gains == {"controller.k2": 2.5})


@dashboard(read_only=True)
async def test_a_screen_that_may_only_look_orders_nothing(pilot: Pilot[None], stage: Stage) -> None:
    async with stage.up():
        await until(pilot, lambda: knows(pilot))
        await pilot.press("c", "a", "t", "h", "r", "ctrl+l", "ctrl+x", "ctrl+k", "ctrl+k")
        await until(pilot, lambda: told(pilot, "NOTHING WAS ORDERED"))  # for some seconds
        await pilot.press("ctrl+p", *"land", "enter")
        await pilot.pause(0.5)
        await pilot.press("escape")
        assert not pilot.app.screen.query(Knob)
        assert (stage.asked, stage.core.notes) == ([], [])


@pytest.mark.usefixtures("patient")
@dashboard()
async def test_what_is_ordered_while_nobody_is_there_is_not_ordered_later(
    pilot: Pilot[None], stage: Stage
) -> None:
    await pilot.press("ctrl+x", "ctrl+k", "ctrl+k")
    await until(pilot, lambda: told(pilot, "NOT SENT"))
    async with stage.up():
        await until(pilot, lambda: says(pilot, "tracking"))
        await pilot.pause(0.3)
        assert stage.asked == []


@dashboard()
async def test_what_starts_or_steers_is_not_ordered_by_what_is_old(
    pilot: Pilot[None], stage: Stage
) -> None:
    """A core that hangs would find it in its socket later."""
    stage.latest.put(standing())
    async with stage.up():
        await in_control(pilot)
        await until(pilot, lambda: says(pilot, "ready"))
        stage.beats = False
        await until(pilot, lambda: says(pilot, "NO DATA"))
        await pilot.press("a", "h", "r", "t")
        await until(pilot, lambda: told(pilot, "what is shown is old"))
        assert not isinstance(pilot.app.screen, Typed)
        assert stage.asked == []


def test_leaving_in_the_air_asks_and_says_how_to_come_back(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def scene(pilot: Pilot[None]) -> None:
        await until(pilot, lambda: knows(pilot))
        await pilot.press("q")
        await until(pilot, lambda: isinstance(pilot.app.screen, ModalScreen))
        await pilot.press("enter")
        await pilot.pause(0.1)
        assert pilot.app.is_running
        await pilot.press("q")
        await until(pilot, lambda: isinstance(pilot.app.screen, ModalScreen))
        await pilot.press("down", "enter")
        await until(pilot, lambda: not pilot.app.is_running)
        goodbye = str(pilot.app._exit_renderables)
        assert "goes on" in goodbye
        assert "groundstation request land --vehicle mqx" in goodbye

    play(scene, Fixed(flown(3.0)))
