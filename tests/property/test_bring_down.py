"""The bring-down as a function of the state: always within its limits, level at its end, and gentle where it can be."""

import math

import pytest
from hypothesis import given, strategies as st

from groundstation.core.control import OFF, plan_bring_down
from groundstation.core.geometry import FLOATS, Vec3, so3
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, integrate
from links.core import Segment

# By their numbers: a limit that the test took from the code would bear out any value.
SINK_S = 1.45
BRING_DOWN_LIMIT_S = 2.0

MQX = Vehicle()
BIG = Vehicle(mass_kg=1.0, thrust_max_n=20.0, thrust_min_n=0.5, thrust_lag_s=0.03, rate_lag_s=0.02)
IDEAL = Vehicle(thrust_lag_s=0.0, rate_lag_s=0.0, rate_limits_deg_s=(1e5, 1e5, 1e5))
WEAK = Vehicle(thrust_max_n=1.03 * 9.81 * MQX.mass_kg)
VEHICLES = [MQX, BIG, IDEAL]
CALM: Vec3 = (0.0, 0.0, 0.0)


def parts(motion: Motion, vehicle: Vehicle, height_m: float, disturbance: Vec3 = CALM) -> tuple[Segment, ...]:
    return plan_bring_down(
        motion, vehicle, mass_kg=vehicle.mass_kg, gravity=9.81, disturbance=disturbance, height_m=height_m
    )


def played(motion: Motion, vehicle: Vehicle, segments: tuple[Segment, ...], height_m: float) -> tuple[Motion, Motion]:
    """The state as it meets the floor (or at the end), and that after it, by the controller's own model in calm air."""
    for segment in segments:
        drive = ActuatorCommand(segment.thrust_n, segment.rates_rad_s)
        for _ in range(200):
            if motion.position[2] >= height_m:
                return motion, motion
            motion = integrate(
                FLOATS, motion, drive, segment.duration_s / 200,
                mass=vehicle.mass_kg, gravity=9.81, disturbance=CALM,
                thrust_lag=vehicle.thrust_lag_s, rate_lag=vehicle.rate_lag_s,
            )  # fmt: skip
    return motion, motion


def tilt_deg(motion: Motion) -> float:
    return math.degrees(math.acos(min(1.0, so3.third_column(motion.attitude)[2])))


anything = st.floats(-1e3, 1e3)
unit = st.floats(-1.0, 1.0)


@given(
    st.tuples(anything, anything, anything),
    st.tuples(unit, unit, unit, unit).filter(lambda q: sum(x * x for x in q) > 0.1),
    st.floats(0.0, 30.0),
    st.tuples(*[st.floats(-10.0, 10.0)] * 3),
    st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    st.floats(-100.0, 1e4),
    st.sampled_from(VEHICLES),
)
def test_any_state_gives_a_bring_down_within_the_limits_that_ends_with_the_motors_off(
    velocity: Vec3,
    attitude: tuple[float, float, float, float],
    thrust: float,
    rates: Vec3,
    disturbance: Vec3,
    height_m: float,
    vehicle: Vehicle,
) -> None:
    motion = Motion((0.0, 0.0, 0.0), velocity, so3.normalize(attitude), thrust, rates)
    found = parts(motion, vehicle, height_m, disturbance)
    assert sum(part.duration_s for part in found) <= BRING_DOWN_LIMIT_S + 1e-9
    assert found[-1:] == OFF
    for part in found:
        assert part.duration_s > 0.0
        assert 0.0 <= part.thrust_n <= vehicle.thrust_max_n
        for rate, limit in zip(part.rates_rad_s, vehicle.rate_limits_deg_s, strict=True):
            assert abs(rate) <= math.radians(limit) * (1.0 + 1e-9) or part.duration_s > 0.99 * SINK_S


PROFILES: list[tuple[Vehicle, dict[str, Vec3], float, Vec3, list[tuple[float, float, float, float]]]] = [
    # hovering at 1 m
    (MQX, {}, 1.0, CALM,
     [(0.15, 0.7738, 0.0, 0.0), (0.5854, 0.7738, 0.0, 0.0), (0.421, 1.1462, 0.0, 0.0),
      (0.4, 0.8928, 0.0, 0.0)]),
    # hovering at 2 m: it sinks at its greatest speed for a while
    (MQX, {}, 2.0, CALM,
     [(0.15, 0.5876, 0.0, 0.0), (0.2553, 0.5876, 0.0, 0.0), (0.5947, 0.96, 0.0, 0.0),
      (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # just off the floor
    (MQX, {}, 0.05, CALM,
     [(0.15, 0.8832, 0.0, 0.0), (0.7633, 0.8832, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # with smaller lags
    (BIG, {}, 0.3, CALM,
     [(0.15, 0.8832, 0.0, 0.0), (0.8394, 0.8832, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # too fast already: brake at once
    (MQX, {"velocity": (0.0, 0.0, 2.0)}, 1.0, CALM,
     [(0.15, 1.1462, 0.0, 0.0), (0.3, 1.1462, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # rising: it falls longer
    (MQX, {"velocity": (0.0, 0.0, -1.0)}, 1.0, CALM,
     [(0.15, 0.7738, 0.0, 0.0), (1.14, 0.7738, 0.0, 0.0), (0.16, 1.1462, 0.0, 0.0),
      (0.4, 0.8928, 0.0, 0.0)]),
    # rolled and pitched
    (MQX, {"euler": (0.5, -0.2, 0.7)}, 1.5, CALM,
     [(0.15, 0.7059, -3.2872, 1.3899), (0.3394, 0.6807, 0.0, 0.0), (0.3543, 0.96, 0.0, 0.0),
      (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # far over: the turn at the rate limit
    (MQX, {"euler": (1.4, 0.0, 0.7)}, 1.5, CALM,
     [(0.2377, 0.89, -3.4907, 0.0), (0.1634, 0.96, -3.4907, 0.0), (0.2733, 0.96, 0.0, 0.0),
      (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # on its back
    (MQX, {"euler": (math.pi, 0.0, 0.0)}, 3.0, CALM,
     [(0.1136, 0.0255, 0.0, 3.4907), (0.7864, 0.0255, 0.0, 3.4907), (0.1, 0.96, 0.0, 0.0),
      (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # turning: the lag takes τ ω more
    (MQX, {"rates": (1.0, -0.7, 0.5)}, 1.5, CALM,
     [(0.15, 0.6822, -0.6939, 0.5137), (0.3904, 0.6807, 0.0, 0.0), (0.3519, 0.96, 0.0, 0.0),
      (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # in wind, and heavier by 1 m/s²
    (MQX, {}, 1.5, (0.5, -0.3, 1.0),
     [(0.15, 0.7504, 0.1848, 0.3081), (0.3567, 0.7501, 0.0, 0.0), (0.353, 1.0579, 0.0, 0.0),
      (0.45, 1.2906, 0.0, 0.0), (0.4, 0.9838, 0.0, 0.0)]),
    # in a storm: it leans by 0.18 at most, the nose up where it blows north
    (MQX, {}, 2.0, (9.0, 0.0, 0.0),
     [(0.15, 0.59, 0.0, 1.1873), (0.2553, 0.5876, 0.0, 0.0), (0.5947, 0.96, 0.0, 0.0),
      (0.45, 1.1712, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
    # lighter than anything plausible
    (MQX, {}, 1.5, (0.0, 0.0, -6.0),
     [(0.15, 0.3404, 0.0, 0.0), (0.7552, 0.3404, 0.0, 0.0), (0.0948, 0.48, 0.0, 0.0),
      (0.45, 0.5856, 0.0, 0.0), (0.4, 0.4464, 0.0, 0.0)]),
    # hardly any spare thrust
    (WEAK, {}, 1.5, CALM,
     [(0.15, 0.9355, 0.0, 0.0), (1.3, 0.9355, 0.0, 0.0), (0.4, 0.8928, 0.0, 0.0)]),
]  # fmt: skip
"""Vehicle, its state where it is not at hover, height [m], disturbance [m/s²]; and the segments before zero thrust:
duration [s], thrust as a share of the weight [-], body rates of roll and pitch [rad/s]."""


@pytest.mark.parametrize(("vehicle", "state", "height_m", "disturbance", "profile"), PROFILES)
def test_the_profile_is_to_fall_to_sink_to_brake_and_to_settle_in_these_numbers(
    vehicle: Vehicle,
    state: dict[str, Vec3],
    height_m: float,
    disturbance: Vec3,
    profile: list[tuple[float, float, float, float]],
) -> None:
    weight_n, attitude = 9.81 * vehicle.mass_kg, so3.from_euler_zyx(*state.get("euler", CALM))
    motion = Motion(CALM, state.get("velocity", CALM), attitude, weight_n, state.get("rates", CALM))
    *found, off = parts(motion, vehicle, height_m, disturbance)
    rows = [(s.duration_s, s.thrust_n / weight_n, *s.rates_rad_s[:2]) for s in found if s.duration_s > 1e-3]
    assert rows == [pytest.approx(row, abs=1e-4) for row in profile]
    assert (off.duration_s, off.thrust_n, off.rates_rad_s) == (0.15, 0.0, CALM)


@pytest.mark.parametrize("vehicle", VEHICLES, ids=["mqx", "big", "ideal"])
@pytest.mark.parametrize("roll_deg", [-50.0, 20.0])
@pytest.mark.parametrize("pitch_deg", [0.0, 35.0])
def test_it_levels_through_the_lag_whatever_the_tilt_and_the_rates(
    vehicle: Vehicle, roll_deg: float, pitch_deg: float
) -> None:
    attitude = so3.from_euler_zyx(math.radians(roll_deg), math.radians(pitch_deg), 0.7)
    motion = Motion((0.0, 0.0, 0.0), CALM, attitude, 9.81 * vehicle.mass_kg, (1.0, -0.7, 0.5))
    _, end = played(motion, vehicle, parts(motion, vehicle, 2.0), 10.0)
    assert tilt_deg(end) < 3.0


@pytest.mark.parametrize("vehicle", [MQX, BIG], ids=["mqx", "big"])
@pytest.mark.parametrize("height_m", [0.1, 0.3, 0.7, 1.2, 1.6, 2.0])
@pytest.mark.parametrize("speed_m_s", [-0.5, 0.0, 0.4])
def test_where_the_model_is_right_the_floor_is_met_gently(vehicle: Vehicle, height_m: float, speed_m_s: float) -> None:
    motion = Motion((0.0, 0.0, 0.0), (0.0, 0.0, speed_m_s), so3.IDENTITY, 9.81 * vehicle.mass_kg, CALM)
    met, _ = played(motion, vehicle, parts(motion, vehicle, height_m), height_m)
    assert met.position[2] >= height_m, "it came to the floor"
    assert 0.0 < met.velocity[2] < 1.6


def test_on_the_floor_only_the_motors_stop() -> None:
    motion = Motion((0.0, 0.0, 0.0), CALM, so3.IDENTITY, 0.5, CALM)
    assert parts(motion, MQX, 0.0) == OFF
    assert parts(motion, MQX, -5.0) == OFF


@pytest.mark.parametrize("vehicle", [MQX, BIG], ids=["mqx", "big"])
def test_who_sinks_already_by_what_its_rotors_do_is_let_fall_for_a_shorter_time(vehicle: Vehicle) -> None:
    def falls_s(share: float) -> float:
        motion = Motion((0.0, 0.0, 0.0), CALM, so3.IDENTITY, share * 9.81 * vehicle.mass_kg, CALM)
        found = parts(motion, vehicle, 2.0)
        assert found[0].thrust_n < 9.81 * vehicle.mass_kg
        return sum(part.duration_s for part in found if part.thrust_n == found[0].thrust_n)

    assert falls_s(0.5) < falls_s(1.0) < falls_s(1.2)
