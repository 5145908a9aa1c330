"""groundstation/identify: each part on data whose truth is known."""

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundstation.analysis.identify import FlightStretch, identify
from groundstation.analysis.identify.command import FLY, IdentifiedVehicle, file_text, table
from groundstation.analysis.identify.fit import (
    Bounds,
    full_n,
    hover_signal,
    minimize,
    most_n,
    respond_with_lag,
    turns,
)
from groundstation.analysis.identify.stretch import Column
from groundstation.core.geometry import FLOATS, IDENTITY, rotate as turned_by
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, integrate
from groundstation.settings import Config
from links.core import full_thrust_n, signal, thrust
from links.mavlink import MavlinkLinkConfig

G, STEP_S = 9.81, 0.0025
POSE_STEPS, FRAME_STEPS = 8, 9
DELAY_STEPS = 6
PLANT = {"mass": 0.5, "gravity": G, "thrust_lag": 0.06, "rate_lag": 0.04}


@cache
def flown(
    *,
    seconds: float = 14.0,
    strength: float = 1.0,
    scale: float = 0.9,
    curve: float = 0.0,
    noise_m: float = 2e-4,
    noise_rad: float = 1e-3,
    wind: float = 0.1,
) -> FlightStretch:
    """Open loop, by the controller's model: lags of 60 and 40 ms, delay 15 ms, poses at 50 Hz."""
    rng = np.random.default_rng(3)
    vehicle = Vehicle(name="made-up", mass_kg=0.5, thrust_max_n=9.0)
    config = Config(vehicle=vehicle, link=MavlinkLinkConfig())
    count = int(seconds / STEP_S)
    sent_s, newtons, rates, at, places, attitudes = [], [], [], [], [], []
    waiting: list[tuple[int, ActuatorCommand]] = []
    hover = signal(0.5 * G / (scale * 9.0), curve)
    drive = ActuatorCommand(0.5 * G, (0.0, 0.0, 0.0))
    motion = Motion((0.0, 0.0, -5.0), (0.0, 0.0, 0.0), IDENTITY, 0.5 * G, (0.0, 0.0, 0.0))
    push = np.zeros(3)
    for step in range(count):
        t = step * STEP_S
        if step % FRAME_STEPS == 0:
            told = strength * np.array(
                [math.sin(7.0 * t), math.sin(5.0 * t + 1.0), 0.6 * math.sin(9.0 * t)]
            )
            u = hover + strength * (0.06 * math.sin(6.0 * t) + 0.05 * math.sin(11.0 * t))
            sent_s.append(t)
            newtons.append(9.0 * u)
            rates.append(told)
            real = scale * 9.0 * thrust(u, curve)
            waiting.append((step + DELAY_STEPS, ActuatorCommand(real, (told[0], told[1], told[2]))))
        while waiting and waiting[0][0] <= step:
            drive = waiting.pop(0)[1]
        if step % POSE_STEPS == 0:
            x, y, z = rng.normal(0.0, noise_rad, 3) if noise_rad else np.zeros(3)
            at.append(t)
            places.append(np.array(motion.position) + rng.normal(0.0, noise_m, 3))
            attitudes.append(turned_by(motion.attitude, (x, y, z)))
        push = push + rng.normal(0.0, wind * math.sqrt(STEP_S), 3)
        motion = integrate(
            FLOATS, motion, drive, STEP_S, disturbance=(push[0], push[1], push[2]), **PLANT
        )
    use = slice(50, None)
    return FlightStretch(
        Path("made-up.mcap"),
        config,
        np.array(sent_s),
        np.array(newtons),
        np.array(rates),
        np.array(at)[use],
        np.array(places)[use],
        np.array(attitudes)[use],
    )


def holds(found: IdentifiedVehicle, **truth: float) -> None:
    """Every truth lies within its interval, widened by half as one draw of twenty may miss."""
    for name, true in truth.items():
        one = found.parameters[name]
        assert one.interval is not None, name
        low, high = one.interval
        spare = 0.5 * (high - low) / 2.0
        assert low - spare <= true <= high + spare, f"{name}: {true} is not within {one.interval}"


def test_a_lag_is_followed_and_summed_up_exactly() -> None:
    sent, held = np.array([0.0, 0.1, 0.25]), np.array([1.0, 3.0, -1.0])
    response = respond_with_lag(sent, held, 0.02, 0.05)
    t = np.linspace(0.02, 0.6, 5801)
    values = response.value(t)
    assert values[0] == 1.0
    inputs = held[np.clip(np.searchsorted(sent + 0.02, t, side="right") - 1, 0, None)]
    slopes = np.gradient(values, t)
    smooth = np.abs(np.gradient(inputs)) == 0.0
    assert np.allclose(slopes[smooth][2:-2], ((inputs - values) / 0.05)[smooth][2:-2], atol=0.05)
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t))])
    assert np.allclose(response.integral(t) - response.integral(t[:1]), summed, atol=1e-6)


def test_without_a_lag_commands_are_obeyed_at_once() -> None:
    response = respond_with_lag(np.array([0.0, 0.1]), np.array([1.0, 3.0]), 0.0, 0.0)
    assert response.value(np.array([0.05, 0.1, 0.2])).tolist() == [1.0, 3.0, 3.0]
    assert response.integral(np.array([0.05, 0.2])).tolist() == pytest.approx([0.05, 0.4])


def test_a_fit_finds_what_is_seen_and_says_of_the_rest_that_it_is_not() -> None:
    rng = np.random.default_rng(2)
    t = np.linspace(0.0, 1.0, 500)
    measured = 2.0 * t + rng.normal(0.0, 1.0, 500)

    def whitened(sets: Any) -> Column:
        return np.stack([(measured - one[0] * t)[:, None] for one in sets], axis=-1)

    bounds = Bounds(*(np.full(2, value) for value in (-10.0, 10.0, 1e-3, 0.0, np.inf)))
    fit = minimize(whitened, np.zeros(2), bounds, 0.02)
    assert abs(fit.values[0] - 2.0) < 3.0 * fit.deviations[0]
    assert fit.deviations[0] == pytest.approx(1.0 / math.sqrt(float((t**2).sum())), rel=0.4)
    assert fit.deviations[1] > 10.0


def test_turns_are_those_between_the_attitudes() -> None:
    first = turned_by(IDENTITY, (0.1, -0.2, 0.3))
    attitudes = np.array([first, turned_by(first, (0.01, 0.02, -0.03))])
    assert turns(attitudes)[0].tolist() == pytest.approx([0.01, 0.02, -0.03])


def test_a_made_up_vehicle_is_found_again() -> None:
    found = identify(flown())
    holds(found, thrust_scale=0.9, thrust_curve=0.0, thrust_lag=0.06, thrust_delay=0.015, drag=0.0)
    for turn in ("rate", "yaw_rate"):
        holds(found, **{f"{turn}_lag": 0.04, f"{turn}_delay": 0.015, f"{turn}_response": 0.055})
    assert found.parameters["thrust_lag"].value == pytest.approx(0.06, rel=0.05)
    assert found.parameters["thrust_scale"].value == pytest.approx(0.9, rel=0.02)


def test_a_curve_that_nobody_told_is_found() -> None:
    seen = flown(curve=0.6, scale=0.95)
    found = identify(seen)
    holds(found, thrust_curve=0.6, hover_thrust=signal(0.5 * G / (0.95 * 9.0), 0.6))
    text = file_text(found)
    written = Vehicle.with_text({}, text)
    full = full_thrust_n(0.5 * G, written["hover_thrust"], written["thrust_curve"])
    assert full == pytest.approx(0.95 * 9.0, rel=0.05)
    assert written["thrust_max_n"] <= 1.02 * full


NEED_MOTION = (
    "thrust_scale", "thrust_curve", "thrust_lag", "rate_lag", "yaw_rate_lag", "rate_delay", "drag",
)  # fmt: skip


def test_of_a_flight_that_moves_nothing_it_says_so() -> None:
    still = flown(strength=0.0, scale=1.0, noise_m=1e-4, noise_rad=1e-4, wind=0.0, seconds=10.0)
    found = identify(still)
    for name in NEED_MOTION:
        one = found.parameters[name]
        assert (one.value, one.interval, one.note) == (None, None, FLY)
    assert table(found).count(FLY) == len(found.parameters) - 1
    assert found.parameters["pose_latency"].note == "the vehicle told no attitude of its own"


def test_scale_and_curve_agree_with_what_was_told_where_the_vehicle_flew() -> None:
    config = Config(vehicle=Vehicle(thrust_curve=0.3, mass_kg=0.08, thrust_max_n=1.37))
    assert full_n(config, 0.6, 1.0, 0.3) == pytest.approx(1.37)
    assert most_n(config, 0.6, 1.0, 0.3) == pytest.approx(1.37)
    assert hover_signal(config, 0.6, 1.0, 0.3) == pytest.approx(signal(0.08 * G / 1.37, 0.3))
    flown_n = 0.8 * 1.37 * thrust(0.6, 0.3) / thrust(0.6, 0.7)
    assert most_n(config, 0.6, 0.8, 0.7) == pytest.approx(flown_n)
