"""A pacer that dies or stands still in flight, in virtual time and by the truth."""

import asyncio

import pytest

from groundstation.core.mission import State
from groundstation.flight import Flight
from sim.radio import RfReceiver
from sim.runs import MissionResult, Stage
from tests.flight.flights import SHORT, mission
from tests.known import known
from tests.loops import until


def struck(link: str, *, stopped: bool) -> tuple[MissionResult, float, bool]:
    """A flight whose pacer is struck, when [s], and whether the vehicle ends armed."""
    at: list[float] = []
    stages: list[Stage] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await until(lambda: flight.state is State.TRACKING)
        await asyncio.sleep(0.503)
        known(stage.port.pacer).strike(stopped=stopped)
        stages.append(stage)
        at.append(asyncio.get_running_loop().time())

    flown = mission("paper", *SHORT, link=link, script=script, figure_s=10.0)
    radio = known(stages[0].radio)
    assert isinstance(radio.receiver, RfReceiver)
    return flown, at[0], radio.receiver.armed


@pytest.mark.parametrize("stopped", [False, True])
@pytest.mark.parametrize("link", ["dsm", "crsf", "rf_bridge"])
def test_a_pacer_that_fails_is_told_and_the_vehicle_brought_down(link: str, stopped: bool) -> None:
    flown, struck_s, armed = struck(link, stopped=stopped)
    aborted = flown.states[-1]
    assert aborted.state == "aborted"
    assert "its stand-by has taken over and brings down" in aborted.reason
    assert aborted.time_s < struck_s + 0.15
    assert not armed
    assert known(flown.touchdown_m_s) < 2.5


def test_no_autopilot_is_said_to_have_felt_the_floor_where_nothing_comes_back() -> None:
    async def script(flight: Flight, stage: Stage) -> None:
        low_m = flight._config.flight.floor_z_m - 0.15
        while flight.state is not State.LANDING or stage.plant.truth(now()).position_ned[2] < low_m:
            await asyncio.sleep(0.01)
        known(stage._bridge).kill()  # by the operator of its computer

    def now() -> float:
        return asyncio.get_running_loop().time()

    flown = mission("paper", *SHORT, link="rf_bridge", script=script, figure_s=1.0)
    assert flown.states[-1].state == "aborted", flown.why
    assert "commands count no more" in flown.why
