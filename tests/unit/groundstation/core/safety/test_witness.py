"""The second witness: does the autopilot's own attitude agree with the poses'?"""

import math
from collections.abc import Callable

import pytest

from groundstation.core.geometry import Quat, multiply, so3
from groundstation.core.messages import Pose
from groundstation.core.safety import Agreement, Witness
from links.core import Attitude

POSE_S = 0.02
ATTITUDE_S = 0.1
NORTH_RAD = 0.7
"""The autopilot has another north."""
Angles = tuple[float, float, float]
"""Roll, pitch and yaw [rad]."""


def swing(time_s: float) -> Angles:
    return 0.12 * math.sin(3.1 * time_s), 0.1 * math.sin(2.3 * time_s + 1.0), 0.0


def still(time_s: float) -> Angles:
    return 0.0, 0.0, 0.0


def quaternion(angles: Angles) -> Quat:
    return so3.from_euler_zyx(*angles)


def same(angles: Angles) -> Angles:
    return angles


def told(time_s: float, angles: Angles) -> Attitude:
    north = so3.from_euler_zyx(0.0, 0.0, -NORTH_RAD)
    return Attitude(time_s=time_s, attitude=multiply(north, quaternion(angles)), rates_rad_s=(0.0, 0.0, 0.0))


def watch(
    motion: Callable[[float], Angles],
    shown: Callable[[Angles], Angles] = same,
    *,
    armed_s: float = 2.0,
    lasts_s: float = 8.0,
    lean: Callable[[Angles], Angles] = same,
    witness: Witness | None = None,
) -> Agreement | None:
    """Verdict on poses that are ``shown`` of ``motion`` once armed, where the autopilot feels ``lean`` of it."""
    witness = witness or Witness()
    verdict = None
    for n in range(round(lasts_s / POSE_S)):
        time_s = n * POSE_S
        true = motion(time_s)
        is_armed = time_s >= armed_s
        if is_armed:
            witness.arm()
        angles = shown(true) if is_armed else true
        witness.add_pose(Pose(n, time_s, time_s, (0.0, 0.0, 0.0), quaternion(angles)))
        if n % round(ATTITUDE_S / POSE_S) == 0:
            witness.add_attitude(told(time_s, lean(true) if is_armed else true))
        verdict = witness.verdict(time_s)
    return verdict


def test_a_body_that_hangs_still_says_neither() -> None:
    verdict = watch(still)
    assert verdict is not None and verdict.agrees is None and verdict.disagrees_since_s is None


@pytest.mark.parametrize(("late_s", "agrees"), [(0.0, True), (0.04, True), (0.16, False), (0.3, False)])
def test_poses_that_come_later_than_the_autopilot_turns_are_doubted(late_s: float, agrees: bool) -> None:
    witness, verdict = Witness(), None
    for n in range(round(8.0 / POSE_S)):
        time_s = n * POSE_S
        if time_s >= 2.0:
            witness.arm()
        behind = late_s if time_s >= 2.0 else 0.0
        witness.add_pose(Pose(n, time_s, time_s, (0.0, 0.0, 0.0), quaternion(swing(time_s - behind))))
        if n % round(ATTITUDE_S / POSE_S) == 0:
            witness.add_attitude(told(time_s, swing(time_s)))
        verdict = witness.verdict(time_s)
    assert verdict is not None and verdict.agrees is agrees


def test_a_tilt_that_was_there_before_arming_is_how_the_body_is_mounted() -> None:
    askew = math.radians(5.0)
    witness = Witness()
    for n in range(400):
        time_s = n * POSE_S
        witness.add_pose(Pose(n, time_s, time_s, (0.0, 0.0, 0.0), quaternion((askew, 0.0, 0.0))))
        witness.add_attitude(told(time_s, (0.0, 0.0, 0.0)))
    verdict = witness.verdict(8.0)
    assert verdict is not None and verdict.mounting_deg == pytest.approx(5.0, abs=0.1)
    assert verdict.tilt_deg == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(("off_deg", "doubted"), [(7.0, False), (14.0, True)])
def test_a_tilt_that_comes_after_arming_is_doubted_beyond_ten_degrees(off_deg: float, doubted: bool) -> None:
    off = math.radians(off_deg)
    verdict = watch(still, lambda a: (a[0] + off, a[1], a[2]))
    assert verdict is not None and (verdict.agrees is False) is doubted


def test_an_autopilot_that_takes_a_third_of_a_lean_for_level_is_believed() -> None:
    def lean(time_s: float) -> Angles:
        return (0.0, math.radians(25.0) * min(max(time_s - 2.0, 0.0) / 2.0, 1.0), 0.0)

    verdict = watch(lean, lean=lambda a: (a[0], 0.75 * a[1], a[2]))
    assert verdict is not None and verdict.agrees is not False


def test_without_attitudes_there_is_no_witness() -> None:
    witness = Witness()
    for n in range(100):
        witness.add_pose(Pose(n, n * POSE_S, n * POSE_S, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
    assert witness.verdict(2.0) is None
    assert witness.in_poses(told(2.0, (0.0, 0.0, 0.0))) is None


def test_an_attitude_is_told_in_the_axes_of_the_poses() -> None:
    witness = Witness()
    watch(swing, witness=witness)
    found = witness.in_poses(told(8.0, (0.1, -0.05, 0.0)))
    assert found is not None
    assert abs(sum(a * b for a, b in zip(found, quaternion((0.1, -0.05, 0.0)), strict=True))) == pytest.approx(
        1.0, abs=1e-3
    )


def test_a_vehicle_that_is_moved_by_hand_shows_which_axes_go_the_same_way() -> None:
    witness = Witness()
    for n in range(300):
        time_s = n * POSE_S
        roll, pitch = 0.4 * math.sin(2.0 * time_s), 0.4 * math.sin(1.3 * time_s)
        witness.add_pose(Pose(n, time_s, time_s, (0.0, 0.0, 0.0), quaternion((roll, -pitch, 0.0))))
        witness.add_attitude(told(time_s, (roll, pitch, 0.0)))
    verdict = witness.verdict(6.0)
    assert verdict is not None
    assert "roll" in verdict.alike and "pitch" in verdict.unlike
