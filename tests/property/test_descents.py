"""Bring-down and descent on the model: within their limits from any state, and gentle."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, strategies as st
from msgspec.structs import replace

from groundstation.core.control import OFF, plan_bring_down, plan_model_descent
from groundstation.core.geometry import ZERO, Vec3, so3
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle
from links.core import Segment
from tests.calm_air import fly_on

# By their numbers: a limit that the test took from the code would bear out any value.
SINK_S = 1.45
BRAKE_S = 0.35
MOST = 1.15
BRING_DOWN_LIMIT_S = 2.0

G = 9.81
MQX = Vehicle()
BIG = Vehicle(mass_kg=1.0, thrust_max_n=20.0, thrust_min_n=0.5, thrust_lag_s=0.03, rate_lag_s=0.02)
DRAGGED = {f"drag {drag}/s": replace(BIG, drag_per_s=drag) for drag in (0.3, 1.0, 2.0)}
IDEAL = Vehicle(thrust_lag_s=0.0, rate_lag_s=0.0, rate_limits_deg_s=(1e5, 1e5, 1e5))
WEAK = Vehicle(thrust_max_n=1.03 * G * MQX.mass_kg)
VEHICLES = {"mqx": MQX, "big": BIG, "ideal": IDEAL}
HOVER_N = G * MQX.mass_kg
Plan = Callable[..., tuple[Segment, ...]]


def parts(
    motion: Motion,
    height_m: float,
    vehicle: Vehicle = MQX,
    disturbance: Vec3 = ZERO,
    plan: Plan = plan_bring_down,
) -> tuple[Segment, ...]:
    pull = {"mass_kg": vehicle.mass_kg, "gravity": G, "disturbance": disturbance}
    return plan(motion, vehicle, height_m=height_m, **pull)


def descent(motion: Motion, height_m: float, disturbance: Vec3 = ZERO) -> tuple[Segment, ...]:
    return parts(motion, height_m, MQX, disturbance, plan_model_descent)


def hovering(vehicle: Vehicle = MQX, share: float = 1.0, **state: Vec3) -> Motion:
    """A vehicle at rest whose rotors give a share of its weight, but for what ``state`` tells."""
    velocity, euler, rates = (state.get(name, ZERO) for name in ("velocity", "euler", "rates"))
    return Motion(ZERO, velocity, so3.from_euler_zyx(*euler), share * G * vehicle.mass_kg, rates)


def flown(
    motion: Motion,
    segments: tuple[Segment, ...],
    height_m: float,
    vehicle: Vehicle = MQX,
    steps: int = 1,
) -> list[Motion]:
    """The motion after each step until the floor, by the controller's own model in calm air."""
    path = [motion]
    for segment in segments:
        drive = ActuatorCommand(segment.thrust_n, segment.rates_rad_s)
        for _ in range(steps):
            motion = fly_on(vehicle, motion, drive, segment.duration_s / steps)
            path.append(motion)
            if motion.position[2] >= height_m:
                return path
    return path


anything = st.floats(-1e3, 1e3)
unit = st.floats(-1.0, 1.0)
turned = st.tuples(*[unit] * 4).filter(lambda q: sum(x * x for x in q) > 0.1).map(so3.normalize)
spinning = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
fast = st.tuples(*[anything] * 3)
wild = st.builds(Motion, st.just(ZERO), fast, turned, st.floats(0.0, 30.0), spinning)
tilt = st.floats(-1.2, 1.2)
leaning = st.builds(so3.from_euler_zyx, tilt, tilt, st.just(0.3))
slow = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
pushing = st.floats(0.0, MQX.thrust_max_n)
moderate = st.builds(Motion, st.just(ZERO), slow, leaning, pushing, slow)


@pytest.mark.parametrize("plan", [plan_bring_down, plan_model_descent])
@given(
    motion=wild,
    disturbance=st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    height_m=st.floats(-100.0, 1e4),
    vehicle=st.sampled_from([*VEHICLES.values()]),
)
def test_any_state_gives_a_descent_within_the_limits_that_ends_with_the_motors_off(
    plan: Plan, motion: Motion, disturbance: Vec3, height_m: float, vehicle: Vehicle
) -> None:
    found = parts(motion, height_m, vehicle, disturbance, plan)
    assert sum(part.duration_s for part in found) <= BRING_DOWN_LIMIT_S + 1e-9
    assert found[-1:] == OFF
    for part in found:
        assert part.duration_s > 0.0
        assert 0.0 <= part.thrust_n <= vehicle.thrust_max_n
        for rate, limit in zip(part.rates_rad_s, vehicle.rate_limits_deg_s, strict=True):
            assert (
                abs(rate) <= math.radians(limit) * (1.0 + 1e-9) or part.duration_s > 0.99 * SINK_S
            )


Row = tuple[float, float, float, float]
Profile = tuple[Vehicle, dict[str, Any], float, Vec3, list[Row]]
PROFILES: dict[str, Profile] = {
    "hovering at 1 m": (MQX, {}, 1.0, ZERO,
         [(0.15, 0.7738, 0.0, 0.0), (0.5854, 0.7738, 0.0, 0.0), (0.421, 1.1462, 0.0, 0.0),
          (0.4, 0.8928, 0.0, 0.0)]),
    "hovering at 2 m: it sinks at its greatest speed for a while": (MQX, {}, 2.0, ZERO,
         [(0.15, 0.5876, 0.0, 0.0), (0.2553, 0.5876, 0.0, 0.0), (0.5947, 0.96, 0.0, 0.0),
          (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "just off the floor": (MQX, {}, 0.05, ZERO,
         [(0.15, 0.8832, 0.0, 0.0), (0.7633, 0.8832, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "with smaller lags": (BIG, {}, 0.3, ZERO,
         [(0.15, 0.8832, 0.0, 0.0), (0.8394, 0.8832, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "too fast already: brake at once": (MQX, {"velocity": (0.0, 0.0, 2.0)}, 1.0, ZERO,
         [(0.15, 1.1462, 0.0, 0.0), (0.3, 1.1462, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "the same in air that brakes, too": (DRAGGED["drag 1.0/s"], {"velocity": (0.0, 0.0, 2.0)}, 1.0,
         ZERO, [(0.15, 1.0121, 0.0, 0.0), (0.3, 1.0121, 0.0, 0.0), (0.4, 0.82, 0.0, 0.0)]),
    "rising: it falls longer": (MQX, {"velocity": (0.0, 0.0, -1.0)}, 1.0, ZERO,
         [(0.15, 0.7738, 0.0, 0.0), (1.14, 0.7738, 0.0, 0.0), (0.16, 1.1462, 0.0, 0.0),
          (0.4, 0.8928, 0.0, 0.0)]),
    "rolled and pitched": (MQX, {"euler": (0.5, -0.2, 0.7)}, 1.5, ZERO,
         [(0.15, 0.7059, -3.2872, 1.3899), (0.3394, 0.6807, 0.0, 0.0), (0.3543, 0.96, 0.0, 0.0),
          (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "far over: the turn at the rate limit": (MQX, {"euler": (1.4, 0.0, 0.7)}, 1.5, ZERO,
         [(0.2377, 0.89, -3.4907, 0.0), (0.1634, 0.96, -3.4907, 0.0), (0.2733, 0.96, 0.0, 0.0),
          (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "on its back": (MQX, {"euler": (math.pi, 0.0, 0.0)}, 3.0, ZERO,
         [(0.1136, 0.0255, 0.0, 3.4907), (0.7864, 0.0255, 0.0, 3.4907), (0.1, 0.96, 0.0, 0.0),
          (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "turning: the lag takes τ ω more": (MQX, {"rates": (1.0, -0.7, 0.5)}, 1.5, ZERO,
         [(0.15, 0.6822, -0.6939, 0.5137), (0.3904, 0.6807, 0.0, 0.0), (0.3519, 0.96, 0.0, 0.0),
          (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "in wind, and heavier by 1 m/s²": (MQX, {}, 1.5, (0.5, -0.3, 1.0),
         [(0.15, 0.7504, 0.1848, 0.3081), (0.3567, 0.7501, 0.0, 0.0), (0.353, 1.0579, 0.0, 0.0),
          (0.45, 1.2906, 0.0, 0.0), (0.4, 0.9838, 0.0, 0.0)]),
    "in a storm from the south: it leans by 0.18 at most": (MQX, {}, 2.0, (9.0, 0.0, 0.0),
         [(0.15, 0.59, 0.0, 1.1873), (0.2553, 0.5876, 0.0, 0.0), (0.5947, 0.96, 0.0, 0.0),
          (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    "lighter than anything plausible": (MQX, {}, 1.5, (0.0, 0.0, -6.0),
         [(0.15, 0.3404, 0.0, 0.0), (0.7552, 0.3404, 0.0, 0.0), (0.0948, 0.48, 0.0, 0.0),
          (0.45, 0.5856, 0.0, 0.0), (0.4, 0.4464, 0.0, 0.0)]),
    "hardly any spare thrust": (WEAK, {}, 1.5, ZERO,
         [(0.15, 0.9355, 0.0, 0.0), (1.3, 0.9355, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
}  # fmt: skip
"""Vehicle, its state where it is not at hover, height [m], disturbance [m/s²]; and the segments
before zero thrust: duration [s], thrust as a share of the weight [-], body rates of roll and pitch
[rad/s]."""


@pytest.mark.parametrize("row", PROFILES.values(), ids=PROFILES)
def test_the_bring_down_falls_sinks_brakes_and_settles_in_these_numbers(row: Profile) -> None:
    vehicle, state, height_m, disturbance, profile = row
    *found, off = parts(hovering(vehicle, **state), height_m, vehicle, disturbance)
    weight_n = G * vehicle.mass_kg
    rows = [(s.duration_s, s.thrust_n / weight_n, *s.rates_rad_s[:2]) for s in found]
    lasting = [one for one in rows if one[0] > 1e-3]
    assert lasting == [pytest.approx(one, abs=1e-4) for one in profile]
    assert (off.duration_s, off.thrust_n, off.rates_rad_s) == (0.15, 0.0, ZERO)


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)
@pytest.mark.parametrize("roll_deg", [-50.0, 20.0])
@pytest.mark.parametrize("pitch_deg", [0.0, 35.0])
def test_a_bring_down_levels_through_the_lag_whatever_the_tilt_and_the_rates(
    vehicle: Vehicle, roll_deg: float, pitch_deg: float
) -> None:
    euler = (math.radians(roll_deg), math.radians(pitch_deg), 0.7)
    motion = hovering(vehicle, euler=euler, rates=(1.0, -0.7, 0.5))
    end = flown(motion, parts(motion, 2.0, vehicle), 10.0, vehicle, 200)[-1]
    assert math.degrees(math.acos(min(1.0, so3.third_column(end.attitude)[2]))) < 3.0


@pytest.mark.parametrize("vehicle", [MQX, BIG, *DRAGGED.values()], ids=["mqx", "big", *DRAGGED])
@pytest.mark.parametrize("height_m", [0.1, 0.3, 0.7, 1.2, 1.6, 2.0])
@pytest.mark.parametrize("speed_m_s", [-0.5, 0.0, 0.4])
def test_where_the_model_is_right_a_bring_down_meets_the_floor_gently(
    vehicle: Vehicle, height_m: float, speed_m_s: float
) -> None:
    motion = hovering(vehicle, velocity=(0.0, 0.0, speed_m_s))
    met = flown(motion, parts(motion, height_m, vehicle), height_m, vehicle, 200)[-1]
    assert met.position[2] >= height_m, "it came to the floor"
    assert 0.0 < met.velocity[2] < 1.6


def test_on_the_floor_only_the_motors_stop() -> None:
    assert parts(hovering(), 0.0) == parts(hovering(), -5.0) == OFF


@pytest.mark.parametrize("vehicle", [MQX, BIG], ids=["mqx", "big"])
def test_a_vehicle_that_sinks_already_is_let_fall_for_a_shorter_time(vehicle: Vehicle) -> None:
    def falls_s(share: float) -> float:
        found = parts(hovering(vehicle, share), 2.0, vehicle)
        assert found[0].thrust_n < G * vehicle.mass_kg
        return sum(part.duration_s for part in found if part.thrust_n == found[0].thrust_n)

    assert falls_s(0.5) < falls_s(1.0) < falls_s(1.2)


@given(moderate, st.floats(0.0, 5.0))
def test_a_descent_on_the_model_pushes_briefly_above_hover(motion: Motion, height_m: float) -> None:
    found = descent(motion, height_m)
    over = [part for part in found if part.thrust_n > HOVER_N * (1.0 + 1e-9)]
    assert all(part.thrust_n <= MOST * HOVER_N * (1.0 + 1e-9) for part in over)
    assert sum(part.duration_s for part in over) <= BRAKE_S + 1e-9
    for part, at in zip(found, flown(motion, found, height_m), strict=False):
        assert at.velocity[2] >= 0.0 or part not in over


@given(st.floats(0.3, 2.0), st.floats(-1.0, 1.0), st.floats(-0.5, 0.5))
def test_from_a_rooms_height_it_meets_the_floor_slowly(
    height_m: float, speed: float, tilt: float
) -> None:
    motion = hovering(velocity=(speed, -speed, 0.0), euler=(tilt, -tilt, 0.0))
    end = flown(motion, descent(motion, height_m), height_m)[-1]
    assert end.position[2] >= height_m, "it comes down within its time"
    assert end.velocity[2] < 2.5
    assert math.hypot(end.position[0], end.position[1]) < 1.5


def test_a_vehicle_that_seems_to_lie_sinks_before_its_motors_stop() -> None:
    *found, off = descent(hovering(share=0.0), 0.0)
    assert off.thrust_n == 0.0
    assert all(part.thrust_n <= HOVER_N for part in found)
    assert sum(part.duration_s for part in found) < 0.8


FAST: dict[str, Any] = {"velocity": (1.5, -1.0, 0.0), "euler": (-0.2, 0.3, 0.3)}
LEANS: dict[str, Any] = {"velocity": (1.5, 0.0, 0.0), "euler": (0.0, -0.9, 0.0)}
Planned = tuple[dict[str, Any], float, Vec3, int, list[float], list[Vec3]]
PLANS: dict[str, Planned] = {
    "hovering at 1 m": ({}, 1.0, ZERO, 20,
         [0.4, 0.998, 1.0], [ZERO, ZERO]),
    "fast sideways, leaning against it": (FAST, 1.5, ZERO, 27,
         [0.4, 0.976, 1.079, 1.0], [(3.491, -0.858, 0.0), (-0.618, -0.31, 0.0)]),
    "leaning along its velocity: thrust would accelerate it": (LEANS, 1.5, ZERO, 17,
         [0.2, 1.115], [(0.0, 3.491, 0.0), (0.0, 0.453, 0.0)]),
    "the same, high": (LEANS, 4.0, ZERO, 37,
         [0.2, 1.115, 1.0, 1.0, 1.0], [(0.0, 3.491, 0.0), (0.0, 0.453, 0.0)]),
    "sinking fast: braked for a while": ({"velocity": (0.0, 0.0, 2.5)}, 1.0, ZERO, 10,
         [1.115, 1.0], [ZERO, ZERO]),
    "on its side": ({"euler": (1.4, 0.0, 0.0), "rates": (1.0, 0.5, -0.5)}, 2.0, ZERO, 15,
         [0.025, 0.2], [(-3.491, -0.5, 0.5), (-3.474, -0.02, 0.0)]),
    "in wind, heavier": ({}, 1.0, (1.0, -0.5, 1.5), 20,
         [0.461, 1.182, 1.153], [(1.191, 2.383, 0.0), (-0.124, -0.249, 0.0)]),
    "hardly above the floor": ({}, 0.1, ZERO, 9,
         [0.4], [ZERO, ZERO]),
}  # fmt: skip
"""State where it is not at hover, height [m], disturbance [m/s²]; and of the plan: the number of
its parts, the thrust of each eighth as a share of what hovers [-], and the rates of the first and
of the ninth [rad/s]."""


@pytest.mark.parametrize("row", PLANS.values(), ids=PLANS)
def test_the_descent_on_the_model_has_these_numbers(row: Planned) -> None:
    state, height_m, disturbance, count, thrusts, rates = row
    *found, off = descent(hovering(**state), height_m, disturbance)
    assert (len(found) + 1, {part.duration_s for part in found}) == (count, {0.05})
    assert [part.thrust_n / HOVER_N for part in found[::8]] == pytest.approx(thrusts, abs=6e-4)
    assert [part.rates_rad_s for part in [*found, off][:9:8]] == [
        pytest.approx(rate, abs=6e-4) for rate in rates
    ]
    assert (off.duration_s, off.thrust_n) == (0.15, 0.0)
