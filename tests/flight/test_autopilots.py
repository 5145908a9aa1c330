"""Flights on both kinds of autopilot, which differ in all but where the vehicle ends up."""

import asyncio
import math
from collections.abc import Mapping
from pathlib import Path

import pytest

from groundstation.core.messages import Check, Verdict
from groundstation.core.mission import State
from groundstation.flight import FlightOutcome, make_flight
from groundstation.machine import sleep_until
from sim.autopilots import AUTOPILOTS
from sim.runs import Stage, confirm_at, fly
from sim.scenarios import SCENARIOS, prepare
from tests.known import known
from tests.loops import in_virtual_time, running

AUTOPILOT = pytest.mark.parametrize("autopilot", AUTOPILOTS)


@pytest.mark.tried(1)  # sources; on PX4, test_scenarios.py and test_sources.py fly it
@pytest.mark.parametrize("source", ["odometry", "vicon"])
def test_the_figure_eight_is_flown_on_ardupilot(source: str) -> None:
    world, config = prepare(SCENARIOS["paper"], [], source=source)
    result = fly(world, config, seed=0, duration_s=17.0, autopilot="ardupilot")
    assert result.completed, result.why
    assert known(result.verdict.rms_cm) < 1.0


def ended(
    autopilot: str, *overrides: str, parameters: Mapping[str, float] | None = None
) -> tuple[FlightOutcome, Stage]:
    """A flight of 4 s that lands, on an autopilot with these parameters."""
    world, config = prepare(SCENARIOS["paper"], ["flight.duration_s=4", *overrides])

    async def main() -> tuple[FlightOutcome, Stage]:
        stage = Stage(world, config, 0, autopilot=autopilot, parameters=parameters)
        async with running(stage):
            return await make_flight(config, confirm=confirm_at(1.0)).run(), stage

    return in_virtual_time(main)()


def test_ardupilot_without_a_position_refuses_guided_and_flies_in_guided_nogps() -> None:
    outcome, stage = ended("ardupilot", parameters={"EK3_SRC1_POSXY": 0.0})
    assert outcome.state is State.ABORTED
    assert outcome.reason.startswith(
        "ArduPilot refused to enter GUIDED (it tried and failed, MAV_RESULT_FAILED): "
        "“Mode change to GUIDED failed: requires position”. "
    )
    assert stage.plant.released_s is None
    blind = {"EK3_SRC1_POSXY": 0.0}
    outcome, _ = ended("ardupilot", "link.ardupilot_mode=GUIDED_NOGPS", parameters=blind)
    assert outcome.state is State.LANDED, outcome.reason


@AUTOPILOT
def test_the_autopilot_lands_where_poses_end_if_it_is_told_to(autopilot: str) -> None:
    world, config = prepare(SCENARIOS["paper"], ["link.bring_down=land", "sim.floor_z_m=1.5"])

    async def main() -> tuple[FlightOutcome, Stage, int]:
        async with running(Stage(world, config, 0, autopilot=autopilot)) as stage:
            flying = asyncio.create_task(make_flight(config, confirm=confirm_at(1.0)).run())
            await sleep_until(8.0)
            known(stage.mocap).cover(True)
            outcome = await flying
            heard = stage.autopilot.codec.received
            await asyncio.sleep(12.0)  # mode LAND sinks slowly, and disarms by itself
            return outcome, stage, stage.autopilot.codec.received - heard

    outcome, stage, later = in_virtual_time(main)()
    assert outcome.state is State.ABORTED
    assert outcome.reason.startswith("no pose for ")
    assert stage.autopilot.custom_mode == {"px4": 4 << 16 | 6 << 24, "ardupilot": 9}[autopilot]
    assert not stage.autopilot.armed
    assert known(stage.plant.floor.touchdown_m_s) < 0.7, "by its own position, not by falling"
    assert later == 0, "nothing leaves after the link has closed"


@pytest.mark.parametrize(
    ("autopilot", "parameters", "verdict", "words"),
    [
        ("ardupilot", {"GUID_OPTIONS": 0.0}, Verdict.FAIL, "take our thrust as a climb"),
        ("ardupilot", {}, Verdict.PASS, "connected"),
        ("px4", {}, Verdict.PASS, "connected"),
    ],
)
def test_check_asks_the_autopilot_what_arming_asks_it(
    autopilot: str, parameters: dict[str, float], verdict: Verdict, words: str
) -> None:
    world, config = prepare(SCENARIOS["paper"], ["flight.start=floor"])

    async def main() -> list[Check]:
        async with running(Stage(world, config, 0, autopilot=autopilot, parameters=parameters)):
            return await make_flight(config, confirm=confirm_at(math.inf)).check()

    (ready,) = [one for one in in_virtual_time(main)() if one.name == "ready to arm"]
    assert ready.verdict is verdict
    assert words in ready.says


@pytest.fixture
def key(tmp_path: Path) -> Path:
    """A file with a key for signing."""
    path = tmp_path / "key"
    path.write_bytes(bytes(range(32)))
    path.chmod(0o600)
    return path


@AUTOPILOT
def test_a_signed_flight_ends_on_the_floor_and_disarmed_on_either(
    autopilot: str, key: Path
) -> None:
    outcome, stage = ended(autopilot, f"link.signing_key_file={key}")
    assert outcome.state is State.LANDED, outcome.reason
    assert not stage.autopilot.armed
    assert known(stage.plant.floor.touchdown_m_s) < 0.5
    assert stage.autopilot.codec.dropped == {}
    assert key.with_name("key.stamp").exists()


def test_an_autopilot_without_the_key_is_not_believed(key: Path) -> None:
    told = [f"link.signing_key_file={key}", "link.connect_timeout_s=2"]
    world, config = prepare(SCENARIOS["paper"], told)

    async def main() -> FlightOutcome:
        async with running(Stage(world, config, 0)) as stage:
            stage.autopilot.codec.signer = None
            return await make_flight(config, confirm=confirm_at(0.0)).run()

    outcome = in_virtual_time(main)()
    assert outcome.state is State.ABORTED
    assert "messages without a signature" in outcome.reason
