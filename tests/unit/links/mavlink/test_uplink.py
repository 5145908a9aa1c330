"""links/mavlink/protocol/timesync.py: whether what we send arrives, and in time."""

import pytest

from links.mavlink.connection import FORGOTTEN_S, TOO_LATE_S, Uplink
from links.mavlink.protocol import MavlinkCodec

PERIOD_S, USUAL_S = 0.05, 0.02
D = MavlinkCodec(1, 1).dialect


def watch(until_s: float, trip_s: float = USUAL_S, deaf_from_s: float = 1e9, mute_from_s: float = 1e9) -> Uplink:
    """Ask beside a set-point each 10 ms; each question takes so long there and back."""
    uplink, under_way = Uplink(PERIOD_S), list[tuple[float, int]]()
    uplink.begin(0.0)
    for n in range(round(until_s / 0.01) + 1):
        now = 0.01 * n
        while under_way and under_way[0][0] <= now + 1e-9:
            _, asked_ns = under_way.pop(0)
            if now < mute_from_s:
                uplink.hear(D.MAVLink_timesync_message(77, asked_ns), now, USUAL_S)
        if now < mute_from_s:
            uplink.hear(D.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3), now, USUAL_S)
        asked = uplink.ask(now)
        if asked is not None and now < deaf_from_s:
            under_way.append((now + trip_s, asked))
    return uplink


def test_answers_in_time_are_no_finding() -> None:
    assert watch(3.0).arrival(3.0, USUAL_S) == pytest.approx((0.0, 0.0), abs=0.011)


def test_an_autopilot_that_hears_no_more_is_known_by_answers_that_are_overdue() -> None:
    overdue_s, late_s = watch(3.0, deaf_from_s=2.0).arrival(3.0, USUAL_S)
    assert overdue_s == pytest.approx(1.0, abs=0.1)
    assert late_s == 0.0


def test_one_that_is_not_heard_either_tells_nothing() -> None:
    assert watch(3.0, deaf_from_s=2.0, mute_from_s=2.0).arrival(3.0, USUAL_S) == (0.0, 0.0)


def test_nor_does_one_that_never_answers() -> None:
    assert watch(3.0, deaf_from_s=0.0).arrival(3.0, USUAL_S) == (0.0, 0.0)


@pytest.mark.parametrize("trip_s", [TOO_LATE_S + 0.1, 1.5, FORGOTTEN_S - 0.1])
def test_answers_that_go_on_to_come_too_late_tell_by_how_much(trip_s: float) -> None:
    overdue_s, late_s = watch(9.0, trip_s).arrival(9.0, USUAL_S)
    assert late_s == pytest.approx(trip_s - USUAL_S, abs=0.011)
    assert overdue_s > TOO_LATE_S


def test_what_was_held_back_once_and_came_all_together_is_not_late_any_more() -> None:
    uplink, asked = Uplink(PERIOD_S), list[int]()
    uplink.begin(0.0)
    for n in range(101):
        uplink.hear(D.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3), 0.01 * n, USUAL_S)
        asked += [ns for ns in (uplink.ask(0.01 * n),) if ns is not None]
    for ns in asked:
        uplink.hear(D.MAVLink_timesync_message(77, ns), 1.01, USUAL_S)
    assert uplink.arrival(1.01, USUAL_S) == (0.0, 0.0)
