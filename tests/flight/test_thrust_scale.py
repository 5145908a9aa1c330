"""From newtons to the signal on the wire: the vehicle's thrust curve and its hover thrust."""

import functools
from pathlib import Path

import pytest

from groundstation.config import ConfigError, from_dict, load
from groundstation.settings import Config
from links.core import signal
from tests.flight import flights

CURVED = 0.65
WEIGHT_SHARE = 0.08 * 9.81 / 1.37
HOVER = round(signal(WEIGHT_SHARE, CURVED), 3)


rms_cm = functools.partial(flights.rms_cm, "paper", duration_s=16.0)


# The scale is wrong by a sixth in what is commanded at most, and right by the hover thrust.
SCALED = [f"vehicle.hover_thrust={HOVER}", "vehicle.thrust_max_n=1.15"]


@pytest.mark.tried(1)  # ways to tell it
@pytest.mark.parametrize(("told", "world"), [
    (["vehicle.thrust_curve=0.65"], ["sim.thrust_curve=0.65"]),
    ([*SCALED, "vehicle.thrust_curve=0.65"], ["sim.thrust_curve=0.65"]),
    # The link's own curve goes before the vehicle's, also where it is straight.
    (["vehicle.thrust_curve=0.65", "link.thrust_curve=0"], []),
], ids=["curve", "hover", "straightened by the autopilot"])  # fmt: skip
def test_a_curve_that_is_told_right_costs_nothing(told: list[str], world: list[str]) -> None:
    curved = rms_cm(*told, *world)
    assert curved == pytest.approx(rms_cm(), rel=0.02)


def test_a_curve_that_is_not_told_is_felt() -> None:
    assert rms_cm("sim.thrust_curve=0.65") > 1.1 * rms_cm()


def test_a_vehicle_files_curve_and_hover_thrust_reach_the_scale(tmp_path: Path) -> None:
    vehicle = 'preset = "mqx"\nthrust_curve = 0.65\nhover_thrust = 0.672\n'
    (tmp_path / "mine.toml").write_text(vehicle, "utf-8")
    (tmp_path / "lab.toml").write_text('[vehicle]\nfile = "mine.toml"\n', "utf-8")
    config = load(tmp_path / "lab.toml", Config)
    assert config.thrust_curve == 0.65
    assert config.full_thrust_n == pytest.approx(
        0.08 * config.controller.gravity / (0.65 * 0.672**2 + 0.35 * 0.672)
    )
    overrides = ["link.thrust_curve=0", "vehicle.thrust_max_n=1.1"]
    straightened = load(tmp_path / "lab.toml", Config, overrides)
    assert straightened.thrust_curve == 0.0
    assert straightened.full_thrust_n == pytest.approx(0.08 * config.controller.gravity / 0.672)


def test_without_a_hover_thrust_the_full_signal_gives_the_largest_thrust() -> None:
    config = from_dict({}, Config, ["vehicle.thrust_curve=0.5"])
    assert config.full_thrust_n == config.vehicle.thrust_max_n == 1.37


def test_more_thrust_than_the_full_signal_gives_is_refused() -> None:
    says = r"vehicle\.thrust_max_n: 1\.37 N is more than the full .* gives, 1\.121 N"
    with pytest.raises(ConfigError, match=says):
        from_dict({"vehicle": {"hover_thrust": 0.7}}, Config)
    rounded = from_dict({"vehicle": {"hover_thrust": round(WEIGHT_SHARE, 2)}}, Config)
    assert rounded.full_thrust_n == pytest.approx(1.37, rel=0.01)
