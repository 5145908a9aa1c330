"""Flights on both kinds of autopilot, which differ in all but where the vehicle ends up."""

import asyncio
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from groundstation.core.messages import Check, Verdict, tell_lines
from groundstation.core.mission import State
from groundstation.flight import FlightOutcome, make_flight
from groundstation.machine import sleep_until
from sim.autopilots import AUTOPILOTS
from sim.runs import Stage, confirm_at, fly
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import running
from tests.loops import in_virtual_time

AUTOPILOT = pytest.mark.parametrize("autopilot", AUTOPILOTS)


@pytest.mark.tried(1)  # sources; on PX4, test_scenarios.py and test_sources.py fly it
@pytest.mark.parametrize("source", ["odometry", "vicon"])
def test_the_figure_eight_is_flown_on_ardupilot(source: str) -> None:
    world, config = prepare(SCENARIOS["paper"], [], source=source)
    result = fly(world, config, seed=0, duration_s=17.0, autopilot="ardupilot")
    assert result.completed, result.why
    assert result.verdict.rms_cm is not None and result.verdict.rms_cm < 1.0


def ended(
    autopilot: str,
    *overrides: str,
    parameters: Mapping[str, float] | None = None,
    prepares: Callable[[Stage], None] = lambda _: None,
) -> tuple[FlightOutcome, Stage, list[str]]:
    """A flight of 4 s that lands, on an autopilot with these parameters."""
    world, config = prepare(SCENARIOS["paper"], ["flight.duration_s=4", *overrides])
    said: list[str] = []

    async def main() -> tuple[FlightOutcome, Stage]:
        async with running(
            Stage(world, config, 0, autopilot=autopilot, parameters=parameters)
        ) as stage:
            prepares(stage)
            flight = make_flight(
                config, confirm=confirm_at(1.0), subscribers=(tell_lines(said.append),)
            )
            return await flight.run(), stage

    return *in_virtual_time(main)(), said


def test_ardupilot_without_a_position_refuses_guided_and_flies_in_guided_nogps() -> None:
    outcome, stage, _ = ended("ardupilot", parameters={"EK3_SRC1_POSXY": 0.0})
    assert outcome.state is State.ABORTED
    assert outcome.reason.startswith(
        "ArduPilot refused to enter GUIDED (it tried and failed, MAV_RESULT_FAILED): "
        "“Mode change to GUIDED failed: requires position”. "
    )
    assert stage.plant.released_s is None
    outcome, _, _ = ended(
        "ardupilot", "link.ardupilot_mode=GUIDED_NOGPS", parameters={"EK3_SRC1_POSXY": 0.0}
    )
    assert outcome.state is State.LANDED, outcome.reason


LONG = (
    "PreArm: compass 2 is not healthy, calibrate it away from the steel of the floor, then restart "
    "the autopilot"
)
"""Three parts of 50 bytes."""


def test_a_refusal_to_arm_is_told_in_words_and_with_the_gap_of_a_lost_part() -> None:
    def lose_second_part(stage: Stage) -> None:
        stage.autopilot.lacks, pack = LONG, stage.autopilot.codec.pack
        vars(stage.autopilot.codec)["pack"] = lambda message: (
            b"" if message.get_type() == "STATUSTEXT" and message.chunk_seq == 1 else pack(message)
        )

    outcome, _, said = ended("px4", prepares=lose_second_part)
    assert outcome.state is State.ABORTED
    (refused,) = [line for line in said if "refused to arm" in line]
    assert outcome.reason in refused, "in the log as on the screen"
    assert "not possible at this moment, MAV_RESULT_TEMPORARILY_REJECTED" in refused
    assert f"{LONG[:50]}[…]{LONG[100:]}" in refused


@AUTOPILOT
def test_poses_that_end_in_the_air_are_landed_by_the_autopilot_where_it_is_told_to(
    autopilot: str,
) -> None:
    world, config = prepare(SCENARIOS["paper"], ["link.bring_down=land", "sim.floor_z_m=1.5"])

    async def main() -> tuple[FlightOutcome, Stage, int]:
        async with running(Stage(world, config, 0, autopilot=autopilot)) as stage:
            flying = asyncio.create_task(make_flight(config, confirm=confirm_at(1.0)).run())
            await sleep_until(8.0)
            assert stage.mocap is not None
            stage.mocap.cover(True)
            outcome = await flying
            heard = stage.autopilot.codec.received
            await asyncio.sleep(12.0)  # mode LAND sinks slowly, and disarms by itself
            return outcome, stage, stage.autopilot.codec.received - heard

    outcome, stage, later = in_virtual_time(main)()
    assert outcome.state is State.ABORTED
    assert outcome.reason.startswith("no pose for ")
    assert stage.autopilot.custom_mode == {"px4": 4 << 16 | 6 << 24, "ardupilot": 9}[autopilot]
    assert not stage.autopilot.armed
    assert stage.plant.floor.touchdown_m_s is not None
    assert stage.plant.floor.touchdown_m_s < 0.7, "by its own position, not by falling"
    assert later == 0, "nothing leaves after the link has closed"


WRONG_FOR_THRUST: list[tuple[dict[str, float], str]] = [
    ({"GUID_OPTIONS": 0.0}, "GUID_OPTIONS is 0: it would take our thrust as a climb"),
    ({"GUID_OPTIONS": 4.0, "ATC_ANGLE_BOOST": 0.0}, "GUID_OPTIONS is 4"),
    ({"ATC_ANGLE_BOOST": 1.0}, "ATC_ANGLE_BOOST is 1: it would raise our thrust"),
]


@pytest.mark.parametrize(("parameters", "words"), WRONG_FOR_THRUST)
def test_ardupilot_that_would_misunderstand_our_thrust_is_never_armed(
    parameters: dict[str, float], words: str
) -> None:
    outcome, stage, _ = ended("ardupilot", parameters=parameters)
    assert outcome.state is State.ABORTED
    assert words in outcome.reason
    assert stage.plant.released_s is None


@pytest.mark.parametrize(
    ("autopilot", "parameters", "verdict", "words"),
    [
        *(("ardupilot", parameters, Verdict.FAIL, words) for parameters, words in WRONG_FOR_THRUST),
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
    outcome, stage, _ = ended(autopilot, f"link.signing_key_file={key}")
    assert outcome.state is State.LANDED, outcome.reason
    assert not stage.autopilot.armed
    assert stage.plant.floor.touchdown_m_s is not None and stage.plant.floor.touchdown_m_s < 0.5
    assert stage.autopilot.codec.dropped == {}
    assert key.with_name("key.stamp").exists()


def test_an_autopilot_without_the_key_is_not_believed(key: Path) -> None:
    world, config = prepare(
        SCENARIOS["paper"], [f"link.signing_key_file={key}", "link.connect_timeout_s=2"]
    )

    async def main() -> FlightOutcome:
        async with running(Stage(world, config, 0)) as stage:
            stage.autopilot.codec.signer = None
            return await make_flight(config, confirm=confirm_at(0.0)).run()

    outcome = in_virtual_time(main)()
    assert outcome.state is State.ABORTED
    assert "messages without a signature" in outcome.reason
