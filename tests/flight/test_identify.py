"""``groundstation identify``: a vehicle that is not as told is found from a recorded flight of it."""

import json
import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from groundstation.analysis.identify import identify_command
from groundstation.config import ConfigError, from_dict, presets
from groundstation.core.geometry import Vec3
from groundstation.core.vehicle import Vehicle
from groundstation.settings import Config
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from sim.studies import FOUND_IN_FLIGHT, coverage_table, remake, remake_all, vehicles
from sim.studies.intervals import ToldInterval, truths
from sim.studies.vehicles import FoundInFlight
from tests.recordings import recorded

GAIN, THRUST_LAG_S, RATE_LAG_S, DELAY_S, SECONDS = 0.9, 0.118, 0.093, 0.025, 24.0
TRUTH = {
    "thrust_gain": GAIN,
    "thrust_lag_s": THRUST_LAG_S,
    "rate_lag_s": RATE_LAG_S,
    "command_delay_s": DELAY_S,
}
SET = ("trajectory.kind=excitation", "trajectory.laps=1", *(f"sim.{key}={value}" for key, value in TRUTH.items()))


def log() -> Path:
    return recorded("adverse", *SET, duration_s=SECONDS)[0]


@cache
def printed(path: Path, out: Path) -> dict[str, Any]:
    """What --json prints."""
    with pytest.MonkeyPatch.context() as patched:
        lines: list[str] = []
        patched.setattr("builtins.print", lines.append)
        assert identify_command(path, out, None, as_json=True) == 0
    (line,) = lines
    found: dict[str, Any] = json.loads(line)
    return found


@cache
def folder() -> Path:
    mine = log().parent / str(os.getpid())  # several processes test at once, and share the recording
    mine.mkdir()
    return mine


@cache
def facts() -> dict[str, Any]:
    return printed(log(), folder() / "found.toml")


def value(name: str) -> float:
    found: float = facts()["parameters"][name]["value"]
    return found


def test_lags_delay_and_thrust_of_a_vehicle_in_gusts_are_found() -> None:
    assert value("thrust_lag") == pytest.approx(THRUST_LAG_S, rel=0.10)
    for name in ("rate_lag", "roll_rate_lag", "pitch_rate_lag", "yaw_rate_lag"):
        assert value(name) == pytest.approx(RATE_LAG_S, rel=0.10)
    assert (value("rate_delay"), value("thrust_delay")) == pytest.approx((DELAY_S, DELAY_S), abs=0.003)
    middle = GAIN * (1.0 - 0.05 * 0.5 * SECONDS / 60.0)  # the battery sags
    assert value("thrust_scale") == pytest.approx(middle, rel=0.02)
    assert value("hover_thrust") == pytest.approx(0.080 * 9.81 / 1.37 / middle, rel=0.03)
    low, high = facts()["parameters"]["pose_latency"]["interval"]  # commands are 25 ms on their way, answers are not
    assert low < 0.020 < high < 0.050
    assert value("stamp_jitter") < 0.0007
    assert value("position_noise") == pytest.approx(0.0006, rel=0.1)
    assert value("attitude_noise") == pytest.approx(0.004, rel=0.1)


def test_every_figure_has_an_interval_a_unit_and_what_was_told() -> None:
    assert facts()["whole"]
    units = {"thrust_lag": "s", "drag": "1/s", "position_noise": "m", "attitude_noise": "rad", "thrust_scale": ""}
    for name, one in facts()["parameters"].items():
        assert one["unit"] == units.get(name, one["unit"])
        low, high = one["interval"]
        assert low <= one["value"] <= high
        assert one["identified"]
    assert facts()["parameters"]["rate_lag"]["told"] == pytest.approx(0.1061, abs=1e-4)
    assert "thrust over mass" in facts()["parameters"]["thrust_scale"]["note"]


def test_the_vehicle_file_is_one_and_says_how_sure_it_is() -> None:
    path = Path(facts()["vehicle_file"])
    vehicle = from_dict({"vehicle": {"file": path.name}}, Config, folder=path.parent).vehicle
    assert vehicle.name == "mqx"
    assert vehicle.mass_kg == 0.080
    assert vehicle.thrust_lag_s == pytest.approx(value("thrust_lag"), rel=1e-4)
    assert vehicle.rate_delay_s == pytest.approx(value("rate_delay"), rel=1e-4)
    assert vehicle.thrust_delay_s == pytest.approx(value("thrust_delay"), rel=1e-4)
    assert vehicle.thrust_max_n == pytest.approx(1.37 * value("thrust_scale"), rel=0.03)
    text = path.read_text("utf-8")
    assert "95 % from" in text
    assert "told 0.1061" in text


def excited(flown: FoundInFlight) -> Path:
    return recorded(flown.scenario, *flown.overrides, seed=flown.seed, duration_s=flown.duration_s)[0]


def test_an_excitation_in_a_storm_stays_within_two_tenths_of_a_metre_of_its_point() -> None:
    """By the truth, from 3 s after it is let go in the wind: so it fits into 3 by 3 m many times over."""
    still = ("trajectory.kind=excitation", "trajectory.laps=1", "sim.start_ned=[0, 0, -1]", "sim.start_thrust=0.9")
    world, config = prepare(SCENARIOS["storm"], list(still))
    places: list[tuple[float, Vec3]] = []
    flown = fly(world, config, seed=0, duration_s=14.0, on_step=lambda time_s, place: places.append((time_s, place)))
    assert flown.completed
    begun_s = places[0][0]
    off_m = [abs(a - b) for t, place in places if t > begun_s + 3.0 for a, b in zip(place, (0, 0, -1), strict=True)]
    assert 0.1 < max(off_m) < 0.2


@pytest.mark.matrix  # `make vehicles` flies and writes them; the test of gusts finds lags, delay and thrust
@pytest.mark.parametrize("flown", FOUND_IN_FLIGHT, ids=lambda flown: flown.vehicle)
def test_the_file_of_a_vehicle_that_comes_along_has_what_its_flight_tells(flown: FoundInFlight) -> None:
    assert remake(flown, excited(flown)) == presets(Vehicle)[flown.vehicle], "make it anew: make vehicles"


@pytest.mark.matrix  # of `make vehicles`, whose files are compared
def test_a_figure_that_was_found_takes_the_place_of_the_one_before_and_nothing_else_changes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(vehicles, "fly_excitation", lambda flown, folder: log())
    monkeypatch.setattr(vehicles, "FOUND_IN_FLIGHT", FOUND_IN_FLIGHT[1:])  # by another vehicle's flight
    (line,) = remake_all(tmp_path)
    delay, lag = round(value("rate_delay") - 0.005, 3), round(value("rate_lag"), 3)
    assert line == f"x500       changed    rate_lag_s {lag:g} (was 0.028), rate_delay_s {delay:g} (was 0.013)"
    before, after = presets(Vehicle)["x500"].splitlines(), (tmp_path / "x500.toml").read_text("utf-8").splitlines()
    changed = [new for old, new in zip(before, after, strict=True) if new != old]
    assert [line.partition(" ")[0] for line in changed] == ["rate_lag_s", "rate_delay_s"]
    assert {line.index("#") for line in after[2:] if "#" in line} == {before[3].index("#")}
    with pytest.raises(ConfigError, match=r"--write: cannot write into .*nowhere: there is no such folder"):
        remake_all(tmp_path / "nowhere")


@pytest.mark.matrix  # test_scenarios.py flies by what is told; the test of gusts finds lags, delay and thrust
@pytest.mark.parametrize(
    ("scenario", "thrust_lag_s", "rate_lag_s"),
    [("rotors_mqx_radio", 0.109, 0.104), ("rotors_mqx", 0.041, 0.054), ("rotors_quad1kg", 0.043, 0.042)],
)
def test_what_scenarios_on_rotors_are_told_is_found_again_by_a_flight_that_is_told_pure_lags(
    scenario: str, thrust_lag_s: float, rate_lag_s: float, capsys: pytest.CaptureFixture[str]
) -> None:
    lags = {"thrust_lag_s": thrust_lag_s, "rate_lag_s": rate_lag_s, "thrust_delay_s": 0, "rate_delay_s": 0}
    keys = ("trajectory.kind=excitation", "trajectory.laps=1", *(f"vehicle.{key}={lags[key]}" for key in lags))
    path = recorded(scenario, *keys, duration_s=22.0)[0]
    assert identify_command(path, None, None, as_json=True) == 0
    found, told = json.loads(capsys.readouterr().out)["parameters"], SCENARIOS[scenario].told
    assert found["thrust_scale"]["value"] == pytest.approx(1.0, rel=0.01)
    assert found["drag"]["value"] == pytest.approx(SCENARIOS[scenario].world.drag_per_s, abs=0.02)
    for name, truth in (("drag", SCENARIOS[scenario].world.drag_per_s), ("thrust_sag", 0.0)):
        low, high = found[name]["interval"]
        assert low <= truth <= high, name
    for name in ("thrust", "rate"):
        assert found[f"{name}_lag"]["value"] == pytest.approx(getattr(told, f"{name}_lag_s"), abs=0.004)
        assert found[f"{name}_delay"]["value"] == pytest.approx(getattr(told, f"{name}_delay_s"), abs=0.004)


QUIET = (
    "trajectory.kind=hold",
    "trajectory.position_ned=[0,0,-1]",
    "sim.start_ned=[0,0,-1]",
    "sim.start_thrust=0.9",
    "sim.wind_mean=[0,0,0]",
    "sim.pose_noise_m=0.00001",
    "sim.attitude_noise_rad=0.00001",
)


def test_no_file_is_written_over_and_the_page_says_that_it_needs_matplotlib(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.toml").write_text("mine")
    with pytest.raises(ConfigError, match=r"--out: .* is there already"):
        identify_command(log(), tmp_path / "mine.toml", None, as_json=True)
    assert (tmp_path / "mine.toml").read_text() == "mine"
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ConfigError, match=r"pip install .*\[plot\]"):
        identify_command(log(), None, tmp_path / "page", as_json=True)


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no recording")
    with pytest.raises(ConfigError, match=r"LOG: .* is no MCAP file"):
        identify_command(tmp_path / "notes.txt", None, None, as_json=True)
    with pytest.raises(ConfigError, match="LOG: cannot read"):
        identify_command(tmp_path / "missing.mcap", None, None, as_json=True)


def test_the_truth_of_a_scenario_is_counted_where_it_lies_within_what_was_told() -> None:
    known = truths("adverse")
    assert known["rate_delay"] == pytest.approx(0.025)
    assert known["drag"] == pytest.approx(0.3)
    assert "rate_lag" not in truths("rotors_mqx"), "nobody knows it"
    true = known["rate_lag"]
    lag = ToldInterval("adverse", "rate_lag", true, 0.9 * true, 1.1 * true)
    wrong = lag._replace(low=2.0 * lag.high, high=3.0 * lag.high)
    assert "| rate lag, roll and pitch | 1 (" in coverage_table([lag], 1)
    assert "| rate lag, roll and pitch | 1 of the 2 that told it (" in coverage_table([lag, wrong], 3)
    assert "| linear drag | not told |" in coverage_table([lag], 1)
