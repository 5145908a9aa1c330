"""What the law will want in a moment: rates are commanded ahead by their derivative, and the heading as it is told."""

import math

import pytest

from groundstation.core.control import Adaptive, Gains, yaw_rate
from groundstation.core.control.adaptive import move_back
from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.geometry import FLOATS, Vec3, rotate, so3, third_column
from groundstation.core.messages import Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Motion, Vehicle, lead

# By their numbers: a limit that the test took from the code would bear out any value.
AHEAD_S = 0.002

VEHICLE = Vehicle(drag_per_s=0.8, rate_limits_deg_s=(1e5, 1e5, 1e5))
GAINS = Gains(composite="off", sigma_bound=1.5, rho_bound=1.0)
PERIOD_S = VEHICLE.frame_period_s
NOTHING: Vec3 = (0.0, 0.0, 0.0)
WIND: Vec3 = (0.4, -0.3, 0.2)
FLIES = Motion((0.4, 0.1, -0.6), (1.3, -0.9, 0.6), so3.from_euler_zyx(0.2, 0.25, 0.4), 0.9, (0.3, -0.4, 0.2))


def course(t: float) -> Reference:
    """North it is at t⁵/60 + t³/12; east and down have other shares of the same two terms."""

    def along(fifth: float, third: float, k: int) -> float:
        """The kth derivative."""
        powers = {5: fifth / 60.0, 3: third / 12.0}
        return sum(c * math.perm(n, k) * t ** (n - k) for n, c in powers.items())

    def vector(k: int) -> Vec3:
        return along(1.0, 1.0, k), along(-1.0, 0.5, k), along(-0.5, 0.6, k)

    return Reference(vector(0), vector(1), vector(2), vector(3), 0.3 + 0.2 * t, 0.2)


def plus(a: Vec3, k: float, b: Vec3) -> Vec3:
    return (a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2])


def test_rates_lead_by_the_derivative_of_what_the_law_wants() -> None:
    controller, then = Adaptive(VEHICLE, GAINS), Adaptive(VEHICLE, GAINS)
    flies = Estimate(0.0, FLIES, WIND, NOTHING)
    for t in (1.0 - 2 * PERIOD_S, 1.0 - PERIOD_S):  # by whose jerk it knows the snap
        controller.decide(flies, course(t), PERIOD_S)
    drive, saturated, now = controller.decide(flies, course(1.0), PERIOD_S)
    assert not saturated
    x, y, z = third_column(FLIES.attitude)
    push = plus(WIND, -FLIES.thrust / VEHICLE.mass_kg, (x, y, z))
    speeds = plus(plus(push, -VEHICLE.drag_per_s, FLIES.velocity), GAINS.gravity, (0.0, 0.0, 1.0))
    later = Motion(
        plus(plus(FLIES.position, AHEAD_S, FLIES.velocity), 0.5 * AHEAD_S**2, speeds),
        plus(FLIES.velocity, AHEAD_S, speeds),
        rotate(FLIES.attitude, plus(NOTHING, AHEAD_S, FLIES.rates)),
        FLIES.thrust + AHEAD_S * now.thrust_rate,
        FLIES.rates,
    )
    then.begin(plus(now.b_hat, AHEAD_S, now.b_hat_dot))
    soon = then.decide(Estimate(0.0, later, WIND, NOTHING), course(1.0 + AHEAD_S), PERIOD_S).diagnostics
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
    rate_z = yaw_rate(FLOATS, attitude, 1.1, wanted, rate_y, 1.0, 10.0)
    turns = (math.sin(roll) * rate_y + math.cos(roll) * rate_z) / math.cos(pitch)
    assert turns == pytest.approx(wanted)
