"""The plant against closed forms and against a fine integration that shares no code with it."""

import math

import msgspec
import numpy as np
import pytest

from groundstation.core.geometry import Vec3, so3
from sim.world import (
    Quadrotor,
    Wind,
    World,
    advance_turbulence,
    begin_turbulence,
    compute_turbulence,
    generator,
    rows,
)
from sim.world.world import CORRELATION_S, GRID_S

CALM = World(wind_mean=(0.0, 0.0, 0.0), floor_z_m=1e6)


def vehicle(world: World, seen: list[tuple[float, Vec3]] | None = None) -> Quadrotor:
    on_step = None if seen is None else lambda t, p: seen.append((t, p))
    return Quadrotor(world, Wind(world, rows(generator(1, "wind").standard_normal, 3)), on_step)


def test_it_is_held_until_released() -> None:
    plant = vehicle(CALM)
    plant.command(0.0, 1.0, (1.0, 0.0, 0.0))
    assert plant.truth(3.0).position_ned == CALM.start_ned
    assert plant.truth(3.0).thrust_n == pytest.approx(0.6 * 0.08 * 9.81)


def test_a_look_that_comes_late_shows_where_the_vehicle_was_and_changes_nothing() -> None:
    late_s = 0.004
    in_time, late = vehicle(CALM), vehicle(CALM)
    for plant in (in_time, late):
        plant.release(0.0)
        plant.command(0.0, 0.9, (1.5, -1.0, 0.8))
    seen = in_time.truth(1.0)
    for plant in (in_time, late):
        plant.command(1.0 + late_s, 0.7, (-1.0, 0.5, 0.0))
    looked = late.truth(1.0)
    assert late_s * math.hypot(*seen.velocity_ned) > 0.005
    assert looked.position_ned == pytest.approx(seen.position_ned, abs=2e-4)
    assert looked.attitude == pytest.approx(seen.attitude, abs=1e-4)
    assert late.truth(1.5) == in_time.truth(1.5)


def test_commands_are_clamped_to_what_the_vehicle_can_do() -> None:
    plant = vehicle(CALM)
    plant.release(0.0)
    plant.command(0.0, 99.0, (99.0, -99.0, 99.0))
    state = plant.truth(5.0)
    assert state.thrust_n == pytest.approx(1.37)
    assert state.rates_rad_s == pytest.approx(
        (math.radians(200), -math.radians(200), math.radians(300))
    )


def test_the_motion_agrees_with_a_fine_independent_integration() -> None:
    world = msgspec.structs.replace(
        CALM, drag_per_s=0.3, wind_mean=(0.4, -0.2, 0.1), rate_leak=0.05
    )
    plant = vehicle(world)
    plant.release(0.0)
    plant.command(0.0, 0.9, (1.5, -1.0, 0.8))
    got = plant.truth(0.5)

    h, steps = 2e-5, 25000
    p, v = np.array(world.start_ned), np.zeros(3)
    rotation, w, thrust = np.eye(3), np.zeros(3), 0.6 * 0.08 * 9.81
    command, wind = np.array([1.5, -1.0, 0.8]), np.array(world.wind_mean)
    leak = 0.05 * np.array([-1.0, -1.5, 0.0])
    for _ in range(steps):
        a = (
            -thrust / 0.08 * rotation[:, 2]
            + np.array([0, 0, 9.81])
            + wind
            - 0.3 * v
            + rotation @ leak
        )
        p, v = p + h * v + 0.5 * h * h * a, v + h * a
        middle = w + 0.5 * h * (command - w) / world.rate_lag_s
        s = np.array(
            [[0, -middle[2], middle[1]], [middle[2], 0, -middle[0]], [-middle[1], middle[0], 0]]
        )
        rotation = rotation @ (np.eye(3) + h * s + 0.5 * h * h * s @ s)
        w = w + h * (command - w) / world.rate_lag_s
        thrust += h * (0.9 - thrust) / world.thrust_lag_s
    assert got.position_ned == pytest.approx(tuple(p), abs=1e-5)
    assert got.velocity_ned == pytest.approx(tuple(v), abs=3e-5)
    assert np.array(so3.matrix(got.attitude)) == pytest.approx(rotation, abs=3e-5)


def test_it_lands_upright_on_the_floor_and_takes_off_again() -> None:
    world = msgspec.structs.replace(CALM, floor_z_m=0.2)
    plant = vehicle(world)
    plant.release(0.0)
    plant.command(0.0, 0.0, (0.3, 0.2, 0.0))
    state = plant.truth(2.0)
    assert state.on_ground
    assert state.position_ned[2] == 0.2
    assert so3.euler_zyx(state.attitude)[:2] == pytest.approx((0.0, 0.0), abs=1e-3)
    assert plant.floor.touchdown_m_s is not None and plant.floor.touchdown_m_s > 1.0
    plant.command(2.0, 1.2, (0.0, 0.0, 0.0))
    assert not plant.truth(3.0).on_ground


def test_turbulence_has_the_asked_rms_and_correlation_on_every_axis() -> None:
    normals = rows(generator(3, "wind").standard_normal, 3)
    state = begin_turbulence((0.1, 0.1, 0.1))
    values = np.empty((200_000, 3))
    for i in range(len(values)):
        a, b, c = next(normals)
        state = advance_turbulence(state, (a, b, c))
        values[i] = compute_turbulence(state, 0.2)
    h = GRID_S
    assert values.std(axis=0) == pytest.approx((0.2, 0.2, 0.2), rel=0.1)
    for axis, time in enumerate(CORRELATION_S):
        lag = round(time / h)
        x = values[:, axis]
        correlation = float(np.mean(x[:-lag] * x[lag:]) / np.mean(x * x))
        # Longitudinal e^(-1); lateral (1 - 1/2) e^(-1).
        assert correlation == pytest.approx(math.exp(-1.0) * (1.0 if axis == 0 else 0.5), abs=0.12)


def test_wind_is_mean_plus_gust_plus_step() -> None:
    world = msgspec.structs.replace(
        CALM,
        wind_mean=(1.0, 0.0, 0.0),
        wind_gust=(0.0, 0.5, 0.0),
        wind_step=(0.0, 0.0, 2.0),
        wind_step_time_s=30.0,
    )
    wind = Wind(world, rows(generator(0, "wind").standard_normal, 3))
    assert wind.at(1.25) == pytest.approx((1.0, 0.5, 0.0))
    assert wind.at(30.0) == pytest.approx((1.0, 0.0, 2.0), abs=1e-9)
