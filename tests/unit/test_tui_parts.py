"""The pieces of the screen that are pure functions: letters, plots, words, and what the banner says."""

import math
import time  # noqa: TID251  # the cost in processor time, not the clock

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.snapshot import Certificate, Snapshot
from groundstation.tui.headline import ALARM, FLYING, headline
from groundstation.tui.letters import big
from groundstation.tui.plot import Spans, Track, bar, history, nice_top, top_view, two_sided_bar
from groundstation.tui.words import clean, numbers
from tests.sample_flight import sample

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


def test_north_is_up_and_east_is_to_the_right() -> None:
    for point, (row, column) in {
        (1.0, 0.0): (0, 1),
        (-1.0, 0.0): (2, 1),
        (0.0, 1.0): (1, 2),
        (0.0, -1.0): (1, 0),
    }.items():
        rows, _ = top_view([Track(points=[(0.0, 0.0), point], style="x", head="o")], 30, 15)
        where = next((r, line.index("o")) for r, line in enumerate(plain(rows)) if "o" in line)
        assert (where[0] // 5, where[1] // 10) == (row, column), point


def test_a_metre_is_as_long_across_as_it_is_up() -> None:
    square = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
    rows, cell_m = top_view([Track(points=square, style="x", head="o")], 40, 20)
    drawn = [line for line in plain(rows) if set(line) - {"⠀"}]
    across = max(len(line.rstrip("⠀")) for line in drawn) - min(len(line) - len(line.lstrip("⠀")) for line in drawn)
    assert across == pytest.approx(1.0 / cell_m, abs=1.5)
    assert len(drawn) == pytest.approx(0.5 / cell_m, abs=1.5)  # a character is twice as high as wide


@given(st.lists(st.tuples(ANY, ANY), max_size=30), st.integers(8, 90), st.integers(3, 40))
def test_any_track_fills_exactly_its_room(points: list[tuple[float, float]], width: int, height: int) -> None:
    rows, cell_m = top_view([Track(points=points, style="x", head="o")], width, height)
    assert [len(line) for line in plain(rows)] == [width] * height
    assert cell_m > 0.0


def test_a_large_screen_is_plotted_in_a_fraction_of_a_frame() -> None:
    points = [(math.sin(0.05 * i), 2.0 * math.cos(0.09 * i)) for i in range(600)]
    tracks = [Track(points=points, style="x", head="o"), Track(points=points[::-1], style="y", head="+")]
    costs = []
    for _ in range(5):
        before = time.process_time()
        top_view(tracks, 150, 50)
        costs.append(time.process_time() - before)
    assert min(costs) < 0.04  # a fifth of a core at 5 frames a second


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
    text = "\n".join(plain(numbers(changed(position_ned=(1.0, -2.0, -1.5), error_m=0.123))))
    assert "position   +1.000   -2.000   +1.500 m" in text
    assert "error     12.3 cm" in text


def test_a_command_at_its_limit_carries_a_mark() -> None:
    limits = (1.0, 1.0, 1.0)
    rows = plain(numbers(changed(thrust_n=1.37, rates_rad_s=(1.0, -1.0, 0.5), rate_limits_rad_s=limits)))
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
    assert "V         0.0213  holds  b̂ 8 %" in plain(numbers(changed(certificate=held)))
    violated = msgspec.structs.replace(held, state="violated", excess=3.25, b_hat_fraction=None)
    assert "V         0.0213  violated! by 3.2" in plain(numbers(changed(certificate=violated)))
    assert "V         -" in plain(numbers(changed(certificate=None)))


def test_words_from_the_vehicle_cannot_steer_the_terminal() -> None:
    hostile = "\x1b[2J\x07[red]armed[/]\r\n"
    assert clean(hostile) == "·[2J·[red]armed[/]··"
    link = msgspec.structs.replace(sample(1.0).link, text=hostile, state=hostile, dropped={hostile: 3})
    assert "\x1b" not in "".join(plain(numbers(changed(link=link))))


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
    assert len(numbers(snapshot)) == 16
    assert headline(snapshot, 0.0, "").big
