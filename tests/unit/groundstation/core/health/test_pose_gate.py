"""The gate of poses: which ones the model can have come to."""

import math
import random
from statistics import fmean

import pytest
from hypothesis import given, strategies as st

from groundstation.core.geometry import Vec3, add, scale
from groundstation.core.health.pose_gate import PoseGate, PushMonitor
from groundstation.core.messages import Pose
from groundstation.core.vehicle import Motion

PERIOD_S = 0.02
NOISE_M = 0.0003
SPEED_M_S = 2.0
AT_REST: Vec3 = (0.0, 0.0, 0.0)


def motion(time_s: float) -> Motion:
    """The model's: north at 2 m/s."""
    return Motion(
        (SPEED_M_S * time_s, 0.0, -1.0), (SPEED_M_S, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 1.0, AT_REST
    )


def believed(shown_s: dict[int, float], aside_m: dict[int, float], count: int = 30) -> list[bool]:
    """Which of ``count`` poses at 50 Hz are believed, the n-th showing the place of ``shown_s[n]``,
    east by metres.
    """
    gate, answers, last_s = PoseGate(), list[bool](), 0.0
    for n in range(count):
        time_s = n * PERIOD_S
        shown = shown_s.get(n, time_s)
        place = (SPEED_M_S * shown, aside_m.get(n, 0.0), -1.0)
        pose = Pose(n, time_s, time_s, place, (1.0, 0.0, 0.0, 0.0))
        answers.append(gate.accepts(pose, motion(last_s), motion(time_s), NOISE_M))
        if answers[-1]:
            last_s = time_s
    return answers


@pytest.mark.parametrize(("late_s", "lost"), [(0.001, 0), (0.003, 3), (0.006, 1)])
def test_one_exposure_that_was_late_costs_few_poses(late_s: float, lost: int) -> None:
    """One that is just believed spoils the speed of the next; another costs itself alone."""
    answers = believed({10: 10 * PERIOD_S - late_s}, {})
    assert answers.count(False) == lost
    assert all(answers[:10]) and all(answers[14:])


STAYS = [True] * 10 + [False] * 20


def test_poses_that_jump_aside_are_believed_no_more_before_they_come_back() -> None:
    assert believed({}, dict.fromkeys(range(10, 30), 0.3)) == STAYS
    answers = believed({}, dict.fromkeys(range(10, 15), 0.3))
    assert not any(answers[10:15]) and all(answers[20:])


def test_a_place_that_stops_within_one_pose_is_believed_no_more() -> None:
    assert believed(dict.fromkeys(range(10, 30), 9 * PERIOD_S), {}) == STAYS


def largest_share(push: Vec3, commanded: Vec3, noise_m: float, period_s: float) -> float:
    """The largest share in half a second of a ``push`` beside what is ``commanded`` [m/s², NED]."""
    draws, monitor, shares = random.Random(1), PushMonitor(), [0.0]
    for n in range(round(0.5 / period_s)):
        time_s = n * period_s
        model = scale(0.5 * time_s * time_s, commanded)
        moved = add(add(model, (0.3 * time_s, 0.0, 0.0)), scale(0.5 * time_s * time_s, push))
        north, east, down = (part + draws.gauss(0.0, noise_m) for part in moved)
        shares.append(monitor.add(time_s, (north, east, down), model, noise_m))
    return max(shares)


noises = st.floats(0.0, 0.004)
periods = st.sampled_from([0.004, 0.01, 0.02, 0.05])
commands = st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0), st.floats(-8.0, 9.8))


@given(st.floats(0.0, 10.0), commands, noises, periods)
def test_no_push_of_1_g_and_no_noise_fails_true_poses(
    push_m_s2: float, commanded: Vec3, noise_m: float, period_s: float
) -> None:
    assert (
        largest_share((0.6 * push_m_s2, -0.8 * push_m_s2, 0.0), commanded, noise_m, period_s) < 1.0
    )


@given(st.floats(0.0, 1.2), commands, noises, periods)
def test_nothing_that_holds_the_vehicle_fails_true_poses(
    share: float, commanded: Vec3, noise_m: float, period_s: float
) -> None:
    """A cable that springs gives a little more than it takes."""
    assert largest_share(scale(-share, commanded), commanded, noise_m, period_s) < 1.0


def test_noise_widens_the_limit_to_five_times_its_own_scatter() -> None:
    draws, monitor, noise_m, shares = random.Random(1), PushMonitor(), 10.0, list[float]()
    for n in range(4000):
        north, east, down = (draws.gauss(0.0, noise_m) for _ in range(3))
        shares.append(monitor.add(n * PERIOD_S, (north, east, down), AT_REST, noise_m))
    scatter = math.sqrt(fmean(share * share for share in shares[100:]) / 3.0)
    assert scatter == pytest.approx(1.0 / 5.0, rel=0.05)


@pytest.mark.parametrize("tilt_deg", [38.0, 45.0, 60.0])
@pytest.mark.parametrize("period_s", [0.004, 0.01, 0.02])
def test_a_mirrored_position_fails_once_the_vehicle_leans(tilt_deg: float, period_s: float) -> None:
    """A mirrored vehicle seems pushed against its commands by twice what they give."""
    commanded = (9.81 * math.tan(math.radians(tilt_deg)), 0.0, 0.0)
    assert largest_share(scale(-2.0, commanded), commanded, 0.0005, period_s) >= 1.0
