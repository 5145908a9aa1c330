"""The pieces of the screen that are pure functions: letters, plots, words, and what the banner says."""

import math
import time  # noqa: TID251  # the cost in processor time, not the clock

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual.theme import Theme

from groundstation.core.messages import Ask, Certificate, Notice, Snapshot
from groundstation.core.mission import State
from groundstation.interfaces.tui.drawing import (
    PlotLine,
    PlotTrack,
    Spans,
    arrow,
    bar,
    big,
    flight_time,
    history,
    horizon,
    huge,
    in_time,
    nice_top,
    number_rows,
    top_view,
    two_sided_bar,
)
from groundstation.interfaces.tui.model import (
    ALARM,
    BY_ASK,
    FLYING,
    ORDERS,
    STOP_KEYS,
    FeedTrouble,
    FlightIdentity,
    Holder,
    Jump,
    Picture,
    Twice,
    gains,
    headline,
    possible,
)
from groundstation.interfaces.tui.pages import config_rows, histogram_rows, lateness_rows, link_rows
from groundstation.interfaces.tui.terminal import find_multiplexer
from groundstation.interfaces.tui.widgets import THEMES
from links.text import printable
from tests.sample_flight import sample

TONES = ("alarm", "busy", "calm", "flying")
ANY = st.floats(allow_nan=True, allow_infinity=True)


def plain(rows: list[Spans]) -> list[str]:
    return ["".join(text for text, _ in row) for row in rows]


def changed(**more: object) -> Snapshot:
    return msgspec.structs.replace(sample(10.0), **more)


def test_large_letters_are_three_rows_of_half_blocks() -> None:
    assert big("Hi") == ("█ █ █", "█▀█ █", "▀ ▀ ▀")


@given(st.text())
def test_any_text_gives_three_rows_of_one_width(text: str) -> None:
    rows = big(text)
    assert len({len(row) for row in rows}) == 1


def test_huge_letters_are_five_rows_of_full_blocks() -> None:
    assert huge("I") == ("██",) * 5


@given(st.lists(ANY, max_size=80), st.integers(1, 40), st.integers(1, 9))
def test_any_curve_fills_exactly_its_room(values: list[float], width: int, height: int) -> None:
    rows, low, high = in_time([PlotLine(values, "x"), PlotLine(values[::-1], "y")], width, height, 0.1)
    assert [len(row) for row in plain(rows)] == [width] * height
    assert low < high


def test_a_curve_rises_to_the_right_and_its_newest_value_is_last() -> None:
    rows, low, high = in_time([PlotLine([0.0, 1.0, 2.0, 3.0], "x")], 2, 1, 0.1)
    assert (low, high, plain(rows)) == (0.0, 3.0, ["⡠⠊"])


def test_the_horizon_falls_to_the_left_in_a_roll_to_the_right_and_sinks_with_the_nose_up() -> None:
    def heights(roll: float, pitch: float) -> list[int]:
        rows = plain(horizon(roll, pitch, 20, 9, "x", "y"))
        found = [next((i for i, row in enumerate(rows) if row[column] > "\u2800"), -1) for column in (1, 18)]
        return found

    left, right = heights(0.3, 0.0)
    assert left > right
    level, nosed_up = heights(0.0, 0.0), heights(0.0, 0.2)
    assert nosed_up[0] > level[0]


@pytest.mark.parametrize("width", [4, 30])
@given(ANY, ANY)
def test_any_attitude_has_a_horizon(width: int, roll: float, pitch: float) -> None:
    assert [len(row) for row in plain(horizon(roll, pitch, width, 5, "x", "y"))] == [width] * 5


def test_an_arrow_points_where_its_vector_does() -> None:
    assert [arrow(v) for v in ((1.0, 0.0, 0.0), (0.0, 1.0, 1.0), (-1.0, -1.0, -1.0), (0.0, 0.0, 0.0))] == [
        "↑",
        "→▼",
        "↙▲",
        "·",
    ]


def test_north_is_up_and_east_is_to_the_right() -> None:
    for point, (row, column) in {
        (1.0, 0.0): (0, 1),
        (-1.0, 0.0): (2, 1),
        (0.0, 1.0): (1, 2),
        (0.0, -1.0): (1, 0),
    }.items():
        rows, _ = top_view([PlotTrack(points=[(0.0, 0.0), point], style="x", head="o")], 30, 15)
        where = next((r, line.index("o")) for r, line in enumerate(plain(rows)) if "o" in line)
        assert (where[0] // 5, where[1] // 10) == (row, column), point


def test_a_metre_is_as_long_across_as_it_is_up() -> None:
    square = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
    rows, cell_m = top_view([PlotTrack(points=square, style="x", head="o")], 40, 20)
    drawn = [line for line in plain(rows) if set(line) - {"⠀"}]
    across = max(len(line.rstrip("⠀")) for line in drawn) - min(len(line) - len(line.lstrip("⠀")) for line in drawn)
    assert across == pytest.approx(1.0 / cell_m, abs=1.5)
    assert len(drawn) == pytest.approx(0.5 / cell_m, abs=1.5)  # a character is twice as high as wide


@given(st.lists(st.tuples(ANY, ANY), max_size=30), st.integers(8, 90), st.integers(3, 40))
def test_any_track_fills_exactly_its_room(points: list[tuple[float, float]], width: int, height: int) -> None:
    rows, cell_m = top_view([PlotTrack(points=points, style="x", head="o")], width, height)
    assert [len(line) for line in plain(rows)] == [width] * height
    assert cell_m > 0.0


def test_a_large_screen_is_plotted_in_a_fraction_of_a_frame() -> None:
    points = [(math.sin(0.05 * i), 2.0 * math.cos(0.09 * i)) for i in range(600)]
    tracks = [PlotTrack(points=points, style="x", head="o"), PlotTrack(points=points[::-1], style="y", head="+")]
    costs, floors = [], []
    for _ in range(5):
        before = time.process_time()
        top_view(tracks, 150, 50)
        drawn = time.process_time()
        sum(number & 3 for number in range(200_000))
        costs.append(drawn - before)
        floors.append(time.process_time() - drawn)
    assert min(costs) < 4.0 * min(floors)  # 10 ms each: a fifth of a core at 5 frames a second


def test_a_history_grows_from_the_right_and_upwards() -> None:
    assert history([0.0, 4.0, 8.0], 8.0, 5, 1) == ["  ▁▄█"]
    assert history([4.0, 8.0], 8.0, 2, 2) == [" █", "██"]
    assert history([math.nan, 8.0], 8.0, 2, 1) == [" █"]


@given(st.lists(ANY, max_size=50), st.integers(1, 60), st.integers(1, 6))
def test_any_history_fills_exactly_its_room(values: list[float], width: int, height: int) -> None:
    rows = history(values, nice_top(values, 0.01), width, height)
    assert [len(row) for row in rows] == [width] * height


def test_bars_show_share_and_sign() -> None:
    assert bar(0.5, 1.0, 4) == "██░░"
    assert bar(9.0, 1.0, 4) == "████"
    assert bar(math.nan, 1.0, 4) == "░░░░"
    assert two_sided_bar(-0.5, 1.0, 2) == "░█│░░"
    assert two_sided_bar(1.0, 1.0, 2) == "░░│██"


def test_the_banner_shows_the_state_while_all_is_well() -> None:
    shown = headline(sample(3.0), 0.2, "")
    assert (shown.big, shown.tone, shown.detail) == ("tracking", FLYING, "following the trajectory")


def test_silence_beats_every_state_but_the_last() -> None:
    assert headline(sample(3.0), 3.2, "").detail == "since 3 s, it was tracking."
    assert headline(sample(3.0), 3.2, "").big == "NO DATA"
    assert headline(None, 3.2, "nobody is there").detail == "since 3 s: nobody is there"
    assert headline(changed(state="landed"), 60.0, "").big == "landed"
    link = msgspec.structs.replace(sample(3.0).link, phase="bring_down")
    assert headline(changed(state="aborted", link=link), 0.2, "").big == "COMING DOWN"
    assert headline(changed(state="aborted"), 60.0, "").tone == ALARM


def test_a_lost_link_and_old_poses_are_alarms() -> None:
    lost = msgspec.structs.replace(sample(1.0).link, state="lost")
    assert headline(changed(link=lost), 0.0, "").big == "LINK LOST"
    assert headline(changed(pose_age_s=0.5), 0.0, "").big == "NO POSE"
    assert headline(changed(pose_age_s=math.nan), 0.0, "").big == "NO POSE"
    assert headline(changed(pose_age_s=0.5, state="ready"), 0.0, "").big == "ready"


def test_heights_are_up_and_errors_in_centimetres() -> None:
    text = "\n".join(plain(number_rows(changed(position_ned=(1.0, -2.0, -1.5), error_m=0.123))))
    assert "position   +1.000   -2.000   +1.500 m" in text
    assert "error     12.3 cm" in text


def test_heights_count_from_the_floor() -> None:
    text = "\n".join(plain(number_rows(changed(position_ned=(1.0, -2.0, 1.0), floor_z_m=1.0))))
    assert "position   +1.000   -2.000   +0.000 m" in text


def test_where_room_is_short_the_rates_go_first_and_then_the_disturbance() -> None:
    def names(room: float) -> list[str]:
        return [row[:9].strip() for row in plain(number_rows(changed(), room))]

    everything = names(math.inf)
    assert names(len(everything)) == everything
    assert names(len(everything) - 1) == [name for name in everything if name not in ("rate roll", "pitch", "yaw")]
    assert names(10) == [
        name for name in everything if name not in ("rate roll", "pitch", "yaw", "disturbed", "wind down")
    ]


def test_a_command_at_its_limit_carries_a_mark() -> None:
    limits = (1.0, 1.0, 1.0)
    rows = plain(number_rows(changed(thrust_n=1.37, rates_rad_s=(1.0, -1.0, 0.5), rate_limits_rad_s=limits)))
    marked = [row.rstrip().endswith("!") for row in rows if " N" in row or "°/s" in row]
    assert marked == [True, True, True, False]


def test_a_violated_bound_carries_a_mark_and_a_bound_that_holds_does_not() -> None:
    held = Certificate(
        state="holds",
        bound="composite",
        v=0.0213,
        excess=0.0,
        violated_fraction=0.0,
        suspended_fraction=0.0,
        b_hat_fraction=0.08,
    )
    assert "V         0.0213  holds  b̂ 8 %" in plain(number_rows(changed(certificate=held)))
    violated = msgspec.structs.replace(held, state="violated", excess=3.25, b_hat_fraction=None)
    assert "V         0.0213  violated! by 3.2" in plain(number_rows(changed(certificate=violated)))
    assert "V         -" in plain(number_rows(changed(certificate=None)))


def test_words_from_the_vehicle_cannot_steer_the_terminal() -> None:
    hostile = "\x1b[2J\x07[red]armed[/]\r\n"
    assert printable(hostile) == "·[2J·[red]armed[/]··"
    link = msgspec.structs.replace(sample(1.0).link, text=hostile, state=hostile, dropped={hostile: 3})
    assert "\x1b" not in "".join(plain(number_rows(changed(link=link))))


NUMBERS = st.tuples(ANY, ANY, ANY)


@given(NUMBERS, NUMBERS, st.tuples(ANY, ANY, ANY, ANY), ANY, st.none() | NUMBERS)
def test_any_numbers_can_be_shown(
    position: tuple[float, float, float],
    rates: tuple[float, float, float],
    attitude: tuple[float, float, float, float],
    other: float,
    limits: tuple[float, float, float] | None,
) -> None:
    snapshot = changed(
        position_ned=position,
        rates_rad_s=rates,
        attitude=attitude,
        error_m=other,
        pose_age_s=other,
        pose_rate_hz=other,
        pose_latency_s=other,
        thrust_n=other,
        flight_time_s=other,
        rate_limits_rad_s=limits,
    )
    assert len(number_rows(snapshot)) == 16
    assert headline(snapshot, 0.0, "").big


def test_a_kill_takes_two_presses_within_a_second() -> None:
    twice = Twice()
    assert [twice.press(t) for t in (0.0, 1.5, 2.4, 2.5, 3.0)] == [False, False, True, False, True]
    assert not twice.waits(3.1)


TAKEN_BY = {
    "GNU screen, picocom, minicom": "a",
    "tmux": "b",
    "Zellij": "bghnopqst",
    "dvtm": "g",
    "tio": "t",
    "docker": "pq",
    "a terminal that interrupts, stops or ends": "csz",
    "people who edit a line": "uvw",
    "Textual, which reads Tab, Enter and Backspace": "hijm",
}
"""Letters that something else takes with Ctrl."""


def test_orders_have_keys_of_their_own_and_those_that_act_everywhere_are_no_letters() -> None:
    keys = [key for order in ORDERS for key in order.keys]
    assert len(set(keys)) == len(keys)
    assert all(key.startswith("ctrl+") for order in ORDERS if order.always for key in order.keys)
    assert {order.ask for order in ORDERS} == set(Ask) - {Ask.GOTO}, "points are asked for from a shell or a program"


def test_every_emergency_key_has_a_second_one_that_no_common_multiplexer_takes() -> None:
    seconds = [order.second_key for order in ORDERS if order.always and order.key]
    assert len(seconds) == 4 and not {key.removeprefix("ctrl+") for key in seconds} & set("".join(TAKEN_BY.values()))
    assert {key for order in ORDERS if order.always for key in order.keys} == STOP_KEYS


@pytest.mark.parametrize("environment, taker", [
    ({"TERM": "xterm-256color"}, ""),
    ({"TERM": "xterm-256color", "STY": "1234.pts-0.lab"}, "GNU screen ($STY)"),
    ({"TERM": "xterm-256color", "TMUX": "/tmp/tmux-0/default,9,0"}, "tmux ($TMUX)"),
    ({"ZELLIJ": "0"}, "Zellij ($ZELLIJ)"),
    ({"TERM": "screen.xterm-256color"}, "a multiplexer (TERM=screen.xterm-256color)"),  # by ssh, from within screen
    ({"TERM": "tmux-256color\x1b[2J", "STY": ""}, "a multiplexer (TERM=tmux-256color·[2J)"),
])  # fmt: skip
def test_a_multiplexer_is_known_by_what_it_sets(environment: dict[str, str], taker: str) -> None:
    assert find_multiplexer(environment) == taker


@pytest.mark.parametrize("state", State)
def test_what_brings_the_vehicle_down_is_possible_in_every_state_that_is_not_over(state: State) -> None:
    over = state in ("landed", "aborted", "handed_over", "killed")
    assert [possible(BY_ASK[ask], state) for ask in (Ask.LAND, Ask.ABORT, Ask.KILL)] == [not over, not over, True]
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


def test_events_that_were_missed_do_not_hide_those_that_come() -> None:
    picture = Picture(0.0)
    picture.take(changed(events=notices(1)), 0.0)
    picture.take(changed(events=notices(7, 8)), 0.0)
    assert tuple(picture.events) == notices(1, 7, 8)


def test_after_a_jump_all_events_of_a_snapshot_are_new() -> None:
    picture = Picture(0.0)
    picture.take(changed(events=notices(1, 2)), 0.0)
    picture.take(Jump(), 0.0)
    picture.take(changed(events=notices(1, 2, 3)), 0.0)
    assert tuple(picture.events) == notices(1, 2, 3)


def test_who_holds_control_is_not_known_while_nobody_is_there() -> None:
    picture = Picture(0.0)
    picture.take(Holder("tui 7", yours=True), 0.0)
    picture.take(FeedTrouble("gone"), 0.0)
    assert picture.holder == Holder("", yours=False)


def test_another_ground_station_begins_with_empty_plots_and_the_next_flight_of_one_does_too() -> None:
    picture = Picture(0.0)
    for origin, kept in (("process 1", 1), ("process 1", 2), ("process 2", 1)):
        picture.take(FlightIdentity("mqx", origin, ""), 0.0)
        picture.take(sample(1.0), 0.0)
        assert len(picture.flown) == kept
    picture.take(sample(2.0, state="landed"), 0.0)
    picture.take(sample(3.0, state="connecting"), 0.0)
    assert len(picture.flown) == 1


def test_gains_are_shown_as_they_are_and_as_they_were_configured() -> None:
    config = {"controller": {"kind": "adaptive", "k2": 2.0}}
    k2, kb = gains(config, {"controller.k2": 3.0, "controller.kb": 1.0})
    assert (k2.value, k2.begun, kb.value, math.isnan(kb.begun)) == (3.0, 2.0, 1.0, True)
    assert k2.read(" 3.5") == 3.5
    for typed in ("nan", "inf", "two", ""):
        assert "nothing was changed" in str(k2.read(typed))
    assert gains({}, {}) == []


def test_the_lines_of_a_configuration_carry_their_section() -> None:
    assert plain(list(config_rows("# a\n[flight]\ncoast_s = 0.25  # [s]\n"))) == ["flight.coast_s = 0.25  # [s]"]


@given(st.lists(ANY, max_size=40))
def test_a_histogram_counts_every_finite_number_once(values: list[float]) -> None:
    finite = [value for value in values if abs(value) < 1e6]
    rows = plain(histogram_rows(finite))
    assert len(rows) <= 10
    if finite:
        assert sum(int(row.split()[-1]) for row in rows) == len(finite)


def test_lateness_is_shown_by_octaves() -> None:
    rows = plain(lateness_rows(changed(late_us=(10, 60, 200), late_octaves=(0, 0, 0, 9, 0, 0, 3))))
    assert rows == [
        "late      50 % 10 µs   99 % 60 µs   99.9 % 200 µs",
        "  <    8 µs ██████████ 9",
        "  <   64 µs ███░░░░░░░ 3",
    ]


def luminance(colour: str) -> float:
    parts = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
def test_all_that_is_written_can_be_read(theme: Theme) -> None:
    """WCAG 2.2 asks for a contrast of 4.5; the letters of alarms are large, 3 is enough."""
    pairs = [(theme.variables[f"{tone}-text"], theme.variables[f"{tone}-back"], 3.0) for tone in TONES]
    pairs += [(theme.variables[name], str(theme.background), 4.5) for name in ("label", "flown", "warn", "bad", "wind")]
    for one, other, wanted in pairs:
        low, high = sorted((luminance(one), luminance(other)))
        assert (high + 0.05) / (low + 0.05) >= wanted, (one, other)


def test_a_trajectory_that_has_not_begun_has_no_negative_time() -> None:
    assert flight_time(-6.24) == "trajectory in 6.2 s"
    assert flight_time(34.91) == "34.9 s"


def test_the_page_of_links_shows_what_the_vehicle_tells_of_itself_and_what_it_does_not() -> None:
    snapshot = sample(1.0)
    told = msgspec.structs.replace(
        snapshot.link, mode="ACRO", angles_rad=(0.1, -0.2, 1.0), uplink_share=0.99, uplink_dbm=-60, uplink_snr_db=-5
    )
    lines = ["".join(text for text, _ in row) for row in link_rows(msgspec.structs.replace(snapshot, link=told))]
    assert "mode      ACRO" in lines
    assert "attitude  roll +6°   pitch -11°   yaw +57° (its own north)" in lines
    assert "hears us  99 % of frames   -60 dBm   -5 dB over noise" in lines
    silent = ["".join(text for text, _ in row) for row in link_rows(snapshot)]
    assert {"attitude  not told", "hears us  not told"} <= set(silent)
