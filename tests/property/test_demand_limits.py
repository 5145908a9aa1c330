"""Limits on the law's demands: the vertical axis keeps its reserve, and nothing jumps."""

import math
from typing import Any

import numpy as np
from hypothesis import assume, given, strategies as st

from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.geometry import FLOATS, Quat, Vec3, arrays, rotate, third_column
from groundstation.core.geometry.so3 import from_euler_zyx
from groundstation.core.vehicle import ActuatorCommand, Vehicle

# By their numbers: a limit that the test took from the code would bear out any value.
LEAST_COSINE = math.cos(math.radians(80.0))
RESERVE = 1.03
YAW_RAD_S2 = 2.5

VEHICLE = Vehicle()
LIMITS = DemandLimits(FLOATS, VEHICLE)
K_OMEGA = 14.0
MOST = VEHICLE.thrust_max_n / VEHICLE.mass_kg
G = 9.81
angle = st.floats(-1.5, 1.5)
rate = st.floats(-30.0, 30.0)
little = st.floats(-1e-4, 1e-4)
turning = st.tuples(st.floats(-3.5, 3.5), st.floats(-3.5, 3.5), st.floats(-5.0, 5.0))
cosine = st.floats(LEAST_COSINE, 0.999)
leaning = st.builds(from_euler_zyx, angle, angle, angle)
Rates = tuple[float, float]


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_the_yaw_rate_changes_no_faster_than_rotors_can_spare(now: float, wanted: float) -> None:
    told = LIMITS.limit_yaw(now, wanted)
    assert min(now, wanted) <= told <= max(now, wanted)
    step = YAW_RAD_S2 * max(VEHICLE.rate_lag_s, VEHICLE.frame_period_s)
    assert abs(told - now) <= step + 1e-12
    assert told == wanted or math.isclose(abs(told - now), step)


@given(leaning, st.tuples(st.floats(-3.5, 3.5), st.floats(-3.5, 3.5)), cosine)
def test_no_demand_takes_the_tilt_beyond_its_limit(
    attitude: Quat, rates: Rates, least: float
) -> None:
    """From any attitude inside, 0.75 s of one demand, with the law's own rate loop."""
    turns = (0.0, 0.0, 0.0)
    assume(third_column(attitude)[2] > least)
    h, frame = 0.0005, VEHICLE.frame_period_s
    x = y = 0.0
    for step in range(1500):
        if step % round(frame / h) == 0:
            x, y, _ = LIMITS.limit_tilt(attitude, turns, rates, least, K_OMEGA)
        p, q, _ = turns
        turns = (p + h * K_OMEGA * (x - p), q + h * K_OMEGA * (y - q), 0.0)
        attitude = rotate(attitude, (h * turns[0], h * turns[1], 0.0))
        # Commands are held for a frame: by so much it may be over.
        assert third_column(attitude)[2] > least - 0.03


@given(st.floats(0.0, 1.37), st.floats(0.6, 1.4), st.floats(-6.0, 8.0), angle, angle)
def test_at_rest_full_thrust_at_the_limit_carries_the_weight_and_its_reserve(
    thrust: float, effectiveness: float, down: float, roll: float, pitch: float
) -> None:
    attitude = from_euler_zyx(roll, pitch, 0.3)
    up = third_column(attitude)[2] * thrust / VEHICLE.mass_kg
    least = LIMITS.find_least_cosine(attitude, thrust, effectiveness, G + down, 0.0)
    hover = G + down + (1.0 - effectiveness) * up
    if RESERVE * hover <= MOST:
        assert MOST * least >= RESERVE * hover - 1e-9
    else:
        assert least == 1.0


@given(st.floats(0.4, 0.7), st.floats(-10.0, 10.0))
def test_a_climb_moves_the_limit_by_half_of_what_is_left_at_most(
    share: float, vertical: float
) -> None:
    attitude = (1.0, 0.0, 0.0, 0.0)
    level = LIMITS.find_least_cosine(attitude, 0.8, 1.0, share * MOST, 0.0)
    least = LIMITS.find_least_cosine(attitude, 0.8, 1.0, share * MOST, vertical)
    assert 0.5 * level - 1e-12 <= least <= 0.5 * (1.0 + level) + 1e-12
    assert (least - level) * vertical <= 1e-12
    fall, climb = (
        LIMITS.find_least_cosine(attitude, 0.8, 1.0, share * MOST, sign * 1e3) for sign in (1, -1)
    )
    assert fall == max(0.5 * level, LEAST_COSINE)
    assert climb == 0.5 * (1.0 + level)


@given(leaning, turning, st.tuples(rate, rate), cosine)
def test_inside_nothing_changes_and_beyond_the_change_is_the_smallest(
    attitude: Quat, turns: Vec3, rates: Rates, least: float
) -> None:
    rate_x, rate_y = rates
    x, y, limited = LIMITS.limit_tilt(attitude, turns, rates, least, K_OMEGA)
    if not limited:
        assert (x, y) == rates
        return
    w, a, b, c = attitude
    r31, r32 = 2.0 * (a * c - w * b), 2.0 * (b * c + w * a)
    # Along the gradient of c alone, and by as much as brings c˙ to its bound, where the tilt is
    # large enough.
    assert math.isclose((x - rate_x) * r31, (y - rate_y) * -r32, abs_tol=1e-6, rel_tol=1e-6)
    if r31 * r31 + r32 * r32 > 0.04:
        stopped = third_column(attitude)[2] + (r31 * turns[1] - r32 * turns[0]) / K_OMEGA
        bound = (K_OMEGA - 1.0 / VEHICLE.frame_period_s) * (stopped - least)
        assert math.isclose(r31 * y - r32 * x, bound, rel_tol=1e-6, abs_tol=1e-6)


@given(leaning, turning, st.tuples(rate, rate), st.tuples(little, little), cosine)
def test_a_small_change_of_the_demand_changes_the_outcome_little(
    attitude: Quat, turns: Vec3, rates: Rates, change: Rates, least: float
) -> None:
    other = (rates[0] + change[0], rates[1] + change[1])
    x, y, _ = LIMITS.limit_tilt(attitude, turns, rates, least, K_OMEGA)
    p, q, _ = LIMITS.limit_tilt(attitude, turns, other, least, K_OMEGA)
    assert math.hypot(p - x, q - y) <= math.hypot(*change) + 1e-9


@given(st.floats(0.02, 1.37), st.floats(-50.0, 50.0))
def test_a_thrust_at_its_limit_has_no_rate_beyond_it(thrust: float, thrust_rate: float) -> None:
    lead_s = 0.11
    limited = LIMITS.limit_thrust_rate(thrust, thrust_rate, lead_s)
    ends = thrust + lead_s * limited
    assert VEHICLE.thrust_min_n - 1e-9 <= ends <= VEHICLE.thrust_max_n + 1e-9
    if VEHICLE.thrust_min_n <= thrust + lead_s * thrust_rate <= VEHICLE.thrust_max_n:
        assert limited == thrust_rate


@given(st.floats(-1.0, 3.0), st.tuples(rate, rate, rate))
def test_every_command_is_clamped_axis_by_axis(thrust: float, rates: Vec3) -> None:
    (inside, turns), cut = LIMITS.clamp(thrust, rates)
    most = tuple(math.radians(limit) for limit in VEHICLE.rate_limits_deg_s)
    assert inside == min(max(thrust, VEHICLE.thrust_min_n), VEHICLE.thrust_max_n)
    assert turns == tuple(
        min(max(turn, -limit), limit) for turn, limit in zip(rates, most, strict=True)
    )
    assert cut == ((inside, turns) != (thrust, rates))
    assert not cut or LIMITS.is_at_limit(ActuatorCommand(inside, turns))


@given(st.lists(st.tuples(angle, angle, rate, rate, cosine), min_size=1, max_size=5))
def test_arrays_are_limited_as_floats_are(
    rows: list[tuple[float, float, float, float, float]],
) -> None:
    attitudes = [from_euler_zyx(roll, pitch, 0.2) for roll, pitch, *_ in rows]
    together: Any = DemandLimits(arrays(), VEHICLE)
    columns = tuple(np.array(part) for part in zip(*attitudes, strict=True))
    x, y, least = (np.array([row[k] for row in rows]) for k in (2, 3, 4))
    zero = np.zeros(len(rows))
    found = together.limit_tilt(columns, (zero, zero, zero), (x, y), least, K_OMEGA)
    for i, attitude in enumerate(attitudes):
        alone = LIMITS.limit_tilt(attitude, (0.0, 0.0, 0.0), (x[i], y[i]), least[i], K_OMEGA)
        assert [part[i] for part in found] == list(alone)
