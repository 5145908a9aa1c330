"""The second witness: does the autopilot's own attitude agree with the poses'?"""

import math
from collections.abc import Callable

import pytest

from groundstation.core.geometry import IDENTITY, ZERO, Quat, multiply, so3
from groundstation.core.health import Agreement, Witness
from groundstation.core.messages import Pose
from links.core import Attitude

POSE_S = 0.02
ATTITUDE_S = 0.1
ARMED_S = 2.0
NORTH_RAD = 0.7
"""The autopilot has another north."""
Angles = tuple[float, float, float]
"""Roll, pitch and yaw [rad]."""
Turning = Callable[[float], Angles]
"""The angles by the time [s]."""


def swing(time_s: float) -> Angles:
    return 0.12 * math.sin(3.1 * time_s), 0.1 * math.sin(2.3 * time_s + 1.0), 0.0


def still(time_s: float) -> Angles:
    return ZERO


def once_armed(time_s: float, value: float) -> float:
    return value if time_s >= ARMED_S else 0.0


def quaternion(angles: Angles) -> Quat:
    return so3.from_euler_zyx(*angles)


def told(time_s: float, angles: Angles) -> Attitude:
    north = so3.from_euler_zyx(0.0, 0.0, -NORTH_RAD)
    return Attitude(time_s=time_s, attitude=multiply(north, quaternion(angles)), rates_rad_s=ZERO)


def watch(
    shown: Turning,
    felt: Turning,
    *,
    armed_s: float = ARMED_S,
    lasts_s: float = 8.0,
    witness: Witness | None = None,
) -> Agreement:
    """Verdict on poses that show one motion while the autopilot feels another."""
    witness, verdict = witness or Witness(), None
    for n in range(round(lasts_s / POSE_S)):
        time_s = n * POSE_S
        if time_s >= armed_s:
            witness.arm()
        witness.add_pose(Pose(n, time_s, time_s, ZERO, quaternion(shown(time_s))))
        if n % round(ATTITUDE_S / POSE_S) == 0:
            witness.add_attitude(told(time_s, felt(time_s)))
        verdict = witness.verdict(time_s)
    assert verdict is not None
    return verdict


def test_a_body_that_hangs_still_says_neither() -> None:
    verdict = watch(still, still)
    assert verdict.agrees is None and verdict.disagrees_since_s is None


@pytest.mark.parametrize(
    ("late_s", "since_s", "alarm", "tilt_deg"),
    [
        (0.0, None, 0.0, 0.0),
        (0.04, None, 0.0437245, 0.512955),
        (0.16, 6.4, 1.0, 1.81745),
        (0.3, 4.4, 1.0, 3.07219),
    ],
)
def test_poses_that_come_later_than_the_autopilot_turns_are_doubted(
    late_s: float, since_s: float | None, alarm: float, tilt_deg: float
) -> None:
    found = watch(lambda time_s: swing(time_s - once_armed(time_s, late_s)), swing)
    assert found.agrees is (since_s is None)
    assert found.disagrees_since_s == pytest.approx(since_s)
    assert (found.alarm, found.tilt_deg) == pytest.approx((alarm, tilt_deg), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize(
    ("since_s", "mounting_deg", "tilt_deg"), [(0.0, 5.81894, 0.0), (1.0, 0.556395, 5.26255)]
)
def test_a_tilt_that_was_there_before_arming_is_how_the_body_is_mounted(
    since_s: float, mounting_deg: float, tilt_deg: float
) -> None:
    """A tenth of one that comes 1 s before is learnt by then."""
    tilted = (math.radians(5.0), math.radians(-3.0), 0.0)
    found = watch(lambda time_s: tilted if time_s >= since_s else ZERO, still)
    assert (found.mounting_deg, found.tilt_deg) == pytest.approx((mounting_deg, tilt_deg), 1e-5)


@pytest.mark.parametrize(("off_deg", "alarm"), [(7.0, 0.69826), (14.0, 1.38611)])
def test_a_tilt_that_comes_after_arming_is_doubted_beyond_ten_degrees(
    off_deg: float, alarm: float
) -> None:
    verdict = watch(lambda time_s: (once_armed(time_s, math.radians(off_deg)), 0.0, 0.0), still)
    assert verdict.alarm == pytest.approx(alarm, rel=1e-5)
    assert (verdict.agrees is False) is (alarm >= 1.0)


def test_an_autopilot_that_takes_a_third_of_a_lean_for_level_is_believed() -> None:
    def lean(time_s: float, share: float = 1.0) -> Angles:
        return (0.0, share * math.radians(35.0) * min(max(time_s - ARMED_S, 0.0) / 2.0, 1.0), 0.0)

    found = watch(lean, lambda time_s: lean(time_s, 0.67))
    assert found.agrees is None
    assert found.alarm == pytest.approx(0.590709, rel=1e-5)


def test_without_attitudes_there_is_no_witness() -> None:
    witness = Witness()
    for n in range(100):
        witness.add_pose(Pose(n, n * POSE_S, n * POSE_S, ZERO, IDENTITY))
    assert witness.verdict(2.0) is None
    assert witness.convert_to_poses(told(2.0, ZERO)) is None


def test_an_attitude_is_told_in_the_axes_of_the_poses() -> None:
    witness, mounted = Witness(), (0.05, -0.02, 0.3)
    watch(lambda _: mounted, still, witness=witness)
    found = witness.convert_to_poses(told(8.0, ZERO))
    assert found == pytest.approx(quaternion(mounted), abs=3e-4)


def test_a_vehicle_that_is_moved_by_hand_shows_which_axes_go_the_same_way() -> None:
    def tipped(time_s: float, way: float) -> Angles:
        return 0.4 * math.sin(2.0 * time_s), way * 0.4 * math.sin(1.3 * time_s), 0.0

    verdict = watch(
        lambda t: tipped(t, -1.0), lambda t: tipped(t, 1.0), armed_s=math.inf, lasts_s=6.0
    )
    assert (verdict.alike, verdict.unlike) == (("roll",), ("pitch",))


def test_slow_attitudes_are_compared_as_soon_as_a_later_pose_is_there() -> None:
    witness = Witness()
    for n in range(200):
        time_s = n * POSE_S
        witness.add_pose(Pose(n, time_s, time_s, ZERO, IDENTITY))
        witness.pair_up()
        assert time_s < 1.0 or witness.verdict(time_s) is not None
        if n % 25 == 0:  # 2 Hz, between two poses
            witness.add_attitude(told(time_s + 0.5 * POSE_S, ZERO))
    assert witness.verdict(3.51 + 0.59) is not None
    assert witness.verdict(3.51 + 0.61) is None


def test_attitudes_wait_for_their_poses_and_older_ones_are_ignored() -> None:
    witness, newest_s = Witness(), 0.07
    for at_s in (0.03, 0.05, 0.05, 0.04, newest_s):
        witness.add_attitude(told(at_s, ZERO))
    for n in range(5):
        witness.add_pose(Pose(n, n * POSE_S, n * POSE_S, ZERO, IDENTITY))
    witness.pair_up()
    assert witness.verdict(newest_s + 0.59) is not None
    assert witness.verdict(newest_s + 0.61) is None


def test_a_disagreement_that_lasts_is_told_once_and_again_after_an_agreement() -> None:
    witness, told_s = Witness(), list[float]()
    witness.arm()
    for n in range(round(16.0 / POSE_S)):
        time_s = n * POSE_S
        off_rad = math.radians(20.0) if time_s % 8.0 >= ARMED_S else 0.0
        witness.add_pose(Pose(n, time_s, time_s, ZERO, quaternion((off_rad, 0.0, 0.0))))
        if n % round(ATTITUDE_S / POSE_S) == 0:
            witness.add_attitude(told(time_s, ZERO))
        if (said := witness.describe_news()) is not None:
            assert said.id == "pose.autopilot_disagrees"
            told_s.append(time_s)
    assert told_s == pytest.approx([ARMED_S + 2.0, 8.0 + ARMED_S + 2.0], abs=0.7)
