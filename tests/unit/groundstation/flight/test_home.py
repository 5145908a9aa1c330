"""Place of take-off: where a flight returns to."""

from types import SimpleNamespace
from typing import Any

import pytest

from groundstation.core.geometry import IDENTITY
from groundstation.core.messages import Pose, notice
from groundstation.core.mission import Event
from groundstation.core.pilot import MONITORS, Pilot
from groundstation.core.safety import SpoolUp
from groundstation.flight.controller import FlightController
from sim.scenarios import SCENARIOS, prepare


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
