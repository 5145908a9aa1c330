"""The confirmation that the motors may start."""

import asyncio

import msgspec
import pytest

from groundstation.flight.preflight import LISTEN_S, confirm_arming
from groundstation.settings import Config
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop


@pytest.mark.parametrize(("start", "waits_s"), [("air", LISTEN_S), ("floor", 0.0)])
def test_nobody_is_armed_unasked_before_a_second_autopilot_would_be_heard(
    start: str, waits_s: float
) -> None:
    _, config = prepare(SCENARIOS["paper"], [])
    flight = msgspec.structs.replace(config.flight, start=start)
    told: Config = msgspec.structs.replace(config, flight=flight)
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        begun_s = runner.get_loop().time()
        assert runner.run(confirm_arming(told, told.vehicle.name))
        assert runner.get_loop().time() - begun_s == pytest.approx(waits_s)
    assert LISTEN_S > 1.0, "autopilots send one heartbeat a second"
