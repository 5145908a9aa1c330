"""A place that stopped dead: what a frozen picture, an outage and wind that the law answers come to."""

import pytest

from groundstation.core.geometry import IDENTITY, ZERO
from groundstation.core.messages import Pose
from groundstation.core.safety.health import StopDetector
from groundstation.core.vehicle import Motion

DT_S = 0.02
NOISE_M = 0.0003


def watch(places_m: list[float], model_m_s: list[float], push_m_s2: float = 0.0) -> tuple[bool, bool]:
    """Whether a vehicle whose north is at ``places_m`` by its poses stopped dead; and whether it is to be asked.

    The model has it at ``model_m_s`` before each pose, and pushes it by ``push_m_s2``.
    """
    detector, stopped, asked, since_s = StopDetector(), False, False, 0.0
    for n, (place_m, speed_m_s) in enumerate(zip(places_m, model_m_s, strict=True)):
        pose = Pose(n, since_s, since_s, (place_m, 0.0, -1.0), IDENTITY)
        before, push = Motion((0.0, 0.0, -1.0), (speed_m_s, 0.0, 0.0), IDENTITY, 0.8, ZERO), (push_m_s2, 0.0, 0.0)
        stopped |= detector.add_pose(pose, before, push, ZERO, DT_S, NOISE_M) is not None
        asked |= detector.is_driven
        since_s += DT_S
    return stopped, asked


def test_a_speed_that_only_the_model_has_is_no_stop() -> None:
    """After an outage in gusts the model may have a speed that no pose has shown."""
    assert watch(30 * [0.0], 30 * [0.3]) == (False, False)


@pytest.mark.parametrize(("speed_m_s", "push_m_s2", "stopped"), [
    (0.3, 0.0, True), (-0.6, 0.0, True), (1.5, 0.0, True),
    (0.16, 0.0, True), (0.14, 0.0, False),  # a collision takes .15 m/s within a pose; less is noise and wind
    (0.24, 3.0, True), (0.21, 3.0, False),  # and 25 ms of a push beyond that: commands may be mistimed so
])  # fmt: skip
def test_a_picture_that_freezes_is_stopped_dead_unless_its_motion_was_slow(
    speed_m_s: float, push_m_s2: float, stopped: bool
) -> None:
    moves = [n * DT_S * speed_m_s for n in range(10)]
    assert watch(moves + 9 * moves[-1:], 19 * [speed_m_s], push_m_s2)[0] is stopped


@pytest.mark.parametrize(
    ("push_m_s2", "stopped", "asked"),
    [(0.3, False, False), (1.0, False, True), (1.25, False, True), (1.4, True, True), (2.5, True, True)],
)
def test_a_place_that_stands_while_commands_push_is_asked_and_beyond_any_wind_accused(
    push_m_s2: float, stopped: bool, asked: bool
) -> None:
    assert watch(28 * [0.0], 28 * [0.0], push_m_s2) == (stopped, asked)
