"""Course of a flight: touchdown by poses at rest, and the place to which it returns."""

from types import SimpleNamespace
from typing import Any

import pytest

from groundstation.core.geometry import IDENTITY
from groundstation.core.messages import Pose, notice
from groundstation.core.mission import Event
from groundstation.core.pilot import MONITORS, Pilot
from groundstation.core.safety import SpoolUp
from groundstation.flight.controller import FlightController
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


def test_a_source_that_moves_its_origin_during_the_spool_up_moves_the_place_of_take_off() -> None:
    _, config = prepare(SCENARIOS["paper"], ["flight.start=floor"])
    floor_z_m = config.flight.floor_z_m
    pilot = Pilot(config.vehicle, config.controller, config.flight.coast_s, floor_z_m)
    link: Any = SimpleNamespace(autopilot=None, status=None, period_s=0.02)
    listener: Any = SimpleNamespace(say=lambda *_: None, on_state=lambda *_: None)
    controller = FlightController(config, link, pilot, listener, None, MONITORS)

    def show(number: int, north_m: float, resets: int) -> None:
        place, time_s = (north_m, 0.0, floor_z_m), 0.02 * number
        controller.on_pose(Pose(number, time_s, time_s, place, IDENTITY, reset_count=resets))

    for number in range(100):
        show(number, 1.0, 0)
    for event in (Event.START, Event.CONNECTED, Event.ARM, Event.ARMED):
        controller.go(event, notice("mission.off_floor"), 2.0)
    assert isinstance(controller.phase, SpoolUp)
    show(101, 1.0, 0)
    assert controller._course.home == pytest.approx((1.0, 0.0, floor_z_m))
    show(102, 5.0, 1)
    assert controller._course.home == pytest.approx((5.0, 0.0, floor_z_m))
