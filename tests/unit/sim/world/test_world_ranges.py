"""Ranges of ``sim`` keys: a number in another unit is refused, and what every scenario flies is
not.
"""

import pytest

from groundstation.config import ConfigError
from sim.scenarios import SCENARIOS, prepare


@pytest.mark.parametrize(
    "override",
    [
        # grams
        "sim.mass_kg=800",
        # milliseconds
        "sim.thrust_lag_s=50",
        "sim.rate_delay_s=13",
        "sim.pose_latency_s=20",
        "sim.frame_period_s=22.5",
        "sim.rotors.spin_up_s=40",
        # millimetres
        "sim.pose_noise_m=0.3",
        "sim.start_ned=[800,-800,0]",
        "sim.floor_z_m=1500",
        # degrees where radians are meant, and radians where degrees are
        "sim.attitude_noise_rad=0.5",
        "sim.rate_limits_deg_s=[3.5,3.5,5.2]",
        # percent
        "sim.thrust_gain=95",
        "sim.pose_loss=5",
    ],
)
def test_a_figure_of_the_world_in_another_unit_is_refused_with_what_is_accepted(
    override: str,
) -> None:
    key, _, _ = override.partition("=")
    with pytest.raises(ConfigError, match=rf"{key}(\[\d\])?: expected a number "):
        prepare(SCENARIOS["paper"], [override])


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_a_scenario_flies_is_within_the_ranges(name: str) -> None:
    prepare(SCENARIOS[name], ["sim.pose_loss=0"])
