"""The dead man's switch: nothing stale leaves, one bring-down, and only a new arming ends it.

And the curve of thrust, which a signal undoes.
"""

import math
from typing import Any

import msgspec
import pytest
from hypothesis import given, strategies as st

from groundstation.core.geometry import so3
from links.core import (
    Attitude,
    Command,
    Deadman,
    LinkMisuse,
    Phase,
    Segment,
    full_thrust_n,
    signal,
    thrust,
)

LEVEL = Segment(0.5, 0.7, (0.1, 0.0, 0.0))
SINK = Segment(1.0, 0.6, (0.0, 0.0, 0.0))
BAD = (math.nan, math.inf)


def command(pose_time_s: float, thrust_n: float = 0.8) -> Command:
    return Command(thrust_n, (0.0, 0.0, 0.0), 1, pose_time_s, pose_time_s + 0.25, (LEVEL, SINK))


def armed() -> Deadman:
    deadman = Deadman()
    deadman.arm()
    return deadman


def test_nothing_leaves_before_an_arming_and_before_a_command() -> None:
    deadman = Deadman()
    assert not deadman.take(command(0.0), 0.1)
    assert deadman.at(0.1) is None
    deadman.arm()
    assert deadman.phase(0.1) is Phase.WAITING
    assert deadman.at(0.1) is None


def test_a_command_is_repeated_until_its_deadline_and_then_brought_down_once() -> None:
    deadman = armed()
    newest = command(1.0)
    assert deadman.take(newest, 1.01)
    for first_s, last_s, leaves in ((1.01, 1.25, newest), (1.26, 1.75, LEVEL), (1.76, 2.75, SINK)):
        assert deadman.at(first_s) is deadman.at(last_s) is leaves
    assert deadman.at(2.76) is None
    assert deadman.phase(2.0) is Phase.OVER, "even on a clock that steps back"


def test_one_that_is_held_plays_what_it_has_and_takes_nothing_newer_until_armed_anew() -> None:
    deadman = armed()
    newest = command(1.0)
    deadman.take(newest, 1.01)
    deadman.hold()
    assert not deadman.take(command(1.1), 1.11)
    assert (deadman.at(1.2), deadman.at(1.3), deadman.at(2.0)) == (newest, LEVEL, SINK)
    assert deadman.phase(2.8) is Phase.OVER
    deadman.arm()
    assert deadman.take(command(3.0), 3.01)
    deadman.arm()
    assert deadman.at(3.02) is None, "an arming forgets the command before"
    deadman.hold()
    assert not deadman.take(command(3.02), 3.02)
    assert deadman.phase(3.02) is Phase.OVER, "held before any command"


def test_late_and_disordered_commands_are_refused_and_counted() -> None:
    deadman = armed()
    assert not deadman.take(command(1.0), 1.3)
    newest = command(2.0)
    assert deadman.take(newest, 2.0)
    assert not deadman.take(command(1.9), 2.0)
    assert deadman.at(2.0) is newest
    assert deadman.refused == 2


def test_a_stop_leaves_out_the_bring_down() -> None:
    deadman = armed()
    deadman.take(command(1.0), 1.0)
    deadman.stop()
    assert deadman.at(1.1) is deadman.at(1.3) is None
    assert deadman.command is None, "nor does whoever takes over get it"


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        *(
            ({field: bad}, "not finite")
            for field in ("thrust_n", "deadline_s", "pose_time_s")
            for bad in BAD
        ),
        ({"bring_down": (LEVEL, msgspec.structs.replace(SINK, duration_s=2.1))}, "at most 2 s"),
        ({"bring_down": (LEVEL, msgspec.structs.replace(SINK, duration_s=-0.1))}, "no duration"),
        ({"deadline_s": 2.2}, "deadline"),
    ],
)
def test_what_no_command_can_be_is_a_bug_of_the_caller(changes: dict[str, Any], says: str) -> None:
    deadman = armed()
    with pytest.raises(LinkMisuse, match=says):
        deadman.take(msgspec.structs.replace(command(1.0), **changes), 1.0)
    assert deadman.at(1.0) is None


def test_the_instants_of_change_are_known_in_advance() -> None:
    deadman = Deadman()
    assert deadman.changes_s(1.0) == math.inf
    deadman.arm()
    assert deadman.changes_s(1.0) == math.inf
    deadman.take(command(1.0), 1.0)
    now, seen = 1.0, []
    while (change := deadman.changes_s(now)) < math.inf:
        seen.append(change)
        now = change + 1e-6
    assert seen == pytest.approx([1.25, 1.75, 2.75])
    last = armed()
    last.take(command(1.0), 1.0)
    assert [last.changes_s(at) for at in (1.25, 1.75)] == [1.25, 1.75], "not over at the instant"


@given(
    st.lists(st.tuples(st.floats(0.0, 0.6), st.floats(0.0, 0.6)), min_size=1, max_size=20),
    st.lists(st.floats(0.0, 3.0), min_size=1, max_size=20),
)
def test_whatever_leaves_is_fresh_or_the_bring_down_of_the_newest_command(
    steps: list[tuple[float, float]], looks: list[float]
) -> None:
    deadman, now, newest, over = armed(), 1.0, None, False
    for (wait, age), look in zip(steps, looks, strict=False):
        now += wait
        sent = command(now - age)
        expected = age <= 0.25 and not over and (newest is None or now <= newest.deadline_s)
        expected = expected and (newest is None or sent.pose_time_s >= newest.pose_time_s)
        assert deadman.take(sent, now) == expected
        newest = sent if expected else newest
        now += look
        leaves = deadman.at(now)
        if newest is None:
            assert leaves is None
        elif now <= newest.deadline_s and not over:
            assert leaves is newest
        else:
            over = True
            assert leaves in (LEVEL, SINK, None)
            assert now <= newest.deadline_s + 1.5 + 1e-9 or leaves is None


@given(roll=st.floats(-3.1, 3.1), pitch=st.floats(-1.5, 1.5), yaw=st.floats(-3.1, 3.1))
def test_an_attitude_is_told_in_the_angles_by_which_it_was_turned(
    roll: float, pitch: float, yaw: float
) -> None:
    """About the body's z, y and x axes, one after the other (MAVLink's ATTITUDE)."""
    attitude = so3.from_euler_zyx(roll, pitch, yaw)
    assert Attitude(0.0, attitude, None).angles_rad == pytest.approx((roll, pitch, yaw), abs=1e-6)


# ---- the curve of thrust

share = st.floats(0.0, 1.0)


@given(share, share)
def test_the_signal_gives_the_thrust_that_was_asked_for(wanted: float, factor: float) -> None:
    assert thrust(signal(wanted, factor), factor) == pytest.approx(wanted, abs=1e-12)


@given(st.floats(0.05, 0.95), share)
def test_the_signal_that_carries_the_vehicle_tells_the_full_thrust(
    weight_share: float, factor: float
) -> None:
    hover = signal(weight_share, factor)
    assert full_thrust_n(20.0 * weight_share, hover, factor) == pytest.approx(20.0)


@pytest.mark.parametrize(("thrust", "curve", "half"), [
    (0.37, 0.0, 0.37),  # no curve
    (0.25, 1.0, 0.5),  # thrust is the square of the signal
    (0.3375, 0.65, 0.5),  # MOT_THST_EXPO 0.65: 0.65 * 0.25 + 0.35 * 0.5
])  # fmt: skip
def test_the_signal_is_the_inverse_of_the_curve(thrust: float, curve: float, half: float) -> None:
    assert signal(thrust, curve) == pytest.approx(half)


@pytest.mark.parametrize("factor", [0.0, 0.65, 1.0])
def test_thrust_beyond_the_range_is_clamped(factor: float) -> None:
    assert signal(-0.1, factor) == 0.0
    assert signal(1.5, factor) == 1.0
