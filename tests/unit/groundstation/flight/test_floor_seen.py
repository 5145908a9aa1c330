"""Touchdown by poses at rest, where their height may not be believed."""

from types import SimpleNamespace
from typing import Any

import pytest

from groundstation.core.geometry import IDENTITY
from groundstation.core.messages import Pose
from groundstation.flight.controller.course import Course
from sim.scenarios import SCENARIOS, prepare


@pytest.mark.parametrize(
    ("believes_height", "model_height_m", "lands"),
    [(True, 1.8, True), (False, 1.8, False), (False, 0.1, True)],
)
def test_poses_that_are_not_believed_show_the_floor_only_where_the_model_is_near_it(
    believes_height: bool, model_height_m: float, lands: bool
) -> None:
    """Heights that are mirrored stand at the floor's while the vehicle hovers high above."""
    _, config = prepare(SCENARIOS["paper"], ["flight.start=floor"])
    course, floor_z_m = Course(config), config.flight.floor_z_m
    course.believes_height = believes_height
    place = (0.0, 0.0, floor_z_m - model_height_m)
    motion = SimpleNamespace(
        position=place, velocity=(0.0, 0.0, 0.5), attitude=IDENTITY, thrust=config.weight_n
    )
    landed = False
    for number in range(60):
        pose = Pose(number, 0.02 * number, 0.02 * number, (0.0, 0.0, floor_z_m - 0.04), IDENTITY)
        tick: Any = SimpleNamespace(
            time_s=pose.time_s, pose=pose, estimate=SimpleNamespace(motion=motion),
            reference=SimpleNamespace(velocity_ned=(0.0, 0.0, 0.5)),
            command=SimpleNamespace(thrust_n=config.weight_n),
        )  # fmt: skip
        landed = landed or course.detect_touchdown(tick, float("inf"), uplink_ok=True)
    assert landed == lands
