"""The descent on the model: sparing with thrust, and down within two seconds."""

import math

import pytest
from hypothesis import given, strategies as st

from groundstation.core.control import plan_model_descent
from groundstation.core.geometry import FLOATS, Vec3
from groundstation.core.geometry.so3 import from_euler_zyx
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, integrate
from links.core import Segment

# By their numbers: a limit that the test took from the code would bear out any value.
BRAKE_S = 0.35
MOST = 1.15
BRING_DOWN_LIMIT_S = 2.0

VEHICLE = Vehicle()
GRAVITY = 9.81
HOVER = VEHICLE.mass_kg * GRAVITY

speeds = st.floats(-3.0, 3.0)
tilts = st.floats(-1.2, 1.2)
motions = st.builds(
    lambda velocity, roll, pitch, thrust, rates: Motion(
        (0.0, 0.0, 0.0), velocity, from_euler_zyx(roll, pitch, 0.3), thrust, rates
    ),
    st.tuples(speeds, speeds, speeds),
    tilts,
    tilts,
    st.floats(0.0, VEHICLE.thrust_max_n),
    st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
)


def planned(motion: Motion, height_m: float, disturbance: Vec3 = (0.0, 0.0, 0.0)) -> tuple[Segment, ...]:
    return plan_model_descent(
        motion, VEHICLE, mass_kg=VEHICLE.mass_kg, gravity=GRAVITY, disturbance=disturbance, height_m=height_m
    )


def flown(motion: Motion, parts: tuple[Segment, ...], height_m: float) -> list[Motion]:
    """The motion after each part, until the floor."""
    path = [motion]
    for part in parts:
        drive = ActuatorCommand(part.thrust_n, part.rates_rad_s)
        motion = integrate(
            FLOATS, motion, drive, part.duration_s, mass=VEHICLE.mass_kg, gravity=GRAVITY,
            disturbance=(0.0, 0.0, 0.0), thrust_lag=VEHICLE.thrust_lag_s, rate_lag=VEHICLE.rate_lag_s,
        )  # fmt: skip
        path.append(motion)
        if motion.position[2] >= height_m:
            break
    return path


@given(motions, st.floats(0.0, 5.0))
def test_thrust_is_never_far_above_what_hovers_and_not_for_long(motion: Motion, height_m: float) -> None:
    parts = planned(motion, height_m)
    over = [part for part in parts if part.thrust_n > HOVER * (1.0 + 1e-9)]
    assert all(part.thrust_n <= MOST * HOVER * (1.0 + 1e-9) for part in parts)
    assert sum(part.duration_s for part in over) <= BRAKE_S + 1e-9


@given(motions, st.floats(0.0, 5.0))
def test_nothing_pushes_above_what_hovers_while_the_model_rises(motion: Motion, height_m: float) -> None:
    parts = planned(motion, height_m)
    for part, at in zip(parts, flown(motion, parts, height_m), strict=False):
        if at.velocity[2] < 0.0:
            assert part.thrust_n <= HOVER * (1.0 + 1e-9)


@given(motions, st.floats(0.0, 5.0))
def test_it_fits_into_what_a_link_plays_and_ends_with_zero_thrust(motion: Motion, height_m: float) -> None:
    parts = planned(motion, height_m)
    assert sum(part.duration_s for part in parts) <= BRING_DOWN_LIMIT_S + 1e-9
    assert parts[-1].thrust_n == 0.0
    for part in parts:
        assert all(
            abs(rate) <= math.radians(limit) + 1e-9
            for rate, limit in zip(part.rates_rad_s, VEHICLE.rate_limits_deg_s, strict=True)
        )


@given(st.floats(0.3, 2.0), st.floats(-1.0, 1.0), st.floats(-0.5, 0.5))
def test_from_a_room_s_height_it_meets_the_floor_slowly_and_without_going_far(
    height_m: float, speed: float, tilt: float
) -> None:
    motion = Motion((0.0, 0.0, 0.0), (speed, -speed, 0.0), from_euler_zyx(tilt, -tilt, 0.0), HOVER, (0.0, 0.0, 0.0))
    path = flown(motion, planned(motion, height_m), height_m)
    end = path[-1]
    assert end.position[2] >= height_m, "it comes down within its time"
    assert end.velocity[2] < 2.5
    assert math.hypot(end.position[0], end.position[1]) < 1.5


def test_what_seems_to_lie_on_the_floor_may_hang_above_it_and_sinks_before_its_motors_stop() -> None:
    motion = Motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0))
    *parts, off = planned(motion, 0.0)
    assert off.thrust_n == 0.0
    assert all(part.thrust_n <= HOVER for part in parts)
    assert sum(part.duration_s for part in parts) < 0.8


PLANS: list[tuple[dict[str, Vec3], float, Vec3, int, list[float], list[Vec3]]] = [
    # hovering at 1 m
    ({}, 1.0, (0.0, 0.0, 0.0), 20,
     [0.4, 0.998, 1.0], [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]),
    # fast sideways, leaning against it
    ({"velocity": (1.5, -1.0, 0.0), "euler": (-0.2, 0.3, 0.3)}, 1.5, (0.0, 0.0, 0.0), 27,
     [0.4, 0.976, 1.079, 1.0], [(3.491, -0.858, 0.0), (-0.618, -0.31, 0.0)]),
    # leaning along its velocity: thrust would accelerate it
    ({"velocity": (1.5, 0.0, 0.0), "euler": (0.0, -0.9, 0.0)}, 1.5, (0.0, 0.0, 0.0), 17,
     [0.2, 1.115], [(0.0, 3.491, 0.0), (0.0, 0.453, 0.0)]),
    # the same, high
    ({"velocity": (1.5, 0.0, 0.0), "euler": (0.0, -0.9, 0.0)}, 4.0, (0.0, 0.0, 0.0), 37,
     [0.2, 1.115, 1.0, 1.0, 1.0], [(0.0, 3.491, 0.0), (0.0, 0.453, 0.0)]),
    # sinking fast: braked for a while
    ({"velocity": (0.0, 0.0, 2.5)}, 1.0, (0.0, 0.0, 0.0), 10,
     [1.115, 1.0], [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]),
    # on its side
    ({"euler": (1.4, 0.0, 0.0), "rates": (1.0, 0.5, -0.5)}, 2.0, (0.0, 0.0, 0.0), 15,
     [0.025, 0.2], [(-3.491, -0.5, 0.5), (-3.474, -0.02, 0.0)]),
    # in wind, heavier
    ({}, 1.0, (1.0, -0.5, 1.5), 20,
     [0.461, 1.182, 1.153], [(1.191, 2.383, 0.0), (-0.124, -0.249, 0.0)]),
    # hardly above the floor
    ({}, 0.1, (0.0, 0.0, 0.0), 9,
     [0.4], [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]),
]  # fmt: skip
"""State where it is not at hover, height [m], disturbance [m/s²]; and of the plan: the number of its parts, the thrust
of each eighth as a share of what hovers [-], and the rates of the first and of the ninth [rad/s]."""


@pytest.mark.parametrize(("state", "height_m", "disturbance", "count", "thrusts", "rates"), PLANS)
def test_the_plan_has_these_numbers(
    state: dict[str, Vec3], height_m: float, disturbance: Vec3, count: int, thrusts: list[float], rates: list[Vec3]
) -> None:
    at_rest = (0.0, 0.0, 0.0)
    attitude = from_euler_zyx(*state.get("euler", at_rest))
    motion = Motion(at_rest, state.get("velocity", at_rest), attitude, HOVER, state.get("rates", at_rest))
    *parts, off = planned(motion, height_m, disturbance)
    assert (len(parts) + 1, {part.duration_s for part in parts}) == (count, {0.05})
    assert [part.thrust_n / HOVER for part in parts[::8]] == pytest.approx(thrusts, abs=6e-4)
    assert [part.rates_rad_s for part in [*parts, off][:9:8]] == [pytest.approx(rate, abs=6e-4) for rate in rates]
    assert (off.duration_s, off.thrust_n) == (0.15, 0.0)
