"""The scenarios through the radio links' bytes, quantised channels and all, in virtual time."""

import asyncio
from functools import partial
from pathlib import Path

import pytest

from groundstation.analysis.report import read_columns
from groundstation.analysis.report.figures import lateness
from groundstation.analysis.report.flight import numbers
from groundstation.analysis.report.page import result_table
from groundstation.config import ConfigError
from groundstation.core.mission import State
from groundstation.flight import Flight
from groundstation.recording import Recording
from links.rf import encode_attitude
from sim.runs import RECORDING, Stage, fly, from_floor
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from tests.flight import flights
from tests.flight.flights import SHORT, mission
from tests.known import known
from tests.loops import until
from tests.recordings import record_mission
from tests.unit.links.rf.test_crsf_telemetry import BATTERY, LINK, frame

rms_cm = partial(flights.rms_cm, duration_s=17.0)


@pytest.mark.tried(1)  # links, in two airs
@pytest.mark.parametrize(
    ("scenario", "link", "limit_cm"),
    [
        *(("paper", link, 0.3) for link in ("dsm", "crsf", "rf_bridge")),
        ("adverse", "dsm", 3.0),
        ("adverse", "rf_bridge", 3.0),
        ("quad1kg", "crsf", 1.1),
    ],
)
def test_every_radio_link_flies_as_well_as_the_scenario_demands(
    scenario: str, link: str, limit_cm: float
) -> None:
    assert rms_cm(scenario, link=link) < limit_cm


def test_channels_are_quantised_as_on_the_wire() -> None:
    """Sticks that reach a hundred times as far have steps a hundred times as coarse."""
    rough = [f"link.map.{axis}.full_rate_deg_s=20000" for axis in ("roll", "pitch", "yaw")]
    assert rms_cm("paper", *rough, link="dsm") > 2.0 * rms_cm("paper", link="dsm")


def test_a_radio_brings_no_poses() -> None:
    world, config = prepare(SCENARIOS["paper"], [], link="dsm", source="odometry")
    with pytest.raises(ConfigError, match="no other link brings poses"):
        fly(world, config, seed=0, duration_s=1.0)


@pytest.mark.tried(1)  # links
@pytest.mark.parametrize("link", ["dsm", "crsf", "rf_bridge"])
def test_the_vehicles_thrust_curve_is_straightened_on_the_way(link: str) -> None:
    curve = "sim.thrust_curve=0.6"
    straightened = rms_cm("paper", curve, "vehicle.thrust_curve=0.6", link=link)
    assert straightened < 0.3
    assert rms_cm("paper", curve, link=link) > straightened


@pytest.mark.parametrize("link", ["dsm", "rf_bridge"])
def test_a_recording_tells_how_late_commands_and_the_pacers_frames_were(
    link: str, tmp_path: Path
) -> None:
    from matplotlib.figure import Figure  # not whenever tests are collected

    world, config = prepare(SCENARIOS["paper"], [], link=link)
    folder = RunFolder(tmp_path, config, world, scenario="paper", seed=0)
    fly(world, config, seed=0, duration_s=3.0, give=folder.give)
    folder.close({"completed": True, "why": ""})
    flight = read_columns(tmp_path / RECORDING)
    facts = numbers(flight)
    assert facts["lateness_ms"]["samples"] > 0.9 * facts["commands"] > 100
    assert sum(facts["link"]["late_octaves"]) > facts["commands"]
    assert flight.looks[-1]["period_s"] == world.frame_period_s, "also where the bridge tells it"
    panel = Figure().add_subplot()
    lateness([panel], flight)
    legend = known(panel.get_legend())
    words = [text.get_text() for text in legend.get_texts()]
    assert any(word.startswith("the pacer's ") for word in words)
    assert "commands" in words


def test_what_the_module_tells_is_on_screens_and_in_the_recording(tmp_path: Path) -> None:
    async def script(flight: Flight, stage: Stage) -> None:
        while True:
            stage.port.datagram_received(
                BATTERY + LINK + encode_attitude(0.1, 0.0, 1.0) + frame(0x21, b"ACRO\0"), None
            )
            await asyncio.sleep(0.5)

    world, config = prepare(SCENARIOS["paper"], list(SHORT), link="crsf")
    world, config = from_floor(world, config, 1.0)
    _, path = record_mission(tmp_path, world, config, script)
    status = list(Recording(path).entries(("/link",)))[-5].value()["status"]
    assert status["battery_v"] == pytest.approx(16.8)
    assert (status["battery_share"], status["mode"]) == (0.5, "ACRO")
    assert status["angles_rad"] == pytest.approx([0.0, -0.1, 1.0], abs=1e-4)
    assert status["uplink_share"] == pytest.approx(0.99)
    assert (status["uplink_dbm"], status["uplink_snr_db"]) == (-60, -5)
    facts = numbers(read_columns(tmp_path / RECORDING))
    table = {name: cells for name, *cells in result_table(["it"], [facts])}
    word = table["last telemetry of the vehicle"]
    vehicle = "16.80 V, battery 50 %, mode ACRO, roll +0° pitch -6° yaw +57°"
    assert word[0] == f"{vehicle}, gets 99 % of frames, -60 dBm, -5 dB over noise"


def test_a_battery_told_by_the_module_lands_the_vehicle() -> None:
    async def script(flight: Flight, stage: Stage) -> None:
        await until(lambda: flight.state is State.TRACKING)
        while True:
            stage.port.datagram_received(frame(0x08, bytes.fromhex("0064 0011 000123 05")), None)
            await asyncio.sleep(0.5)

    flown = mission("paper", *SHORT, link="crsf", script=script, figure_s=20.0)
    assert flown.landed or flown.fault
    assert "battery at 5 %" in flown.fault
    assert flown.states[-1].state == State.LANDED
