"""How late commands are, by one rule for screens and recordings."""

from types import SimpleNamespace
from typing import Any

import pytest

from groundstation.flight import FrameLateness


def link(period_s: float, *, follows_poses: bool = False) -> Any:
    return SimpleNamespace(period_s=period_s, follows_poses=follows_poses)


def test_a_frame_is_late_by_what_it_misses_and_one_in_between_is_none() -> None:
    due = FrameLateness(link(0.02))
    seen = [due.late_s(now, 0, 0.0) for now in (1.0, 1.02, 1.043, 1.05, 1.06, 1.101, 1.121)]
    assert seen == pytest.approx([0.0, 0.0, 0.003, None, 0.0, 0.021, 0.0], abs=1e-9)


def test_the_first_command_behind_an_idle_one_is_in_time() -> None:
    due = FrameLateness(link(0.02))
    due.late_s(1.0, 0, 0.0)
    due.begin()
    assert due.late_s(7.0, 0, 0.0) == 0.0


def test_where_commands_follow_poses_each_new_pose_counts_from_its_arrival() -> None:
    due = FrameLateness(link(0.02, follows_poses=True))
    seen = [due.late_s(*at) for at in ((1.003, 5, 1.0), (1.02, 5, 1.0), (1.021, 6, 1.02))]
    assert seen == pytest.approx([0.003, None, 0.001], abs=1e-9)


def test_a_period_that_the_link_learns_by_connecting_counts() -> None:
    radio = link(0.5)
    due = FrameLateness(radio)
    radio.period_s = 0.02
    assert [due.late_s(now, 0, 0.0) for now in (1.0, 1.02, 1.05)] == pytest.approx([0.0, 0.0, 0.01], abs=1e-9)
