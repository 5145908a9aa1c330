"""What a law wants next, when its command acts, and the parts of the baselines."""

import math
from typing import Any

import pytest
from hypothesis import given, strategies as st
from msgspec.structs import replace

from groundstation.core.control import (
    Adaptive,
    Gains,
    acceleration,
    compute_yaw_rate,
    make_controller,
    specific_thrust,
)
from groundstation.core.control.adaptive import Uncompensated, move_back
from groundstation.core.control.controllers import L1, Indi
from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.geometry import (
    FLOATS,
    IDENTITY,
    ZERO,
    Quat,
    Vec3,
    add_scaled,
    rotate,
    scale,
    so3,
    third_column,
)
from groundstation.core.geometry.so3 import from_euler_zyx
from groundstation.core.messages import Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Motion, Vehicle, lead

# By their numbers: a limit that the test took from the code would bear out any value.
AHEAD_S = 0.002

VEHICLE = Vehicle(drag_per_s=0.8, rate_limits_deg_s=(1e5, 1e5, 1e5))
GAINS = Gains(composite="off", sigma_bound=1.5, rho_bound=1.0)
PERIOD_S = VEHICLE.frame_period_s
WIND: Vec3 = (0.4, -0.3, 0.2)
FLIES = Motion(
    (0.4, 0.1, -0.6), (1.3, -0.9, 0.6), so3.from_euler_zyx(0.2, 0.25, 0.4), 0.9, (0.3, -0.4, 0.2)
)


def course(t: float) -> Reference:
    """North it is at t⁵/60 + t³/12; east and down have other shares of the same two terms."""

    def along(fifth: float, third: float, k: int) -> float:
        """The kth derivative."""
        powers = {5: fifth / 60.0, 3: third / 12.0}
        return sum(c * math.perm(n, k) * t ** (n - k) for n, c in powers.items())

    def vector(k: int) -> Vec3:
        return along(1.0, 1.0, k), along(-1.0, 0.5, k), along(-0.5, 0.6, k)

    return Reference(vector(0), vector(1), vector(2), vector(3), 0.3 + 0.2 * t, 0.2)


def test_rates_lead_by_the_derivative_of_what_the_law_wants() -> None:
    controller, then = Adaptive(VEHICLE, GAINS), Adaptive(VEHICLE, GAINS)
    flies = Estimate(0.0, FLIES, WIND, ZERO)
    for t in (1.0 - 2 * PERIOD_S, 1.0 - PERIOD_S):  # by whose jerk it knows the snap
        controller.decide(flies, course(t), PERIOD_S)
    drive, saturated, now = controller.decide(flies, course(1.0), PERIOD_S)
    assert not saturated
    x, y, z = third_column(FLIES.attitude)
    push = add_scaled(WIND, -FLIES.thrust / VEHICLE.mass_kg, (x, y, z))
    speeds = add_scaled(
        add_scaled(push, -VEHICLE.drag_per_s, FLIES.velocity), GAINS.gravity, (0.0, 0.0, 1.0)
    )
    later = Motion(
        add_scaled(add_scaled(FLIES.position, AHEAD_S, FLIES.velocity), 0.5 * AHEAD_S**2, speeds),
        add_scaled(FLIES.velocity, AHEAD_S, speeds),
        rotate(FLIES.attitude, add_scaled(ZERO, AHEAD_S, FLIES.rates)),
        FLIES.thrust + AHEAD_S * now.thrust_rate,
        FLIES.rates,
    )
    then.begin(add_scaled(now.b_hat, AHEAD_S, now.b_hat_dot))
    soon = then.decide(
        Estimate(0.0, later, WIND, ZERO), course(1.0 + AHEAD_S), PERIOD_S
    ).diagnostics
    gain = lead(FLOATS, PERIOD_S, VEHICLE.rate_lag_s)
    led = [
        is_ + gain * (GAINS.k_omega * (wants - is_) + (will - wants) / AHEAD_S)
        for is_, wants, will in zip(FLIES.rates, now.rates_wanted, soon.rates_wanted, strict=True)
    ]
    led[2] = DemandLimits(FLOATS, VEHICLE).limit_yaw(FLIES.rates[2], led[2])
    assert drive.rates == pytest.approx(led, abs=1e-3)


def test_a_reference_is_moved_back_along_its_derivatives() -> None:
    back, was = move_back(course(1.0), 0.02), course(0.98)
    assert back.position_ned == pytest.approx(was.position_ned, abs=1e-7)
    assert back.velocity_ned == pytest.approx(was.velocity_ned, abs=1e-5)
    assert back.acceleration_ned == pytest.approx(was.acceleration_ned, abs=1e-3)
    assert back.yaw_rad == pytest.approx(was.yaw_rad)


@pytest.mark.parametrize("roll", [-0.7, 0.0, 0.9])
@pytest.mark.parametrize("pitch", [-0.6, 0.4])
def test_a_heading_that_is_right_turns_as_fast_as_the_reference_however_the_vehicle_leans(
    roll: float, pitch: float
) -> None:
    rate_y, wanted = -0.8, 0.5
    attitude = so3.from_euler_zyx(roll, pitch, 1.1)
    rate_z = compute_yaw_rate(FLOATS, attitude, 1.1, wanted, rate_y, 1.0, 10.0)
    turns = (math.sin(roll) * rate_y + math.cos(roll) * rate_z) / math.cos(pitch)
    assert turns == pytest.approx(wanted)


HERE = Reference((0.0, 0.0, -1.0))
LATE_THRUST = Vehicle(thrust_delay_s=0.06)
HOVERS = Motion((0.0, 0.0, -1.0), ZERO, IDENTITY, 9.81 * LATE_THRUST.mass_kg, ZERO)
HANGS = Estimate(0.0, HOVERS, ZERO, ZERO)
SPINS = Estimate(
    0.0, replace(HOVERS, velocity=(0.0, 0.0, 0.02), rates=(20.0, 0.0, 0.0)), ZERO, ZERO
)


def test_each_half_of_a_command_is_of_the_instant_at_which_it_begins_to_act() -> None:
    apart, spinning, sooner, later = (Adaptive(LATE_THRUST, Gains()) for _ in range(4))
    drive, saturated, _ = apart.decide_apart(HANGS, SPINS, HERE, PERIOD_S)
    first, last = sooner.decide(HANGS, HERE, PERIOD_S), later.decide(SPINS, HERE, PERIOD_S)
    assert (drive.rates, drive.thrust) == (first.drive.rates, last.drive.thrust)
    assert first.drive.thrust != last.drive.thrust and first.drive.rates != last.drive.rates
    assert (last.saturated, saturated) == (True, False)
    assert spinning.decide_apart(SPINS, HANGS, HERE, PERIOD_S).saturated


def test_without_compensation_the_law_goes_on_from_the_thrust_that_was_sent() -> None:
    vehicle = Vehicle(rate_delay_s=0.03)  # thrust acts sooner than rates
    law = Adaptive(vehicle, Uncompensated())
    climbs = HANGS._replace(motion=replace(HANGS.motion, velocity=(0.0, 0.0, -1.0)))
    before = law.decide(HANGS, HERE, PERIOD_S).drive.thrust
    sent = law.decide_apart(climbs, HANGS, HERE, PERIOD_S).drive.thrust
    assert sent < before
    alone = Adaptive(vehicle, Uncompensated())
    alone.memory = (law.b_hat, *alone.memory[1:4], sent, False)
    assert law.decide(HANGS, HERE, PERIOD_S).drive.thrust == pytest.approx(
        alone.decide(HANGS, HERE, PERIOD_S).drive.thrust
    )


G = 9.81
PLAIN = Vehicle()

part = st.floats(-4.0, 4.0)
vec = st.tuples(part, part, part)
angle = st.floats(-1.2, 1.2)
attitude = st.builds(from_euler_zyx, angle, angle, angle)


def make_estimate(motion: dict[str, Any] | None = None, disturbance: Vec3 = ZERO) -> Estimate:
    still = Motion((0.0, 0.0, -1.0), ZERO, IDENTITY, PLAIN.mass_kg * G, ZERO)
    return Estimate(0.0, replace(still, **(motion or {})), disturbance, ZERO)


@given(attitude, vec, vec)
def test_thrust_along_the_push_gives_the_wanted_acceleration(
    q: Quat, wanted: Vec3, wind: Vec3
) -> None:
    along, cut = specific_thrust(wanted, wind, G, math.radians(80.0))
    x, y, z = along
    assert not cut
    assert (wind[0] - x, wind[1] - y, G + wind[2] - z) == pytest.approx(wanted, abs=1e-9)
    motion = Motion(ZERO, ZERO, q, 0.9, ZERO)
    u, v, w = third_column(q)
    assert acceleration(motion, wind, 0.3, G) == pytest.approx(
        (wind[0] - 3.0 * u, wind[1] - 3.0 * v, wind[2] + G - 3.0 * w)
    )


@given(st.tuples(*(st.floats(-300.0, 300.0),) * 3))
def test_a_push_is_never_tilted_beyond_its_limit_nor_upside_down(wanted: Vec3) -> None:
    (x, y, z), cut = specific_thrust(wanted, ZERO, G, math.radians(30.0))
    assert z >= 1.0
    assert math.hypot(x, y) <= z * math.tan(math.radians(30.0)) * (1.0 + 1e-12)
    if (
        math.hypot(wanted[0], wanted[1])
        > (G - min(wanted[2], G - 1.0)) * math.tan(math.radians(30.0)) * 1.001
    ):
        assert cut


def test_indi_pushes_against_the_wind_that_the_observer_sees() -> None:
    gains = Indi(k_acceleration=0.0, actuator_compensation=False)
    decision = make_controller(gains, PLAIN).decide(
        make_estimate(disturbance=(1.0, -0.5, 2.0)), HERE, 0.0
    )
    assert decision.drive.thrust == pytest.approx(PLAIN.mass_kg * math.hypot(1.0, 0.5, G + 2.0))


def test_l1_finds_an_unknown_push_and_counteracts_what_its_filter_lets_through() -> None:
    # v̂˙ = f + σ̂ + A_s ṽ over T_s, σ̂ = -Φ⁻¹ e^(A_s T_s) ṽ, then C(s); the vehicle gathers speed
    # by σ beyond the model.
    gains, h, sigma = L1(predictor_pole=2.0, bandwidth_rad_s=6.0), PLAIN.frame_period_s, 0.8
    controller = make_controller(gains, PLAIN)
    keep = math.exp(-2.0 * h)
    phi = (1.0 - keep) / 2.0
    off = filtered = 0.0
    for k in range(120):
        moving = make_estimate({"velocity": scale(k * h * sigma, (1.0, 0.5, -2.0))})
        seen = controller.decide(moving, HERE, h if k else 0.0).diagnostics.b_hat
        found = -keep / phi * off
        filtered += (1.0 - math.exp(-6.0 * h)) * (found - filtered) if k else 0.0
        assert seen == pytest.approx(scale(filtered, (1.0, 0.5, -2.0)), abs=1e-9)
        off = keep * off + phi * found - h * sigma
    # What stays of it is the known share: e^(A_s T_s) T_s / Φ.
    assert filtered == pytest.approx(keep * h / phi * sigma, rel=1e-3)
