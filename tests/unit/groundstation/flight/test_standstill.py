"""Noticing that the program stood still, so that what waited meanwhile is not taken for fresh."""

from groundstation.flight.flight import DRAIN_S, LOOK_S, STALL_S, StallDetector


def looked(*times_s: float) -> StallDetector:
    standstill = StallDetector()
    for time_s in times_s:
        standstill.look(time_s)
    return standstill


def test_before_the_first_look_nothing_has_waited() -> None:
    standstill = StallDetector()
    assert not standstill.may_be_stale(1.0)
    assert not standstill.may_be_stale(5.0)


def test_a_program_that_looks_often_takes_everything() -> None:
    standstill = looked(0.0)
    for step in range(1, 100):
        standstill.look(step * LOOK_S)
        assert not standstill.may_be_stale((step + 0.5) * LOOK_S)


def test_a_little_late_is_not_standing_still() -> None:
    assert not looked(1.0).may_be_stale(1.0 + 0.9 * STALL_S)


def test_what_is_read_right_after_a_standstill_has_waited_and_what_comes_later_has_not() -> None:
    standstill = looked(1.0)
    assert standstill.may_be_stale(1.15)
    assert standstill.may_be_stale(1.15 + 0.1 * DRAIN_S)
    assert standstill.may_be_stale(1.15 + 0.9 * DRAIN_S)
    assert not standstill.may_be_stale(1.15 + 1.1 * DRAIN_S)


def test_a_timer_that_is_served_before_the_socket_does_not_hide_the_standstill() -> None:
    standstill = looked(1.0, 1.15)
    assert standstill.may_be_stale(1.15 + 0.1 * DRAIN_S)
    assert not standstill.may_be_stale(1.15 + 1.1 * DRAIN_S)
