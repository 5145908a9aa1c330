"""The pieces of the screen that are pure functions, and what a fleet view knows of each vehicle."""

import asyncio
import math
from contextlib import suppress

import msgspec
import pytest
from textual.app import App
from textual.css.query import NoMatches
from textual.events import Key

from groundstation.core.messages import Ask, Notice, Snapshot
from groundstation.core.mission import State
from groundstation.interfaces.api import Control
from groundstation.interfaces.tui.drawing import PlotTrack, Spans, number_rows, top_view
from groundstation.interfaces.tui.fleet import (
    SILENCE_S,
    FleetMonitor,
    VehicleView,
    fleet_headline,
    fleet_row,
    fleet_rows,
)
from groundstation.interfaces.tui.model import (
    ALARM,
    BY_ASK,
    ORDERS,
    STOP_KEYS,
    FeedTrouble,
    FlightIdentity,
    Picture,
    Twice,
    headline,
    possible,
)
from groundstation.interfaces.tui.pages import ControlPage, FlyPage, LinksPage, Page, PageFrame
from groundstation.interfaces.tui.widgets import THEMES, Typed
from links.text import printable
from tests.sample_flight import sample


def plain(rows: list[Spans]) -> list[str]:
    return ["".join(text for text, _ in row) for row in rows]


def changed(**more: object) -> Snapshot:
    return msgspec.structs.replace(sample(10.0), **more)


@pytest.mark.parametrize(
    ("point", "third"),
    [((1.0, 0.0), (0, 1)), ((-1.0, 0.0), (2, 1)), ((0.0, 1.0), (1, 2)), ((0.0, -1.0), (1, 0))],
)
def test_north_is_up_and_east_is_to_the_right(
    point: tuple[float, float], third: tuple[int, int]
) -> None:
    drawn, _ = top_view([PlotTrack(points=[(0.0, 0.0), point], style="x", head="o")], 30, 15)
    ((row, line),) = [(row, line) for row, line in enumerate(plain(drawn)) if "o" in line]
    assert (row // 5, line.index("o") // 10) == third


def with_link(flight: str = "tracking", **more: object) -> Snapshot:
    return changed(state=flight, link=msgspec.structs.replace(sample(3.0).link, **more))


@pytest.mark.parametrize(
    ("snapshot", "silent_s", "big"),
    [
        (sample(3.0), 3.2, "NO DATA"),
        (changed(state="landed"), 60.0, "landed"),
        (with_link("aborted", phase="bring_down"), 0.2, "COMING DOWN"),
        (with_link(state="lost"), 0.0, "LINK LOST"),
        (changed(pose_age_s=0.5), 0.0, "NO POSE"),
        (changed(pose_age_s=math.nan), 0.0, "NO POSE"),
        (changed(pose_age_s=0.5, state="ready"), 0.0, "ready"),
    ],
)
def test_silence_a_lost_link_and_old_poses_beat_every_state_but_the_last(
    snapshot: Snapshot, silent_s: float, big: str
) -> None:
    assert headline(snapshot, silent_s, "").big == big


def test_silence_is_told_with_its_time_and_its_reason() -> None:
    assert headline(sample(3.0), 3.2, "").detail == "since 3 s, it was tracking."
    assert headline(None, 3.2, "nobody is there").detail == "since 3 s: nobody is there"
    assert headline(changed(state="aborted"), 60.0, "").tone == ALARM


def test_heights_are_up_from_the_floor_and_errors_in_centimetres() -> None:
    text = "\n".join(plain(number_rows(changed(position_ned=(1.0, -2.0, -1.5), error_m=0.123))))
    assert "position   +1.000   -2.000   +1.500 m" in text
    assert "error     12.3 cm" in text
    text = "\n".join(plain(number_rows(changed(position_ned=(1.0, -2.0, 1.0), floor_z_m=1.0))))
    assert "position   +1.000   -2.000   +0.000 m" in text
    assert {"position  -", "attitude  -"} <= set(plain(number_rows(changed(pose_id=-1))))


def test_a_command_at_its_limit_carries_a_mark() -> None:
    rates = {"rates_rad_s": (1.0, -1.0, 0.5), "rate_limits_rad_s": (1.0, 1.0, 1.0)}
    rows = plain(number_rows(changed(thrust_n=1.37, **rates)))
    marked = [row.rstrip().endswith("!") for row in rows if " N" in row or "°/s" in row]
    assert marked == [True, True, True, False]


def test_a_violated_bound_carries_a_mark_and_a_bound_that_holds_does_not() -> None:
    shown = sample(10.0).certificate
    assert shown is not None and shown.state == "holds"
    held = msgspec.structs.replace(shown, v=0.0213, b_hat_fraction=0.08)
    assert "V         0.0213  holds  b̂ 8 %" in plain(number_rows(changed(certificate=held)))
    violated = msgspec.structs.replace(held, state="violated", excess=3.25, b_hat_fraction=None)
    assert "V         0.0213  violated! by 3.2" in plain(number_rows(changed(certificate=violated)))
    assert "V         -" in plain(number_rows(changed(certificate=None)))


def test_words_from_the_vehicle_cannot_steer_the_terminal() -> None:
    hostile = "\x1b[2J\x07[red]armed[/]\r\n"
    assert printable(hostile) == "·[2J·[red]armed[/]··"
    link = msgspec.structs.replace(
        sample(1.0).link, text=hostile, state=hostile, dropped={hostile: 3}
    )
    assert "\x1b" not in "".join(plain(number_rows(changed(link=link))))


def test_a_kill_takes_two_presses_within_a_second() -> None:
    twice = Twice()
    assert [twice.press(t) for t in (0.0, 1.5, 2.4, 2.6, 3.0)] == [False, False, True, False, True]
    assert not twice.waits(3.1) and not twice.is_held
    assert [twice.press(t) for t in (5.0, 5.001)] == [False, True], "a script is fast"
    assert not twice.is_held


@pytest.mark.parametrize("delay_s", [0.25, 0.5, 0.66])
@pytest.mark.parametrize("apart_s", [0.03, 0.04, 0.091])
def test_a_kill_key_that_is_held_down_is_no_second_press(delay_s: float, apart_s: float) -> None:
    twice = Twice()
    assert not twice.press(10.0)
    twice.press(10.0 + delay_s)  # the keyboard's own first repetition looks like a press
    assert not any(twice.press(10.0 + delay_s + apart_s * n) for n in range(1, 40))
    assert twice.is_held, "so the kill that waits for a repetition is not carried out"
    assert [twice.press(t) for t in (20.0, 20.4)] == [False, True], "let go, it counts again"
    assert not twice.is_held


TAKEN = {
    "a": "GNU screen, picocom, minicom",
    "b": "tmux",
    "bghnopqst": "Zellij",
    "g": "dvtm",
    "t": "tio",
    "pq": "docker",
    "csz": "a terminal that interrupts, stops or ends",
    "uvw": "people who edit a line",
    "hijm": "Textual, which reads Tab, Enter and Backspace",
}
"""Letters with Ctrl, and who takes them."""


def test_orders_have_keys_of_their_own_and_those_that_act_everywhere_are_no_letters() -> None:
    keys = [key for order in ORDERS for key in order.keys]
    assert len(set(keys)) == len(keys)
    assert all(key.startswith("ctrl+") for order in ORDERS if order.always for key in order.keys)
    assert {order.ask for order in ORDERS} == set(Ask) - {Ask.GOTO}, "points are asked from a shell"


def test_every_emergency_key_has_a_second_one_that_no_common_multiplexer_takes() -> None:
    seconds = {order.second_key for order in ORDERS if order.always and order.key}
    assert len(seconds) == 4
    assert seconds.isdisjoint(f"ctrl+{letter}" for letter in "".join(TAKEN))
    assert {key for order in ORDERS if order.always for key in order.keys} == STOP_KEYS


@pytest.mark.parametrize("state", State)
def test_what_brings_the_vehicle_down_is_possible_in_every_state_that_is_not_over(
    state: State,
) -> None:
    over = state in ("landed", "aborted", "handed_over", "killed")
    assert possible(BY_ASK[Ask.LAND], state) is not over
    assert possible(BY_ASK[Ask.ABORT], state) is not over
    assert possible(BY_ASK[Ask.KILL], state)
    assert possible(BY_ASK[Ask.ARM], state) == (state is State.READY)
    assert possible(BY_ASK[Ask.ARM], "of a later version")


def notices(*times_s: int) -> tuple[Notice, ...]:
    return tuple(Notice(float(time_s), "tracking", "event") for time_s in times_s)


def test_events_are_kept_once_each_however_often_they_are_told() -> None:
    picture = Picture(0.0)
    for first in range(0, 30, 7):
        told = notices(*range(max(0, first - 20), first))
        picture.take(changed(events=told), 0.0)
        picture.take(changed(events=told), 0.0)
    assert tuple(picture.events) == notices(*range(28))


def test_who_holds_control_is_not_known_while_nobody_is_there() -> None:
    picture = Picture(0.0)
    picture.take(Control(None, yours=False), 0.0)
    assert picture.describe_holder() == "control is free: c takes it"
    picture.take(Control("tui 7", yours=True), 0.0)
    picture.take(FeedTrouble("gone"), 0.0)
    assert picture.holder == Control(None, yours=False)
    assert picture.describe_holder() == ""


def test_another_ground_station_or_another_flight_of_one_begins_with_empty_plots() -> None:
    picture = Picture(0.0)
    for origin, kept in (("process 1", 1), ("process 1", 2), ("process 2", 1)):
        picture.take(FlightIdentity("mqx", origin, ""), 0.0)
        picture.take(sample(1.0), 0.0)
        assert len(picture.flown) == kept
    picture.take(sample(2.0, state="landed"), 0.0)
    picture.take(sample(3.0, state="connecting"), 0.0)
    assert len(picture.flown) == 1


def heard(fleet: FleetMonitor, name: str, state: str = "tracking") -> VehicleView:
    snapshot = msgspec.structs.replace(sample(0.0, vehicle=name), state=state)
    fleet.hear(f"lab/{name}/state", state.encode(), 0.0)
    fleet.hear(f"lab/{name}/snapshot", msgspec.json.encode(snapshot), 0.0)
    return next(seen for seen in fleet if seen.name == name)


def test_a_vehicle_appears_with_its_first_word_and_its_snapshot_follows() -> None:
    fleet = FleetMonitor("lab")
    fleet.hear("lab/mqx/state", b"ready", 0.0)
    (seen,) = fleet
    assert fleet_row(seen, 0.0).cells[:3] == ("mqx", "!!NO DATA", "-")
    heard(fleet, "mqx")
    assert fleet_row(seen, 0.5).cells == (
        "mqx", "▲ TRACKING", "0.01s", f"{sample(0.0).error_m:.2f}m", "0.62m", "-", "armed", "0.50s",
        "tracking: following the trajectory",
    )  # fmt: skip


def word(seen: VehicleView, now_s: float) -> str:
    return seen.headline(now_s).big.upper()


def test_silence_is_an_alarm_unless_the_flight_has_ended_or_its_station_has_said_goodbye() -> None:
    fleet = FleetMonitor("lab")
    silent, landed = heard(fleet, "a", "hold"), heard(fleet, "b", "landed")
    away = heard(fleet, "c", "landed")
    fleet.hear("lab/c/state", b"offline", 0.1)
    late_s = SILENCE_S + 0.1
    assert [word(one, late_s) for one in (silent, landed, away)] == ["NO DATA", "LANDED", "OFFLINE"]
    assert [fleet_row(one, late_s).urgency for one in (silent, landed, away)] == [0, 2, 3]
    assert fleet_row(silent, 0.0).urgency == 1


def test_a_vehicle_whose_snapshots_come_is_not_offline() -> None:
    """The last will of an earlier connection says it is, until the station publishes its state."""
    fleet = FleetMonitor("lab")
    seen = heard(fleet, "mqx")
    fleet.hear("lab/mqx/state", b"offline", 0.5)
    assert word(seen, 0.5) == "OFFLINE"
    fleet.hear("lab/mqx/snapshot", msgspec.json.encode(sample(1.0)), 1.0)
    assert word(seen, 1.0) == "TRACKING"


@pytest.mark.parametrize(
    ("topic", "payload"),
    [
        ("lab/mqx/snapshot", b"{}"),
        ("lab/mqx/snapshot", b"\xff"),
        ("lab/mqx/snapshot", b'{}, "hello": {}'),
        ("lab/mqx/event", b"[]"),
        ("lab/mqx/state", b"\xff"),
        ("lab/mqx/other", b""),
        ("lab/m q x/state", b"ready"),
        ("other/mqx/state", b"ready"),
        ("lab", b""),
    ],
)
def test_what_is_not_understood_is_dropped(topic: str, payload: bytes) -> None:
    fleet = FleetMonitor("lab")
    fleet.hear(topic, payload, 0.0)
    assert all(seen.snapshot is None and not seen.offline for seen in fleet)


def test_what_needs_somebody_comes_first() -> None:
    fleet = FleetMonitor("lab")
    states = {"a": "ready", "b": "ready", "c": "tracking", "d": "aborted", "e": "hold"}
    for name, state in states.items():
        heard(fleet, name, state)
    fleet.hear("lab/a/state", b"offline", 0.0)
    shown = fleet_rows(fleet, 0.0)
    assert [one.name for one in shown] == ["d", "c", "e", "b", "a"]
    assert fleet_headline(shown, "").big == "1 ALARM"
    assert fleet_headline(shown, "").detail == "1 alarm, 2 flying, 1 on ground, 1 offline"
    assert fleet_headline(shown, "refused").big == "NO BROKER"
    assert fleet_headline([], "").big == "NO VEHICLE"


@pytest.mark.parametrize("page", [FlyPage, ControlPage, LinksPage])
def test_a_page_that_has_not_all_its_parts_yet_is_not_the_end_of_the_screen(
    page: type[Page],
) -> None:
    """A drawing that fails with NoMatches is left to the next time; no other error is."""
    picture = Picture(0.0)
    picture.newest = changed(gains={})
    frame = PageFrame(picture, 0.0, stale=False, again=False, whose="", holder="")
    with pytest.raises(NoMatches):
        page(orders=True).draw(frame)
    picture.newest = None
    with suppress(NoMatches):
        page(orders=True).draw(frame)


@pytest.mark.parametrize(
    ("keys", "typed"),
    [
        (["1", ".", "5", "backspace", "2", "enter"], "1.2"),
        (["x", "home", "m", "q", "enter"], "mqx"),
        (["x", "ctrl+u", "a", "enter", "b"], "a"),
    ],
)
def test_keys_that_come_at_once_act_in_their_order(keys: list[str], typed: str) -> None:
    answers: list[str | None] = []

    async def answer() -> None:
        app = App[None]()
        app.register_theme(THEMES[0])
        app.theme = THEMES[0].name
        async with app.run_test() as pilot:
            await app.push_screen(Typed("gain", "k2"), answers.append)
            await pilot.pause()
            for key in keys:  # as a driver hands them on
                app.post_message(Key(key, key if len(key) == 1 else None))
            await pilot.pause()

    asyncio.run(answer())
    assert answers == [typed]
