"""Recorded and replayed side by side: what counts as the same."""

from typing import Any

import msgspec
import pytest

from groundstation.analysis.replay import Difference, ReplayResult
from links.core import Command, Segment

WAS = Command(1.0, (0.0, 0.5, 0.0), 3, 0.0, 1.0, (Segment(1.0, 2.0, (0.0, 0.0, 0.0)),))


def compared(now: Command) -> ReplayResult:
    comparison = ReplayResult()
    comparison.compare("command", 0.5, WAS, WAS)
    comparison.compare("command", 0.5, WAS, now)
    return comparison


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("rates_rad_s", WAS.rates_rad_s),  # the same
        ("pose_time_s", -0.0),
        ("rates_rad_s", (0.0, 0.5, -0.0)),
        ("bring_down", (Segment(1.0, 2.0, (0.0, 0.0, -0.0)),)),
    ],
)
def test_the_sign_of_a_zero_counts_wherever_it_stands(field: str, value: Any) -> None:
    was = getattr(WAS, field)
    comparison = compared(msgspec.structs.replace(WAS, **{field: value}))
    first = None if value is was else Difference("command", 1, 0.5, field, was, value)
    assert (comparison.count["command"], comparison.differing["command"]) == (
        2,
        int(value is not was),
    )
    assert comparison.first == first


def test_what_was_not_made_anew_counts_as_different() -> None:
    comparison = ReplayResult()
    comparison.differ("pose", 0.5, "all of it", 7, None)
    assert comparison.count["pose"] == comparison.differing["pose"] == 1
    assert comparison.first == Difference("pose", 0, 0.5, "all of it", 7, None)
