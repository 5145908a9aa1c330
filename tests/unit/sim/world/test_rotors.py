"""The rotor-level plant answers by its constants, and another autopilot may have its rotors."""

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from sim.scenarios import SCENARIOS
from sim.world import FourRotors, Quadrotor, Wind, World, generator, rows


def vehicle(scenario: str, seed: int | None = None, **keys: Any) -> Quadrotor:
    """In calm air, flying, at hover thrust."""
    world = msgspec.structs.replace(
        SCENARIOS[scenario].world,
        wind_mean=(0.0, 0.0, 0.0),
        floor_z_m=1e6,
        start_thrust=1.0,
        **keys,
    )
    gyro = None if seed is None else rows(generator(seed, "gyro").standard_normal, 3)
    plant = Quadrotor(world, Wind(world, iter(())), None, gyro)
    plant.release(0.0)
    return plant


def weight(world: World) -> float:
    return world.mass_kg * world.gravity


def best_lag(times: np.ndarray, told: Callable[[float], float], seen: np.ndarray) -> float:
    """The pure first-order lag [s] whose answer to ``told`` is nearest to what was ``seen``."""
    h = float(times[1] - times[0])

    def left(lag: float) -> float:
        value, squares = 0.0, 0.0
        for time, one in zip(times, seen, strict=True):
            value += (1.0 - math.exp(-h / lag)) * (told(time - h) - value)
            squares += (value - one) ** 2
        return squares

    lags: list[float] = np.arange(0.030, 0.120, 0.001).tolist()
    return min(lags, key=left)


@pytest.mark.parametrize(
    ("scenario", "rate_lag_s", "thrust_lag_s"),
    [
        ("rotors_quad1kg", 0.042, 0.043),
        ("rotors_mqx", 0.054, 0.041),
        ("rotors_mqx_radio", 0.104, 0.109),
    ],
)
def test_it_answers_like_the_pure_lags_that_its_constants_were_chosen_by(
    scenario: str, rate_lag_s: float, thrust_lag_s: float
) -> None:
    hover = weight(SCENARIOS[scenario].world)
    times = np.arange(1, 1001) * 0.002

    def step(time: float) -> float:  # ±1 in turn
        return (1.0, 0.0, -1.0, 0.0)[int(time / 0.5)]

    for turned in (True, False):
        plant, seen = vehicle(scenario), []
        for time in times.tolist():
            one = step(time - 0.002)
            plant.command(
                time - 0.002,
                hover * (1.0 if turned else 1.0 + 0.2 * one),
                (0.3 * one * turned, 0.0, 0.0),
            )
            state = plant.truth(time)
            seen.append(
                state.rates_rad_s[0] / 0.3 if turned else (state.thrust_n / hover - 1.0) / 0.2
            )
        lag = best_lag(times, step, np.array(seen))
        assert lag == pytest.approx(rate_lag_s if turned else thrust_lag_s, abs=0.003)


def test_it_hovers_and_its_accelerometer_shows_its_weight() -> None:
    plant = vehicle("rotors_mqx", seed=1)
    plant.command(0.0, weight(SCENARIOS["rotors_mqx"].world), (0.0, 0.0, 0.0))
    state = plant.truth(1.0)
    assert state.velocity_ned == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    assert plant.specific_force == pytest.approx((0.0, 0.0, -9.81), abs=0.1)
    assert 0.0 < max(map(abs, state.rates_rad_s)) < 0.1, "the gyro's noise moves it a little"


def test_rotors_at_their_limit_turn_it_slower_and_the_integral_does_not_wind_up() -> None:
    mild, hard = vehicle("rotors_mqx"), vehicle("rotors_mqx", thrust_max_n=1.02 * 0.08 * 9.81)
    for plant in (mild, hard):
        plant.command(0.0, 0.08 * 9.81, (3.0, 0.0, 0.0))
    assert hard.truth(0.05).rates_rad_s[0] < 0.7 * mild.truth(0.05).rates_rad_s[0]
    peaks = [
        max(plant.truth(0.05 + 0.01 * k).rates_rad_s[0] for k in range(60))
        for plant in (mild, hard)
    ]
    assert peaks[1] < 1.3 * 3.0


def test_thrust_is_as_told_on_any_curve_of_the_rotors() -> None:
    for curve in (0.0, 0.5, 1.0):
        rotors = msgspec.structs.replace(SCENARIOS["rotors_mqx"].world.rotors, curve=curve)
        plant = vehicle("rotors_mqx", rotors=rotors, thrust_gain=0.9)
        plant.command(0.0, 1.0, (0.0, 0.0, 0.0))
        assert plant.truth(0.5).thrust_n == pytest.approx(0.9, rel=1e-3)


def turned(signals: FourRotors) -> tuple[float, float, float]:
    """Body rates after 20 ms of these."""
    plant = vehicle("rotors_mqx")
    plant.drive_rotors(0.0, signals)
    return plant.truth(0.02).rates_rad_s


def test_another_autopilot_has_the_rotors_in_their_order() -> None:
    level, more = 0.6, 0.7
    assert turned((level,) * 4) == pytest.approx((0.0, 0.0, 0.0))
    signs = []
    for which in range(4):
        signals = [level] * 4
        signals[which] = more
        signs.append(tuple(math.copysign(1.0, rate) for rate in turned(tuple(signals))))  # type: ignore[arg-type]
    # Front right, rear left (counter-clockwise, so they turn it to the right), front left, rear
    # right.
    assert signs == [(-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, -1.0, -1.0)]
    with pytest.raises(ValueError, match=r'sim\.plant = "rotors" only'):
        Quadrotor(World(), Wind(World(), iter(()))).drive_rotors(0.0, (0.0, 0.0, 0.0, 0.0))


def test_drag_along_the_bodys_axes_is_against_the_air() -> None:
    drag: dict[str, Any] = {
        "drag_body_per_s": (0.4, 0.2, 0.1),
        "inflow_drag_per_m": (0.05, 0.1),
        "inflow_lift_per_m": 0.02,
    }
    still = vehicle("paper", **drag, air_velocity=(3.0, 4.0, 0.0))
    still.command(0.0, weight(World()), (0.0, 0.0, 0.0))
    x, y, z = still.truth(0.01).velocity_ned
    # Upright, against 5 m/s: (0.4 + 0.05 · 5) 3, (0.2 + 0.05 · 5) 4, and lift 0.02 · 25 along the
    # thrust.
    assert (x / 0.01, y / 0.01, z / 0.01) == pytest.approx((1.95, 1.8, -0.5), rel=0.01)
    none = vehicle("paper", air_velocity=(3.0, 4.0, 0.0))
    none.command(0.0, weight(World()), (0.0, 0.0, 0.0))
    assert none.truth(0.01).velocity_ned == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
