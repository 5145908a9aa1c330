"""The measurements measure what they say, and leave nothing behind."""

from collections.abc import Sequence

import pytest

from tests.proving.bench.links import Answers, Waiting, figures_of, together

Moments = Sequence[tuple[float, int | None]]
"""When something came [s]: a pose left, or a command for the pose of this time [ms]."""


@pytest.mark.parametrize(
    ("moments", "latencies_s", "overtaken"),
    [
        ([(10.0001, None), (10.0009, 10_000)], [0.0008], 0),
        ([(10.0021, None), (10.0023, 10_001), (10.0045, 10_004)], [0.0024], 0),
        ([(10.0, None), (10.004, None), (10.005, 10_004)], [0.005, 0.001], 1),
    ],
    ids=[
        "the pose that had left",
        "a command from before the pose is no answer",
        "overtaken by a newer pose",
    ],
)
def test_a_command_answers_the_poses_that_had_left_when_it_was_computed(
    moments: Moments, latencies_s: list[float], overtaken: int
) -> None:
    waiting = Waiting()
    for when_s, of_ms in moments:
        if of_ms is None:
            waiting.left(when_s)
        else:
            waiting.command(of_ms, when_s)
    assert waiting.latencies_s == pytest.approx(latencies_s)
    assert waiting.overtaken == overtaken


def test_what_had_no_answer_is_told_beside_the_percentiles() -> None:
    figures = figures_of(together([Answers([0.001, 0.003], 3, overtaken=1), Answers([0.002], 2)]))
    assert (figures["count"], figures["overtaken"], figures["unanswered"]) == (3, 1, 2)
    assert figures["p50_us"] == pytest.approx(2000.0)
    assert figures["p99_us"] == pytest.approx(3000.0)
