"""``groundstation identify`` finds from a recording how a vehicle differs from what is told."""

import io
import json
import os
import sys
from contextlib import redirect_stdout
from functools import cache
from itertools import compress
from pathlib import Path
from typing import Any

import pytest

from groundstation.analysis.identify import identify_command
from groundstation.config import ConfigError, from_dict
from groundstation.settings import Config
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from tests.recordings import recorded

GAIN, THRUST_LAG_S, RATE_LAG_S, DELAY_S, SECONDS = 0.9, 0.118, 0.093, 0.025, 24.0
LAGS = {"thrust_lag_s": THRUST_LAG_S, "rate_lag_s": RATE_LAG_S}
TRUTH = {"thrust_gain": GAIN, **LAGS, "command_delay_s": DELAY_S}
EXCITED = ("trajectory.kind=excitation", "trajectory.laps=1")
SET = (*EXCITED, *(f"sim.{key}={value}" for key, value in TRUTH.items()))


def log() -> Path:
    return recorded("adverse", *SET, duration_s=SECONDS)[0]


@cache
def facts() -> dict[str, Any]:
    """What --json prints."""
    # Several processes test at once, and share the recording.
    mine = log().parent / str(os.getpid())
    mine.mkdir()
    with redirect_stdout(io.StringIO()) as printed:
        assert identify_command(log(), mine / "found.toml", None, as_json=True) == 0
    found: dict[str, Any] = json.loads(printed.getvalue())
    return found


def value(name: str) -> float:
    found: float = facts()["parameters"][name]["value"]
    return found


def test_lags_delay_and_thrust_of_a_vehicle_in_gusts_are_found() -> None:
    assert value("thrust_lag") == pytest.approx(THRUST_LAG_S, rel=0.10)
    for name in ("rate_lag", "roll_rate_lag", "pitch_rate_lag", "yaw_rate_lag"):
        assert value(name) == pytest.approx(RATE_LAG_S, rel=0.10)
    delays_s = (value("rate_delay"), value("thrust_delay"))
    assert delays_s == pytest.approx((DELAY_S, DELAY_S), abs=0.003)
    middle = GAIN * (1.0 - 0.05 * 0.5 * SECONDS / 60.0)  # the battery sags
    assert value("thrust_scale") == pytest.approx(middle, rel=0.02)
    assert value("hover_thrust") == pytest.approx(0.080 * 9.81 / 1.37 / middle, rel=0.03)
    # Commands are 25 ms on their way, answers are not.
    low, high = facts()["parameters"]["pose_latency"]["interval"]
    assert low < 0.020 < high < 0.050


def test_every_figure_has_an_interval_a_unit_and_what_was_told() -> None:
    assert facts()["whole"]
    units = {"thrust_lag": "s", "drag": "1/s", "thrust_scale": ""}
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
    assert vehicle.thrust_lag_s == pytest.approx(value("thrust_lag"), rel=5e-4)
    assert vehicle.rate_delay_s == pytest.approx(value("rate_delay"), rel=5e-4)
    assert vehicle.thrust_delay_s == pytest.approx(value("thrust_delay"), rel=5e-4)
    assert vehicle.thrust_max_n == pytest.approx(1.37 * value("thrust_scale"), rel=0.03)
    text = path.read_text("utf-8")
    assert "95 % from" in text
    assert "told 0.1061" in text


def test_an_excitation_in_a_storm_stays_within_two_tenths_of_a_metre_of_its_point() -> None:
    """By the truth, from 3 s after its release in the wind: it fits into 3 by 3 m many times."""
    still = (*EXCITED, "sim.start_ned=[0, 0, -1]", "sim.start_thrust=0.9")
    world, config = prepare(SCENARIOS["storm"], list(still))
    flown = fly(world, config, seed=0, duration_s=14.0)
    assert flown.completed
    late = [t > flown.track.times[0] + 3.0 for t in flown.track.times]
    axes = zip(flown.track.axes, (0, 0, -1), strict=True)
    off_m = [abs(a - b) for axis, b in axes for a in compress(axis, late)]
    assert 0.1 < max(off_m) < 0.2


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
