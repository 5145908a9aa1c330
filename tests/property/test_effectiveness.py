"""Thrust effectiveness: the second stage of the Kalman filter tells thrust from wind."""

import math
import random
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from msgspec.structs import replace

from groundstation.core.estimation import (
    Covariance,
    Densities,
    Effectiveness,
    apply_effectiveness,
    correct_chain,
    estimator,
    initial_covariance,
    initial_effectiveness,
    predict_covariance,
    predict_effectiveness,
    update_covariance,
    update_effectiveness,
)
from groundstation.core.geometry import FLOATS, Vec3, add_scaled, subtract
from groundstation.core.vehicle import (
    ActuatorCommand,
    ActuatorResponse,
    Motion,
    begin_response,
    integrate_actuators,
    integrate_motion,
)

DENSITIES = Densities(1e-7, 1e-4, 1e-2, 2.9)
ZERO: Vec3 = (0.0, 0.0, 0.0)
ACCELERATION = st.floats(-15.0, 15.0)


def transition(h: float) -> np.ndarray:
    chain = np.array(
        [[1, h, h * h / 2, h**3 / 6], [0, 1, h, h * h / 2], [0, 0, 1, h], [0, 0, 0, 1.0]]
    )
    f = np.eye(13)
    for i in range(3):
        f[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] = chain
    return f


def thrust_gives(velocity: Sequence[float], place: Sequence[float]) -> ActuatorResponse:
    """Commands that give one kilogram that velocity [m/s] and place [m], NED."""
    (a, b, c), (x, y, z) = velocity, place
    return ActuatorResponse((1.0, 0.0, 0.0, 0.0), 0.0, ZERO, (-a, -b, -c), (-x, -y, -z))


def dense(s: Covariance) -> np.ndarray:
    pp, pv, pd, pc, vv, vd, vc, dd, dc, cc = s
    return np.array([[pp, pv, pd, pc], [pv, vv, vd, vc], [pd, vd, dd, dc], [pc, vc, dc, cc]])


POSE = st.tuples(
    st.floats(0.004, 0.2), st.tuples(ACCELERATION, ACCELERATION, ACCELERATION), st.booleans()
)
"""Interval to the one before [s], acceleration by thrust [m/s²], and whether it has a velocity."""


@settings(deadline=None)
@given(st.lists(POSE, min_size=1, max_size=25), st.integers(0, 2**32))
def test_both_stages_together_are_the_kalman_filter_with_thirteen_states(
    poses: list[tuple[float, Vec3, bool]], seed: int
) -> None:
    """Without a walk of λ: three chains and λ in one covariance give the same estimates, to
    rounding.

    λ̂ moves with every pose here, and the noise that shows is that of the chains: so its variance
    is the filter's.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimator, "EXCITED_INFORMATION", -1.0)
        patch.setattr(estimator, "SHARE_OF_KNOWN", -1.0)
        patch.setattr(estimator, "SCORE_MEMORY_S", math.inf)
        compare_with_thirteen_states(poses, seed)


def compare_with_thirteen_states(poses: list[tuple[float, Vec3, bool]], seed: int) -> None:
    noise, draw = 1e-6, random.Random(seed)
    x, big = np.zeros(13), np.zeros((13, 13))
    small = initial_covariance(noise)
    for i in range(3):
        big[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] = dense(small)
    big[12, 12] = 0.15**2
    # What the chains believe; λ's estimate is x[12] = e.value - 1. Thrust accelerates by a per unit
    # of λ.
    e = replace(initial_effectiveness(0.15), noise=1.0, frozen_s=-1.0)
    state, clipped = np.zeros((3, 4)), False
    for h, a, with_velocity in poses:
        f = transition(h)
        push = ([0.5 * h * h * k for k in a], [h * k for k in a])
        for i in range(3):
            f[4 * i, 12], f[4 * i + 1, 12] = push[0][i], push[1][i]
        q = np.diag([*([DENSITIES.position, *DENSITIES[1:]] * 3), 0.0]) * h
        x, big = f @ x, f @ big @ f.T + q
        small = predict_covariance(small, h, DENSITIES)
        e = predict_effectiveness(FLOATS, e, h, thrust_gives(push[1], push[0]), 1.0, 0.0)
        state = state @ transition(h)[:4, :4].T
        state[:, 0] += (e.value - 1.0) * np.array(push[0])
        state[:, 1] += (e.value - 1.0) * np.array(push[1])
        for of, r in ((0, noise), (1, 1e-4))[: 1 + with_velocity]:
            measured = [draw.gauss(0.0, 0.002) for _ in range(3)]
            for i in range(3):
                row = big[:, 4 * i + of].copy()
                k = row / (row[4 * i + of] + r)
                x = x + k * (measured[i] - x[4 * i + of])
                big = big - np.outer(k, row)
            step = tuple(measured[i] - state[i, of] for i in range(3))
            variance = small[4 if of else 0] + r
            gain, small = update_covariance(small, r, of)
            e, moved = update_effectiveness(
                FLOATS, e, (step[0], step[1], step[2]), gain, variance, of
            )
            for i, chain in enumerate(zip(e.p, e.v, e.d, e.c, strict=True)):
                state[i] += np.array(gain) * step[i] + moved * np.array(chain)
            clipped |= not 0.6 < e.value < 1.4
    assert math.isclose(e.assumed, big[12, 12], rel_tol=1e-6)
    assert math.isclose(e.variance, big[12, 12], rel_tol=1e-6), "Joseph's form of the same"
    if not clipped:
        scale = 1.0 + np.abs(x).max()
        assert abs(e.value - 1.0 - x[12]) < 1e-6 * scale
        assert np.abs(state.ravel() - x[:12]).max() < 1e-6 * scale


def flown(
    true: float, wind: Vec3, seconds: float, *, shaken: bool
) -> tuple[Effectiveness, list[float]]:
    """λ̂ and d̂ after a flight of exact poses, with thrust and tilt at rest or shaken at 1 Hz."""
    h, mass, lag = 0.02, 1.0, 0.05
    still = Motion(ZERO, ZERO, (1.0, 0.0, 0.0, 0.0), 9.81, ZERO)
    truth, believed = still, still
    e, covariance, d, c = initial_effectiveness(0.15), initial_covariance(1e-8), ZERO, ZERO
    for n in range(round(seconds / h)):
        swing = math.sin(2.0 * math.pi * n * h) if shaken else 0.0
        drive = ActuatorCommand(9.81 * (1.0 + 0.3 * swing), (0.8 * swing, 0.0, 0.0))

        def roll(
            motion: Motion, share: float, wind: Vec3, rate: Vec3, drive: ActuatorCommand = drive
        ) -> tuple[Motion, ActuatorResponse]:
            push = integrate_actuators(FLOATS, begin_response(motion), drive, h, lag, lag)
            return integrate_motion(
                motion, push, h, mass / share, (wind[0], wind[1], wind[2] + 9.81), rate
            ), push

        truth, _ = roll(truth, true, wind, ZERO)
        model, push = roll(believed, e.value, d, c)
        expected = predict_covariance(covariance, h, DENSITIES)
        gain, covariance = update_covariance(expected, 1e-8)
        e = predict_effectiveness(FLOATS, e, h, push, mass, 0.0)
        step = subtract(truth.position, model.position)
        e, moved = update_effectiveness(FLOATS, e, step, gain, expected[0] + 1e-8)
        chain = correct_chain((model.position, model.velocity, add_scaled(d, h, c), c), gain, step)
        position, velocity, d, c = apply_effectiveness(chain, moved, e)
        believed = Motion(position, velocity, truth.attitude, model.thrust, model.rates)
    return e, list(d)


@pytest.mark.parametrize("true", [0.75, 0.9, 1.0, 1.15])
def test_a_shaken_vehicle_tells_weak_thrust_from_wind(true: float) -> None:
    e, d = flown(true, (0.5, -0.3, 1.0), 10.0, shaken=True)
    assert abs(e.value - true) < 0.01
    assert math.dist(d, (0.5, -0.3, 1.0)) < 0.1


def test_at_rest_they_look_the_same_and_only_their_sum_is_known() -> None:
    e, d = flown(0.85, ZERO, 10.0, shaken=False)
    assert abs(d[2] - 9.81 * (e.value - 0.85)) < 0.02, "the sum is right"
    assert (e.value, e.variance) == (1.0, 0.15**2), "nothing tells them apart, and λ̂ rests"


def test_what_is_broken_is_not_taken_for_worn() -> None:
    e, _ = flown(0.2, ZERO, 10.0, shaken=True)
    assert e.value == 0.6


def test_told_exactly_it_never_moves() -> None:
    e = initial_effectiveness(0.0)
    e = predict_effectiveness(
        FLOATS, e, 0.02, thrust_gives((0.0, 0.0, -0.2), (0.0, 0.0, -2e-3)), 1.0, 0.0
    )
    gain, _ = update_covariance(initial_covariance(1e-6), 1e-6)
    after, moved = update_effectiveness(FLOATS, e, (0.1, 0.1, 0.1), gain, 1e-6)
    assert (after.value, moved) == (1.0, 0.0)


@pytest.mark.parametrize(("gained", "wanders"), [(1e6, 1.0), (0.0, 0.0)])
def test_an_excited_scale_wanders_by_the_walk_of_its_time_and_a_calm_one_stays(
    gained: float, wanders: float
) -> None:
    before = replace(initial_effectiveness(0.05), gained=gained, frozen_s=-1.0)
    after = predict_effectiveness(FLOATS, before, 0.02, thrust_gives(ZERO, ZERO), 1.0, walk=0.003)
    assert after.assumed - before.assumed == pytest.approx(wanders * 0.003**2 * 0.02)
