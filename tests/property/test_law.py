"""The law's theory as properties: shaping, projection (P1-P4), Lyapunov identity, bounds."""

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, strategies as st

from groundstation.core.control import (
    Law,
    LawState,
    backstep,
    compute_yaw_rate,
    sine_error,
    turning,
)
from groundstation.core.control.backstepping import (
    BacksteppingAxis,
    LawOutput,
    Shape,
    clamp_length,
    compute_turn_rates,
    evaluate_axis,
    evaluate_growth,
    integrate_saturation,
    make_saturation,
    project,
)
from groundstation.core.geometry import FLOATS, Quat, Vec3, add_scaled, arrays, so3
from sim.studies import LIMIT, worst_disagreement

LAW = Law()
small = st.floats(-3.0, 3.0)
vec = st.tuples(small, small, small)
anything = st.floats(allow_nan=False, allow_infinity=False)
any_vec = st.tuples(anything, anything, anything)
drags = st.floats(0.0, 2.0)
angle = st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-3.1, 3.1))
gains = st.builds(
    Law,
    k2=st.floats(0.2, 5.0),
    k3=st.floats(0.2, 8.0),
    k3_down=st.floats(0.2, 20.0),
    kb=st.floats(0.1, 5.0),
    sigma_bound=st.floats(0.3, 3.0),
    sigma_slope=st.floats(0.3, 5.0),
    rho_bound=st.floats(0.3, 3.0),
    rho_slope=st.floats(0.3, 5.0),
    velocity_scale=st.floats(0.3, 3.0),
    b_bound=st.floats(1.0, 6.0),
    epsilon=st.floats(0.1, 1.0),
    delta=st.floats(0.01, 1.0),
    projection_order=st.integers(1, 3),
)


def quaternion(angles: Vec3) -> Quat:
    return so3.from_euler_zyx(*angles)


def vec3(values: Any) -> Vec3:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def dot(a: Vec3, b: Vec3) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


@given(st.floats(-50.0, 50.0), st.floats(0.1, 5.0), st.floats(0.1, 5.0))
def test_sigma_is_odd_bounded_and_has_the_stated_slope_and_derivatives(
    s: float, bound: float, slope: float
) -> None:
    by = make_saturation(bound, slope)

    def at(s: float) -> tuple[float, float, float]:
        """Value, first derivative, integral."""
        a = evaluate_axis(FLOATS, Shape(2.0, by, by, 1.0), s, 0.0)
        return a.sigma, a.sigma_prime, integrate_saturation(by, a.rs, a.root)

    value, first, _ = at(s)
    assert abs(value) < bound
    assert at(-s)[0] == -value
    assert at(0.0)[1] == pytest.approx(slope)
    h = 1e-5
    above, below = at(s + h), at(s - h)
    assert first == pytest.approx((above[0] - below[0]) / (2 * h), rel=1e-5, abs=1e-7)
    assert value == pytest.approx((above[2] - below[2]) / (2 * h), rel=1e-5, abs=1e-7)
    assert at(0.0)[2] == 0.0


@given(st.floats(-50.0, 50.0), st.floats(0.1, 5.0), st.floats(0.2, 5.0))
def test_omega_is_the_identity_inside_and_smooth_outside(
    s: float, bound: float, scale: float
) -> None:
    excess, first, second = evaluate_growth(FLOATS, s, bound, scale)
    if abs(s) <= bound:
        assert (excess, first, second) == (0.0, 1.0, 0.0)
    h = 1e-5
    above, below = (
        evaluate_growth(FLOATS, s + h, bound, scale),
        evaluate_growth(FLOATS, s - h, bound, scale),
    )
    assert first == pytest.approx(1.0 + (above[0] - below[0]) / (2 * h), rel=1e-5, abs=1e-6)
    assert second == pytest.approx((above[1] - below[1]) / (2 * h), rel=1e-3, abs=2e-4 / scale**2)


@given(small, small, gains)
def test_partial_derivatives_of_the_virtual_control_match_differences(
    z1: float, z1_dot: float, law: Law
) -> None:
    def at(first: float, second: float) -> BacksteppingAxis:
        """The axis as a function of (z1, z2)."""
        shape = law.shape
        return evaluate_axis(
            FLOATS, shape, first, second - evaluate_axis(FLOATS, shape, first, 0.0).sigma
        )

    here = evaluate_axis(FLOATS, law.shape, z1, z1_dot)
    h = 1e-5
    # Ω is C² only, so at the kink of Ω'' a difference is right to first order in h.
    close: dict[str, Any] = {"rel": 1e-4, "abs": 3e-3}
    by_z1 = (at(z1 + h, here.z2).u_star - at(z1 - h, here.z2).u_star) / (2 * h)
    by_z2 = (at(z1, here.z2 + h).u_star - at(z1, here.z2 - h).u_star) / (2 * h)
    assert here.du_dz1 == pytest.approx(by_z1, **close)
    assert here.du_dz2 == pytest.approx(by_z2, **close)
    above, below = at(z1, here.z2 + h).omega, at(z1, here.z2 - h).omega
    v_by_z2 = (0.5 * above**2 - 0.5 * below**2) / (2 * h)
    assert here.dv_dz2 == pytest.approx(v_by_z2, **close)


@given(vec, st.floats(0.0, 1.0), vec, gains)
def test_projection_p1_to_p4(direction: Vec3, share: float, xi: Vec3, law: Law) -> None:
    bound, epsilon, delta = law.b_bound, law.epsilon, law.delta
    length = math.hypot(*direction) or 1.0
    x, y, z = (each / length * share * (bound + epsilon) for each in direction)
    b_hat = clamp_length(FLOATS, (x, y, z), bound + epsilon)
    keys: dict[str, Any] = {"bound": bound, "epsilon": epsilon, "delta": delta}
    proj = project(FLOATS, xi, b_hat, order=law.projection_order, **keys)
    # P1: on the outer sphere it never points outward.
    if math.hypot(*b_hat) >= (bound + epsilon) * (1 - 1e-12):
        assert dot(b_hat, proj) <= 1e-9 * (1 + math.hypot(*xi))
    # P2: b̃ᵀ Proj >= b̃ᵀ ξ for every |b| <= B.
    axes = ((bound, 0.0, 0.0), (0.0, -bound, 0.0), (0.0, 0.0, 0.3 * bound))
    for b in (*axes, (-0.5 * bound, 0.5 * bound, 0.5 * bound)):
        error = (b[0] - b_hat[0], b[1] - b_hat[1], b[2] - b_hat[2])
        assert dot(error, proj) >= dot(error, xi) - 1e-9 * (1 + math.hypot(*xi))
    # P3: the norm is bounded.
    stretch = 1 + ((bound + epsilon) / bound) ** 2
    limit = math.hypot(*xi) * stretch + (bound + epsilon) / (2 * bound**2) * delta
    assert math.hypot(*proj) <= limit * (1 + 1e-12)
    # It does nothing inside.
    if math.hypot(*b_hat) <= bound:
        assert proj == xi


@given(vec, vec, st.integers(1, 3))
def test_projection_p4_is_n_times_smooth_across_the_inner_sphere(
    direction: Vec3, xi: Vec3, order: int
) -> None:
    length = math.hypot(*direction)
    if length < 1e-3:
        return

    def at(radius: float) -> Vec3:
        b = vec3(radius / length * np.asarray(direction))
        return project(FLOATS, xi, b, bound=2.0, epsilon=0.5, delta=0.1, order=order)

    h = 1e-3
    # η1 starts like (r - B)^(n+1): its n-th difference across the sphere vanishes with h.
    deviation = max(abs(a - b) for a, b in zip(at(2.0 + h), xi, strict=True))
    assert deviation <= 20.0 * (1 + math.hypot(*xi)) * (4.1 * h / 2.25) ** (order + 1)


@given(angle, vec, st.floats(0.3, 3.0))
def test_a_direction_turns_by_its_derivative(angles: Vec3, dot: Vec3, length: float) -> None:
    q, h = quaternion(angles), 1e-6
    along = vec3(length * np.array(so3.third_column(q)))
    turned = np.array(sine_error(q, vec3(np.array(along) + h * np.array(dot)))) / h
    assert turning(q, along, dot) == pytest.approx(turned, rel=1e-4, abs=1e-3)


@given(gains, st.tuples(*[vec] * 7), angle, st.floats(0.3, 3.0), st.floats(0.05, 2.0), drags)
def test_v_falls_exactly_by_w_on_the_ideal_plant(
    law: Law, vectors: tuple[Vec3, ...], angles: Vec3, lift: float, mass: float, drag: float
) -> None:
    """V˙ = -W + b̃ᵀ(ξ - Proj): differences of V along the plant against the law's own W."""
    z1, z1_dot, b_hat, b, acceleration, jerk, speed_d = vectors
    b_hat = clamp_length(FLOATS, b_hat, law.b_bound)
    thrust = lift * mass * law.gravity
    q = quaternion(angles)
    v = np.add(z1_dot, speed_d)
    state = LawState(z1, z1_dot, vec3(v), q, thrust, b_hat, acceleration, jerk)
    step = backstep(FLOATS, law, state, mass=mass, drag=drag)
    assert compute_turn_rates(FLOATS, law, state, mass=mass, drag=drag) == (
        step.rate_x,
        step.rate_y,
    )

    def v_after(h: float) -> float:
        """V a moment later: the plant of section 1 with the law's Ṫ, ω and b̂˙ held."""
        down = so3.third_column(q)
        moved = np.array([0.0, 0.0, law.gravity]) - thrust / mass * np.array(down) + b - drag * v
        accel = moved - acceleration
        after = LawState(
            vec3(z1 + h * np.array(z1_dot) + 0.5 * h * h * accel),
            vec3(z1_dot + h * accel),
            vec3(v + h * moved),
            so3.rotate(q, (h * step.rate_x, h * step.rate_y, 0.4 * h)),
            thrust + h * step.thrust_rate,
            vec3(b_hat + h * np.array(step.b_hat_dot)),
            vec3(acceleration + h * np.array(jerk)),
            jerk,
        )
        later = backstep(FLOATS, law, after, mass=mass, drag=drag)
        error = [b[i] - b_hat[i] - h * step.b_hat_dot[i] for i in range(3)]
        return later.v_known + 0.5 / law.kb * sum(x * x for x in error)

    turn = abs(step.rate_x) + abs(step.rate_y)
    speed = 1.0 + turn + abs(step.thrust_rate) / thrust + max(map(abs, z1_dot))
    h = 1e-5 / speed
    slope = (v_after(h) - v_after(-h)) / (2.0 * h)
    # b̂ lies within B, so Proj = ξ and the last term vanishes.
    assert slope == pytest.approx(-step.w, rel=2e-4, abs=1e-4 * (1.0 + v_after(0.0)) * speed)


@given(st.lists(st.tuples(any_vec, st.floats(0.0, 10.0)), max_size=30), gains)
def test_the_estimate_stays_within_b_plus_epsilon_for_any_input_sequence(
    inputs: list[tuple[Vec3, float]], law: Law
) -> None:
    b_hat: Vec3 = (0.0, 0.0, 0.0)
    radius = law.b_bound + law.epsilon
    for xi, dt in inputs:
        bounded: Vec3 = tuple(max(-1e150, min(1e150, x)) for x in xi)  # type: ignore[assignment]  # three components
        keys: dict[str, Any] = {"bound": law.b_bound, "epsilon": law.epsilon, "delta": law.delta}
        rate = project(FLOATS, bounded, b_hat, order=law.projection_order, **keys)
        b_hat = clamp_length(FLOATS, add_scaled(b_hat, dt, rate), radius)
        assert math.hypot(*b_hat) <= radius * (1 + 1e-12)


def numbers(step: LawOutput) -> list[float]:
    fields = (x if isinstance(x, tuple) else (x,) for x in msgspec.structs.astuple(step))
    return [x for field in fields for x in field]


@given(any_vec, any_vec, angle, anything, vec, any_vec, any_vec)
def test_outputs_are_finite_for_any_finite_input(
    z1: Vec3, z1_dot: Vec3, angles: Vec3, thrust: float, b_hat: Vec3, acceleration: Vec3, jerk: Vec3
) -> None:
    state = LawState(z1, z1_dot, z1_dot, quaternion(angles), thrust, b_hat, acceleration, jerk)
    step = backstep(FLOATS, LAW, state, mass=0.08)
    assert all(math.isfinite(x) for x in numbers(step))


def test_what_is_suspended_learns_nothing() -> None:
    def learns(suspended: bool) -> Vec3:
        speed, level, b_hat = (0.0, 0.1, 0.0), quaternion((0.1, 0.0, 0.0)), (0.1, 0.2, 0.3)
        state = LawState(
            (0.1, -0.2, 0.1), speed, speed, level, 0.8, b_hat, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        )
        step = backstep(
            FLOATS, LAW, state, mass=0.08, composite_term=(0.3, 0.3, 0.3), suspended=suspended
        )
        return step.b_hat_dot

    assert learns(True) == (0.0, 0.0, 0.0)
    assert all(rate != 0.0 for rate in learns(False))


@given(angle, small, small, small, st.floats(0.0, 5.0))
def test_the_yaw_rate_is_limited_and_turns_the_short_way(
    angles: Vec3, yaw: float, yaw_dot: float, rate_y: float, gain: float
) -> None:
    attitude = quaternion(angles)
    rate = compute_yaw_rate(FLOATS, attitude, yaw, yaw_dot, rate_y, gain, 2.0)
    roll, pitch, heading = so3.euler_zyx(attitude)
    cos_roll = math.copysign(max(abs(math.cos(roll)), 0.2), math.cos(roll))
    turn = math.cos(pitch) * (yaw_dot - gain * math.sin(heading - yaw)) - math.sin(roll) * rate_y
    assert rate == pytest.approx(min(max(turn / cos_roll, -2.0), 2.0), abs=1e-6)


@given(st.lists(st.tuples(vec, vec, angle, st.floats(0.2, 2.0), vec, vec), min_size=1, max_size=8))
def test_arrays_of_vehicles_agree_with_one_vehicle_at_a_time(states: list[tuple[Any, ...]]) -> None:
    ops = arrays()
    quaternions = [quaternion(s[2]) for s in states]

    def column(values: list[Any]) -> Any:
        return tuple(np.array(x) for x in zip(*values, strict=True))

    z1, z1_dot, b_hat, acceleration = (column([s[k] for s in states]) for k in (0, 1, 4, 5))
    q, still = column(quaternions), (0.0, 0.0, 0.0)
    thrust: Any = np.array([s[3] for s in states])
    of_all = LawState(z1, z1_dot, z1_dot, q, thrust, b_hat, still, acceleration)
    batch = backstep(ops, LAW, of_all, mass=0.08, drag=0.3)
    for i, s in enumerate(states):
        one = LawState(s[0], s[1], s[1], quaternions[i], s[3], s[4], (0.0, 0.0, 0.0), s[5])
        single = backstep(FLOATS, LAW, one, mass=0.08, drag=0.3)
        for a, e in zip(numbers(batch), numbers(single), strict=True):
            assert abs(np.asarray(a)[i] - e) <= 1e-9 * max(1.0, abs(e))


# ---- what an independent implementation computed

VECTORS = Path(__file__).parents[1] / "golden" / "control_law_vectors.json"


def test_the_law_agrees_with_every_independent_vector() -> None:
    worst, count = worst_disagreement(VECTORS)
    assert count == 40
    assert worst <= LIMIT


@pytest.mark.parametrize(
    ("factor", "worst"), [(2.0, 0.5), (math.nan, math.inf)], ids=["half of it", "no number"]
)
def test_a_disagreement_is_a_share_of_what_was_expected(
    factor: float, worst: float, tmp_path: Path
) -> None:
    vector = json.loads(VECTORS.read_bytes())["vectors"][0]
    vector["output"]["W"] *= factor
    (tmp_path / "one.json").write_text(json.dumps({"vectors": [vector]}))
    assert worst_disagreement(tmp_path / "one.json")[0] == pytest.approx(worst)
