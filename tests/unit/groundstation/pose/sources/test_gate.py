"""The gate: poses that can't be true, how they are told, and when a new place is believed."""

import asyncio
import math
import re
from collections.abc import Callable, Iterable
from typing import Any

import pytest
from hypothesis import given, strategies as st

from groundstation.core.geometry import Quat, Vec3, scale, so3
from groundstation.core.messages import Pose, PoseStatus, Sentence
from groundstation.pose.sources import Gate, GateConfig, GatedSource, describe_drop
from groundstation.pose.sources.intake import Outbreaks
from tests.loops import in_virtual_time

DT = 0.02
COAST_S = 0.25


def pose(n: int, place: Vec3 | None = None, attitude: Quat = so3.IDENTITY, **more: Any) -> Pose:
    """Pose ``n`` of a flight north at 1 m/s that sways a little."""
    time_s = n * DT
    where = (time_s, 1e-3 * math.sin(n), -1.0) if place is None else place
    return Pose(n, time_s, time_s + 0.02, where, attitude, **more)


def flown(gate: Gate, poses: Iterable[Pose]) -> tuple[list[Pose], list[Sentence]]:
    passed, events = [], []
    for one in poses:
        through, event = gate.filter_pose(one)
        passed += [through] if through is not None else []
        events += [event] if event is not None else []
    return passed, events


def yawed(degrees: float) -> Quat:
    return so3.from_euler_zyx(0.0, 0.0, math.radians(degrees))


def gate_in_flight(until: int = 20, **limits: Any) -> Gate:
    gate = Gate(GateConfig(**limits))
    passed, events = flown(gate, map(pose, range(until)))
    assert len(passed) == until
    assert not events
    return gate


def leaning(degrees: float) -> Quat:
    return so3.from_euler_zyx(math.radians(degrees), 0.0, 0.0)


@pytest.mark.parametrize("degrees", [20.0, 40.0, 80.0])
def test_a_floor_levels_what_comes_down_leaning_and_nothing_else_turns_so_fast(
    degrees: float,
) -> None:
    gate = Gate(GateConfig(rate_deg_s=100.0))
    leans = [pose(n, attitude=leaning(degrees)) for n in range(10)]
    passed, _ = flown(gate, [*leans, *(pose(n) for n in range(10, 20))])
    assert len(passed) == 20
    dropped = Gate(GateConfig(rate_deg_s=100.0))
    flown(dropped, [*(pose(n) for n in range(10)), pose(10, attitude=leaning(degrees))])
    assert dropped.dropped["spin"] == 1


@pytest.mark.parametrize(
    ("wrong", "reason", "told"),
    [
        (pose(20, (0.4, math.nan, -1.0)), "not_finite", ""),
        (pose(20, attitude=(math.inf, 0.0, 0.0, 0.0)), "not_finite", ""),
        (pose(20, attitude=(0.0, 0.0, 0.0, 0.0)), "not_unit", ""),
        (pose(20, attitude=(0.89, 0.0, 0.0, 0.0)), "not_unit", ""),
        (pose(20, attitude=(1.1, 0.0, 0.0, 0.0)), "not_unit", ""),
        (pose(20, (0.4, 0.5, -1.0)), "jump", r" \(0.50 m .*, limit 0.1\d m \(gate.jump_m"),
        (pose(20, attitude=yawed(90.0)), "spin", r" \(turned by 90° .*, limit \d+° \(gate.rate_"),
        (pose(20, attitude=leaning(180.0)), "tilted", r" \(180° from .*, limit 120° .*carry"),
        (pose(20, velocity_ned=(0.0, 30.0, 0.0)), "too_fast", r" \(30.0 m/s, limit 20 m/s \(gate"),
        (pose(19), "out_of_order", ""),
        (pose(3), "out_of_order", ""),
    ],
)
def test_what_can_not_be_true_is_told_with_its_limit_and_the_next_good_pose_passes(
    wrong: Pose, reason: str, told: str
) -> None:
    gate = gate_in_flight()
    assert gate.filter_pose(wrong) == (None, None)
    assert gate.dropped == {reason: 1}
    assert re.match(reason + told, describe_drop(reason, gate.excesses).text)
    good = pose(21)
    assert gate.filter_pose(good) == (good, None)


def test_a_tilt_is_judged_by_the_configured_limit() -> None:
    gate = gate_in_flight(tilt_deg=10.0)
    gate.filter_pose(pose(20, attitude=leaning(12.0)))
    told = describe_drop("tilted", gate.excesses).text
    assert re.match(r"tilted \(12° .*10° \(gate.tilt_", told)


def test_a_body_that_creeps_away_too_fast_is_dropped_though_each_step_is_small() -> None:
    gate = gate_in_flight(speed_m_s=3.0)
    place, speed = 20 * DT, 1.0
    for n in range(20, 60):
        speed += 0.2
        place += speed * DT
        gate.filter_pose(pose(n, (place, 0.0, -1.0)))
    assert set(gate.dropped) == {"too_fast"}


def test_a_frozen_pose_passes_for_a_moment_and_then_no_more_until_it_moves() -> None:
    gate = gate_in_flight(frozen_s=0.09)
    passed, _ = flown(gate, (pose(n, (0.4, 0.0, -1.0)) for n in range(20, 40)))
    assert len(passed) == 5
    assert gate.dropped == {"frozen": 15}
    assert gate.filter_pose(pose(40, (0.41, 0.0, -1.0)))[0] is not None


def test_a_gap_allows_for_what_the_vehicle_may_have_done_meanwhile_and_no_more() -> None:
    swerve = pose(30, (0.6 + 0.4, 0.0, -1.0))  # 0.2 s later and 0.4 m ahead of where it was heading
    assert gate_in_flight(20).filter_pose(swerve)[0] is not None
    assert gate_in_flight(30).filter_pose(swerve)[0] is None


def test_of_a_crowd_of_wild_poses_none_passes_because_it_happens_to_come_near() -> None:
    near = pose(24, (24 * DT + 0.15, 0.0, -1.0))
    assert gate_in_flight(24).filter_pose(near)[0] is not None, "one such step by itself is borne"
    gate = gate_in_flight(20)
    wild = [pose(n, (n * DT, 0.6 * (-1.0) ** n, -0.5)) for n in range(20, 24)]
    passed, _ = flown(gate, [*wild, near])
    assert not passed
    swerve = pose(25, (25 * DT, 0.5 * 5.0 * (6 * DT) ** 2, -1.0))  # at 5 m/s², as it may have
    assert gate.filter_pose(swerve)[0] is not None


def test_poses_that_stay_elsewhere_are_believed_after_a_while_and_not_before() -> None:
    gate = gate_in_flight()
    there = [pose(n, (5.0 + n * DT, 2e-3 * math.sin(n), -1.0)) for n in range(20, 200)]
    passed, (moved,) = flown(gate, there)
    assert moved.id == "pose.elsewhere"
    assert "6.5" in str(moved)
    assert "agreed" in str(moved)
    assert passed[0].time_s == pytest.approx(20 * DT + 1.5, abs=DT + 1e-9)
    assert gate.dropped == {"jump": 75}
    assert len({one.reset_count for one in passed}) == 1
    assert passed[0].reset_count != 0, "who follows the poses must know that they are elsewhere"


def test_a_wrong_body_is_not_believed_as_time_passes_but_the_true_one_when_it_is_back() -> None:
    gate = gate_in_flight()
    away = [pose(n, (1.2, 0.5 + 1e-4 * n, -1.0)) for n in range(20, 80)]
    passed, _ = flown(gate, away)
    assert not passed, "1 m away could have been reached within a second, but not at once"
    passed, _ = flown(gate, (pose(n) for n in range(80, 90)))
    assert len(passed) == 10


def test_a_flight_in_any_direction_is_expected_to_go_on_and_its_quaternion_keeps_its_sign() -> None:
    gate, (w, x, y, z) = Gate(GateConfig()), so3.from_euler_zyx(0.3, -0.2, 2.0)
    signs = [(-1.0) ** n for n in range(20)]
    passed, _ = flown(
        gate,
        (
            pose(n, scale(n * DT, (1.0, -1.5, 0.5)), (s * w, s * x, s * y, s * z))
            for n, s in enumerate(signs)
        ),
    )
    assert [one.attitude for one in passed] == [(w, x, y, z)] * 20
    gate.filter_pose(pose(25, (1.0, 1.0, 1.0), (w, x, y, z)))
    assert gate.excesses["jump"] == pytest.approx((1.968501969, 0.51))
    turned = so3.multiply((w, x, y, z), so3.from_euler_zyx(0.6, 0.8, -1.0))
    gate.filter_pose(pose(20, scale(20 * DT, (1.0, -1.5, 0.5)), turned))
    assert gate.excesses["spin"] == pytest.approx((88.37996791, 35.0))


def test_what_the_source_itself_has_moved_is_believed_at_once() -> None:
    gate = gate_in_flight()
    moved = pose(20, (5.0, 0.0, -1.0), reset_count=1)
    passed, event = gate.filter_pose(moved)
    assert passed == moved
    assert event is not None and event.id == "pose.elsewhere"
    assert gate.filter_pose(pose(21, (5.02, 0.0, -1.0), reset_count=1))[1] is None
    assert not gate.dropped


@pytest.mark.parametrize(("apart_s", "third"), [(2.4, "origin_moves"), (2.6, "elsewhere")])
def test_the_third_move_within_five_seconds_is_told_as_a_fault_of_its_own(
    apart_s: float, third: str
) -> None:
    moved = (pose(20 + round(k * apart_s / DT), reset_count=k) for k in (1, 2, 3))
    _, told = flown(gate_in_flight(), moved)
    assert [one.id for one in told] == ["pose.elsewhere", "pose.elsewhere", f"pose.{third}"]


@given(
    st.lists(
        st.builds(
            Pose,
            id=st.integers(0, 9),
            time_s=st.floats() | st.floats(0.0, 5.0),
            arrival_s=st.floats(),
            position_ned=st.tuples(*[st.floats() | st.floats(-2.0, 2.0)] * 3),
            attitude=st.tuples(*[st.floats() | st.floats(-1.0, 1.0)] * 4) | st.just(so3.IDENTITY),
            velocity_ned=st.none() | st.tuples(*[st.floats()] * 3),
            reset_count=st.integers(-5, 5),
        ),
        max_size=30,
    )
)
def test_nothing_makes_it_raise_and_each_pose_passes_or_is_counted(poses: list[Pose]) -> None:
    gate = Gate(GateConfig())
    passed, _ = flown(gate, poses)
    assert len(passed) + gate.dropped.total() == len(poses)
    for one in passed:
        assert math.isfinite(sum(one.position_ned) + one.time_s)
        assert math.hypot(*one.attitude) == pytest.approx(1.0, abs=1e-6)


def test_an_outbreak_is_told_once_as_it_begins_and_once_as_it_is_over() -> None:
    outbreaks = Outbreaks(COAST_S)
    told: list[Sentence] = []
    for n in range(300):
        count = max(0, min(n, 50) - 9) + max(0, min(n, 250) - 243)
        status = PoseStatus(0, {"not_tracked": count, "jump": 0})
        told += outbreaks.look(0.05 * n, status, None)
    assert [event.id for event in told] == 2 * ["pose.dropping", "pose.passed"]
    assert "hidden" in str(told[0])
    assert "41 dropped" in str(told[1])
    assert "7 dropped" in str(told[3])


def look_on(*looks: tuple[float, PoseStatus, Pose | None]) -> list[tuple[float, str]]:
    """When news comes of ``looks`` [s], and of what."""
    outbreaks = Outbreaks(COAST_S)
    return [
        (now_s, event.id)
        for now_s, status, newest in looks
        for event in outbreaks.look(now_s, status, newest)
    ]


def late(by_s: float) -> PoseStatus:
    return PoseStatus(1, {}, late_s=by_s)


def test_lateness_is_told_as_it_begins_as_it_doubles_and_after_its_end() -> None:
    lateness = [0.0, 0.03, 0.06, 0.061, 0.1, *[0.0] * 35]
    told = look_on(*((0.1 * k, late(by_s), None) for k, by_s in enumerate(lateness)))
    assert [event for _, event in told] == ["pose.later", "pose.later", "pose.punctual"]
    assert [now_s for now_s, _ in told] == pytest.approx([0.1, 0.3, 2.4])


def test_poses_that_are_lost_and_come_back_are_told_after_the_limit() -> None:
    newest = [(0.25, pose(0)), (0.26, pose(0)), (0.5, pose(0)), (0.51, pose(25))]
    told = look_on(*((now_s, PoseStatus(1, {}), one) for now_s, one in newest))
    assert told == [(0.26, "pose.lost"), (0.51, "pose.back")]


def test_drops_of_before_the_first_look_are_news_and_an_unsteady_clock_is_told_both_ways() -> None:
    steady, unsteady = PoseStatus(0, {"jump": 1}), PoseStatus(0, {"jump": 1}, unsteady_clock=True)
    looks = [(0.0, steady), (1.9, unsteady), (2.1, steady), (4.2, steady)]
    told = look_on(*((now_s, status, None) for now_s, status in looks))
    assert told[:2] == [(0.0, "pose.dropping"), (1.9, "pose.unsteady_clock")]
    assert told[2:] == [(2.1, "pose.steady_clock"), (2.1, "pose.passed")]


class HandFed:
    """A source that delivers what a test feeds it."""

    status = PoseStatus(22, {})

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        self.feed = deliver

    async def close(self) -> None:
        pass


@in_virtual_time
async def test_a_source_with_a_gate_counts_its_moves_and_tells_that_poses_are_lost() -> None:
    source, told = HandFed(), list[Sentence]()
    gated = GatedSource(source, GateConfig(), lost_s=COAST_S, say=told.append)
    await gated.start(lambda pose: None)
    for n, resets in ((0, 0), (1, 1), (2, 2)):
        source.feed(pose(n, reset_count=resets))
    assert gated.status.origin_moves == 2
    await asyncio.sleep(1.0)
    assert [event.id for event in told] == ["pose.elsewhere", "pose.elsewhere", "pose.lost"]
    await gated.close()
