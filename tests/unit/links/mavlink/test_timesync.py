"""links/mavlink/protocol/timesync.py: the autopilot's clock against ours."""

import pytest
from hypothesis import example, given, strategies as st

from links.mavlink.protocol import Timesync

# By their numbers: a limit that the test took from the code would bear out any value.
NEWEST = 16

OFFSET_S = -1234.5


def trip(sync: Timesync, now_s: float, there_s: float, back_s: float) -> bool:
    ours = sync.ask(now_s)
    theirs_ns = int((now_s + there_s + OFFSET_S + 2000.0) * 1e9)
    return sync.take_answer(theirs_ns, ours, now_s + there_s + back_s)


way_s = st.floats(0.001, 0.2)


@given(st.lists(st.tuples(way_s, way_s), min_size=1, max_size=NEWEST))
@example([(0.004, 0.004)])
def test_the_clock_is_wrong_by_at_most_half_the_shortest_trip(
    trips: list[tuple[float, float]],
) -> None:
    sync = Timesync()
    assert sync.best is None
    for n, (there, back) in enumerate(trips):
        assert trip(sync, 1.0 + n, there, back)
    assert sync.best is not None
    assert sync.best.rtt_s == pytest.approx(min(map(sum, trips)), abs=1e-6)
    assert abs(sync.best.offset_s - OFFSET_S - 2000.0) <= 0.5 * sync.best.rtt_s + 1e-6
    if all(there == back for there, back in trips):
        assert sync.best.offset_s == pytest.approx(OFFSET_S + 2000.0, abs=1e-6), "even trips"


def test_old_trips_are_forgotten() -> None:
    sync = Timesync()
    trip(sync, 1.0, 0.001, 0.001)
    for n in range(NEWEST):
        trip(sync, 2.0 + n, 0.05, 0.05)
    assert sync.best is not None and sync.best.rtt_s == pytest.approx(0.1)


def test_only_the_answer_to_the_newest_question_counts_and_only_once() -> None:
    sync = Timesync()
    first, second = sync.ask(1.0), sync.ask(2.0)
    assert not sync.take_answer(5, first, 2.01)
    assert not sync.take_answer(0, second, 2.01)
    assert not sync.take_answer(5, second, 1.9)
    assert not sync.take_answer(5, second, 3.01), "later than a second it answers nothing any more"
    assert sync.best is None
    assert sync.take_answer(5, second, 2.99)
    assert not sync.take_answer(5, second, 2.99)
    assert sync.ask(3.0) != sync.ask(3.0), "two questions at the same instant differ"
