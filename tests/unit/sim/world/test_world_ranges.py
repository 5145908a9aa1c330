"""Ranges of ``sim`` keys: other units are refused, and what every scenario flies is not."""

import pytest

from groundstation.config import ConfigError
from sim.scenarios import SCENARIOS, prepare

GRAMS = "mass_kg=800"
MILLISECONDS = (
    "thrust_lag_s=50 rate_delay_s=13 pose_latency_s=20 frame_period_s=22.5 rotors.spin_up_s=40"
)
MILLIMETRES = "pose_noise_m=0.3 start_ned=[800,-800,0] floor_z_m=1500"
DEGREES_AND_RADIANS = "attitude_noise_rad=0.5 rate_limits_deg_s=[3.5,3.5,5.2]"
PERCENT = "thrust_gain=95 pose_loss=5 tunnel.pitch_per_climb=140"
WRONG = " ".join((GRAMS, MILLISECONDS, MILLIMETRES, DEGREES_AND_RADIANS, PERCENT)).split()


@pytest.mark.parametrize("told", WRONG)
def test_a_figure_of_the_world_in_another_unit_is_refused_with_what_is_accepted(told: str) -> None:
    key, _, _ = told.partition("=")
    with pytest.raises(ConfigError, match=rf"sim\.{key}(\[\d\])?: expected a number "):
        prepare(SCENARIOS["paper"], [f"sim.{told}"])


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_a_scenario_flies_is_within_the_ranges(name: str) -> None:
    prepare(SCENARIOS[name], ["sim.pose_loss=0"])
