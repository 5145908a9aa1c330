"""A command whose thrust and rates begin to act at two instants."""

from typing import Any

from groundstation.core.control import Adaptive, Gains
from groundstation.core.messages import Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Motion, Vehicle

VEHICLE = Vehicle(thrust_delay_s=0.06)
HERE = Reference((0.0, 0.0, -1.0))
PERIOD_S = VEHICLE.frame_period_s


def estimate(**motion: Any) -> Estimate:
    still = Motion((0.0, 0.0, -1.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 9.81 * VEHICLE.mass_kg, (0.0, 0.0, 0.0))
    return Estimate(0.0, still._replace(**motion), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


SPINS = estimate(rates=(20.0, 0.0, 0.0))


def test_each_half_of_the_command_is_of_its_own_instant() -> None:
    apart, sooner, later = (Adaptive(VEHICLE, Gains()) for _ in range(3))
    drive = apart.decide_apart(estimate(), SPINS, HERE, PERIOD_S).drive
    assert drive.rates == sooner.decide(estimate(), HERE, PERIOD_S).drive.rates
    assert drive.thrust == later.decide(SPINS, HERE, PERIOD_S).drive.thrust


def test_a_half_that_is_clamped_is_told_where_it_is_sent() -> None:
    assert Adaptive(VEHICLE, Gains()).decide(SPINS, HERE, PERIOD_S).saturated
    assert not Adaptive(VEHICLE, Gains()).decide_apart(estimate(), SPINS, HERE, PERIOD_S).saturated
    assert Adaptive(VEHICLE, Gains()).decide_apart(SPINS, estimate(), HERE, PERIOD_S).saturated
