"""Whether a vehicle that tells how it turns has fallen silent."""

import math

import pytest

from groundstation.flight.mission_executive import LOST_S, SILENT_S, Hearing


def heard(interval_s: float, seconds: float = 10.0) -> tuple[Hearing, float]:
    """One that has told so often; and when last [s]."""
    hearing, now_s = Hearing(), 0.0
    while now_s < seconds:
        hearing.hear(now_s)
        now_s += interval_s
    return hearing, now_s - interval_s


def test_who_was_never_heard_is_not_silent() -> None:
    assert Hearing().stalls(100.0) == 0.0


@pytest.mark.parametrize("interval_s", [0.02, 0.05])
def test_one_that_tells_often_is_silent_after_150_ms(interval_s: float) -> None:
    hearing, last_s = heard(interval_s)
    assert hearing.stalls(last_s + SILENT_S - 0.01) == 0.0
    assert hearing.stalls(last_s + SILENT_S + 0.01) == pytest.approx(SILENT_S + 0.01)


@pytest.mark.parametrize("interval_s", [0.17, 0.25, 1.0])
def test_one_that_tells_seldom_is_not_silent_between_two_tellings(interval_s: float) -> None:
    """ArduPilot tells four times a second where nothing else is asked of it: the monitor was off all the time."""
    hearing, last_s = heard(interval_s)
    assert hearing.stalls(last_s + 1.5 * interval_s) == 0.0
    assert hearing.stalls(last_s + min(3.0 * interval_s, LOST_S - 0.01)) > 0.0


def test_one_that_has_told_nothing_for_long_only_tells_no_more() -> None:
    hearing, last_s = heard(0.02)
    assert hearing.stalls(last_s + LOST_S + 0.1) == 0.0
    assert hearing.stalls(math.inf) == 0.0
