"""What counts as the answer to a pose."""

import pytest

from tests.proving.bench.links import Answers, Waiting, figures_of, together


def test_a_command_answers_the_pose_that_had_left_when_it_was_computed() -> None:
    waiting = Waiting()
    waiting.left(10.0001)
    waiting.command(10_000, 10.0009)
    assert waiting.latencies_s == [pytest.approx(0.0008)]
    assert waiting.overtaken == 0


def test_a_command_from_before_the_pose_is_no_answer_to_it() -> None:
    waiting = Waiting()
    waiting.left(10.0021)
    waiting.command(10_001, 10.0023)
    assert waiting.latencies_s == []
    waiting.command(10_004, 10.0045)
    assert waiting.latencies_s == [pytest.approx(0.0024)]


def test_a_pose_that_a_newer_one_overtakes_counts_until_their_command_comes() -> None:
    waiting = Waiting()
    waiting.left(10.0)
    waiting.left(10.004)
    waiting.command(10_004, 10.005)
    assert waiting.latencies_s == [pytest.approx(0.005), pytest.approx(0.001)]
    assert waiting.overtaken == 1


def test_the_milliseconds_of_the_wire_may_run_over() -> None:
    waiting = Waiting()
    waiting.left(4_294_967.2955)  # 2**32 ms are 4,294,967.296 s
    waiting.command(1, 4_294_967.298)
    assert waiting.latencies_s == [pytest.approx(0.0025)]


def test_what_had_no_answer_is_told_beside_the_percentiles() -> None:
    figures = figures_of(together([Answers([0.001, 0.003], 3, overtaken=1), Answers([0.002], 2)]))
    assert (figures["count"], figures["overtaken"], figures["unanswered"]) == (3, 1, 2)
    assert figures["p50_us"] == pytest.approx(2000.0)
    assert figures["p99_us"] == pytest.approx(3000.0)
