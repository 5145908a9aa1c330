"""Vehicle files: presets, own files, what lies on top of what, and what is refused."""

import math
import re
import tomllib
from pathlib import Path

import pytest

from groundstation.__main__ import main
from groundstation.config import ConfigError, from_dict, load, presets
from groundstation.core.control import Gains
from groundstation.core.vehicle import Vehicle
from groundstation.settings import Config
from tests.e2e.stations import run_here

PRESETS = presets(Vehicle)
FULL = """name = "mine"
mass_kg = 0.5
thrust_max_n = 9.0
thrust_min_n = 0.3
rate_limits_deg_s = [300, 300, 200]
thrust_lag_s = 0.04
rate_lag_s = 0.03
frame_period_s = 0.01
"""


def vehicle(
    folder: Path, text: str, *overrides: str, section: str = 'file = "mine.toml"'
) -> Vehicle:
    (folder / "mine.toml").write_text(text, "utf-8")
    (folder / "lab.toml").write_text(f"[vehicle]\n{section}\n", "utf-8")
    return load(folder / "lab.toml", Config, overrides).vehicle


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_says_all_of_its_vehicle_with_the_source_of_each_figure(name: str) -> None:
    told = from_dict({"vehicle": {"preset": name}}, Config).vehicle
    assert told.name == name
    text = PRESETS[name]
    found = {"preset", "file", "hover_thrust", "hover_range", "hover_n"}
    assert set(tomllib.loads(text)) == set(Vehicle.__struct_fields__) - found
    figures = [line for line in text.splitlines()[2:] if not line.startswith("name")]
    assert [line for line in figures if "#" not in line] == []
    # Enough thrust to hover with the reserve that limits keep, and frames fast against the lags'
    # sum.
    assert told.thrust_max_n > 1.5 * told.mass_kg * 9.81
    assert told.thrust_min_n < 0.2 * told.mass_kg * 9.81


def test_keys_of_the_section_lie_on_top_of_the_preset_and_overrides_on_top_of_all() -> None:
    data = {"vehicle": {"preset": "x500", "mass_kg": 2.2, "name": "ours"}}
    told = from_dict(data, Config, ["vehicle.thrust_lag_s=0.04", "vehicle.name=theirs"]).vehicle
    assert (told.name, told.thrust_lag_s) == ("theirs", 0.04)
    assert (told.mass_kg, told.thrust_max_n) == (2.2, 34.2)
    assert told.preset is None
    assert from_dict({}, Config, ["vehicle.preset=crazyflie"]).vehicle.mass_kg == 0.027


def test_a_file_is_found_beside_the_configuration_and_may_start_from_a_preset(
    tmp_path: Path,
) -> None:
    assert vehicle(tmp_path, FULL).mass_kg == 0.5
    assert vehicle(tmp_path, FULL, "vehicle.mass_kg=0.6").mass_kg == 0.6
    heavy = vehicle(tmp_path, 'preset = "x500"\nname = "heavy"\nmass_kg = 2.5\n')
    assert (heavy.name, heavy.mass_kg, heavy.thrust_max_n) == ("heavy", 2.5, 34.2)


PRESET_NAMES = "expected one of ['crazyflie', 'mqx', 'quad1kg', 'x500']"
REFUSED = [
    (FULL.replace("0.5", "-0.5"), "mass_kg: expected a number >= 0.005 and <= 100, got -0.5"),
    (FULL + "masskg = 1\n", "masskg: unknown key; did you mean mass_kg?"),
    (FULL + "x = = 1\n", "not valid TOML: Invalid value (at line 9, column 5)"),
    ("mass_kg = 1\n", "missing: name, thrust_max_n, thrust_min_n, rate_limits_deg_s,"),
    ('preset = "b"\n', f"preset: {PRESET_NAMES}, got 'b'"),
    ("preset = [1]\n", f"preset: {PRESET_NAMES}, got [1]"),
    ('file = "other.toml"\n', "file: a vehicle file can't name another"),
]


@pytest.mark.parametrize(("text", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_a_bad_vehicle_file_is_refused_by_its_name_and_key(
    text: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as caught:
        vehicle(tmp_path, text)
    assert str(caught.value).startswith(
        f"{tmp_path / 'lab.toml'}: vehicle.file: mine.toml: {words}"
    )


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ('preset = "x501"', f"preset: {PRESET_NAMES}, got 'x501'; did you mean x500?"),
        ("preset = 3", "preset: expected a string, got 3"),
        ('preset = "x500"\nfile = "mine.toml"', "file: preset and file exclude each other"),
        *((f'file = "{name}"', "file: cannot read ") for name in ("gone.toml", ".", "a\\u0000b")),
        ('prest = "x500"', "prest: unknown key; did you mean preset?"),
    ],
)
def test_a_vehicle_that_is_not_there_is_refused(section: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"vehicle.{words}")):
        vehicle(tmp_path, FULL, section=section)


def test_the_command_lists_the_presets_and_prints_one_to_start_from(tmp_path: Path) -> None:
    listed, shown, refused = (run_here(main, "vehicles", *x) for x in ([], ["x500"], ["x501"]))
    assert [done.returncode for done in (listed, shown, refused)] == [0, 0, 2]
    assert [line.split()[0] for line in listed.stdout.splitlines()] == list(PRESETS)
    assert vehicle(tmp_path, shown.stdout).name == "x500"
    assert "expected one of ['crazyflie'" in refused.stderr


def test_the_bound_of_adaptation_follows_from_the_thrust_that_wind_may_take_unless_it_is_set() -> (
    None
):
    def bound(*told: str, **vehicle: float) -> float:
        law = from_dict({"vehicle": vehicle}, Config, list(told)).controller
        assert isinstance(law, Gains)
        return law.b_bound

    fast = {"mass_kg": 1.0, "thrust_max_n": 20.0}
    trim = math.sqrt(20.0**2 - 9.81**2)
    assert bound() == pytest.approx(Gains().b_bound, abs=0.05)  # the default is the paper's vehicle
    assert bound(**fast) == pytest.approx(trim)
    assert bound(**fast, wind_share=0.8) == pytest.approx(0.8 * trim)
    assert bound("controller.b_bound=3", **fast) == 3.0
    assert bound("controller.b_bound=5", **fast) == 5.0
    assert bound(**fast, wind_share=0.2) == 5.0
