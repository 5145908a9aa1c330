"""The worlds of the scenarios, value for value, so that a figure of today is beside one of last year."""

import math
from typing import Any

import msgspec
import pytest

from sim.scenarios import SCENARIOS
from sim.world import STILL, World

LAG_S = 1.0 / (2.0 * math.pi * 1.5)
MQX: dict[str, Any] = {
    "mass_kg": 0.08, "thrust_max_n": 1.37, "thrust_curve": 0.0, "rate_limits_deg_s": (200.0, 200.0, 300.0),
    "thrust_gain": 1.0, "thrust_sag": 0.0, "thrust_lag_s": LAG_S, "rate_lag_s": LAG_S, "drag_per_s": 0.0,
    "rate_leak": 0.0, "wind_mean": (0.1, -0.05, 0.2), "wind_gust": (0.0, 0.0, 0.0), "wind_gust_hz": 0.2,
    "wind_turbulence": 0.0, "wind_step": (0.0, 0.0, 0.0), "wind_step_time_s": 30.0, "pose_rate_hz": 50.0,
    "pose_latency_s": 0.02, "pose_noise_m": 0.0003, "attitude_noise_rad": 0.002, "pose_loss": 0.0, "outage_s": 0.0,
    "outage_period_s": 10.0, "other_bodies": 0, "occlusion_s": 0.0, "swap_s": 0.0, "mishap_period_s": 10.0,
    "frame_period_s": 0.0225, "command_delay_s": 0.0, "frame_loss": 0.0, "speed_m_s": 0.5,
    "start_ned": (0.8, -0.8, 0.0), "start_thrust": 0.6, "own_estimate": False, "estimate_wander_m": 0.0,
    "estimate_yaw_step_deg": 0.0, "estimate_yaw_step_s": 2.0, "floor_z_m": 1.0, "floor_friction": 1.0,
    "floor_hold_s": 0.0, "ground_effect": False, "rotor_radius_m": 0.035, "step_s": 0.0025,
    "gravity": 9.81,
}  # fmt: skip
ADVERSE: dict[str, Any] = {
    "thrust_gain": 0.85, "thrust_sag": 0.05, "thrust_lag_s": 1.13 * LAG_S, "rate_lag_s": 0.85 * LAG_S,
    "wind_mean": (1.0, -0.8, 0.5), "wind_gust": (0.5, 0.5, 0.2), "wind_turbulence": 0.2, "drag_per_s": 0.1,
    "rate_leak": 0.02, "pose_noise_m": 0.0006, "attitude_noise_rad": 0.004, "pose_loss": 0.02, "outage_s": 0.15,
    "frame_loss": 0.02,
}  # fmt: skip
FAST_LIMITS = (1e5, 1e5, 1e5)
OTHERS: dict[str, dict[str, Any]] = {
    "ideal": {
        "thrust_lag_s": 0.0, "rate_lag_s": 0.0, "rate_limits_deg_s": FAST_LIMITS, "pose_noise_m": 0.0,
        "attitude_noise_rad": 0.0, "pose_latency_s": 0.0, "pose_rate_hz": 500.0, "frame_period_s": 0.002,
        "step_s": 0.002, "wind_mean": (0.4, -0.3, 0.5),
    },
    "paper": {},
    "fast": {"speed_m_s": 1.5},
    "adverse": ADVERSE,
    "storm": {**ADVERSE, "wind_mean": (2.0, -1.6, 1.0), "wind_gust": (1.0, 1.0, 0.4), "pose_latency_s": 0.04},
    "gust_front": {"wind_step": (1.5, 0.0, 0.0)},
    "quad1kg": {
        "mass_kg": 1.0, "thrust_max_n": 20.0, "thrust_lag_s": 0.03, "rate_lag_s": 0.02, "rotor_radius_m": 0.12,
        "drag_per_s": 1.0, "pose_rate_hz": 100.0, "pose_latency_s": 0.01, "frame_period_s": 0.01,
    },
}  # fmt: skip
NEUTRAL: dict[str, Any] = {
    "plant": "first_order", "thrust_delay_s": 0.0, "rate_delay_s": 0.0, "drag_body_per_s": (0.0, 0.0, 0.0),
    "inflow_drag_per_m": (0.0, 0.0), "inflow_lift_per_m": 0.0, "air_velocity": (0.0, 0.0, 0.0), "pose_jitter_s": 0.0,
    "tunnel": STILL, "velocity_bias": (0.0, 0.0, 0.0), "telemetry_hz": 0.0, "wind_push_s": 0.0,
    "start_velocity": (0.0, 0.0, 0.0), "start_turn_deg": (0.0, 0.0, 0.0),
}  # fmt: skip
"""Figures that are newer than these scenarios, and what does nothing."""
CONSTANTS: dict[str, dict[str, Any]] = {
    "rotors_quad1kg": {
        "arm_m": 0.175, "inertia_kg_m2": (0.0075, 0.0075, 0.013), "torque_per_thrust_m": 0.016, "p": 40.0, "i": 40.0,
        "d": 0.8,
    },
    "rotors_mqx": {},
    "rotors_mqx_radio": {"rate_filter_s": 0.056, "thrust_filter_s": 0.066},
}  # fmt: skip
ROTORS: dict[str, Any] = {
    "arm_m": 0.11, "inertia_kg_m2": (1.2e-4, 1.2e-4, 2.0e-4), "torque_per_thrust_m": 0.010, "curve": 0.0,
    "spin_up_s": 0.04, "spin_down_s": 0.04, "p": 25.0, "i": 25.0, "d": 0.4, "yaw_gain": 0.4, "gyro_noise_rad_s": 0.02,
    "gyro_filter_hz": 80.0, "d_filter_hz": 60.0, "rate_filter_s": 0.0, "thrust_filter_s": 0.0,
}  # fmt: skip


def figures(name: str) -> dict[str, Any]:
    found: dict[str, Any] = msgspec.structs.asdict(SCENARIOS[name].world)
    return found


@pytest.mark.parametrize("name", OTHERS)
def test_a_scenario_has_the_world_that_it_always_had(name: str) -> None:
    world = figures(name)
    del world["rotors"]  # in use with sim.plant = "rotors" alone
    newer = {key: NEUTRAL[key] for key in world.keys() - MQX.keys()}
    assert world == {**MQX, **newer, **OTHERS[name]}


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_scenario_on_rotors_is_another_one_but_for_these(name: str) -> None:
    world, other = figures(name), figures("quad1kg" if name == "rotors_quad1kg" else "paper")
    assert msgspec.structs.asdict(world.pop("rotors")) == {**ROTORS, **CONSTANTS[name]}
    assert (world.pop("plant"), other.pop("plant")) == ("rotors", "first_order")
    assert world.pop("step_s") == pytest.approx(0.001, rel=0.03)
    assert world == {key: other[key] for key in world}


def test_every_figure_of_a_world_is_in_one_of_the_tables() -> None:
    assert set(World.__struct_fields__) == {*MQX, *NEUTRAL, "rotors"}
