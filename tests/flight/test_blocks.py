"""What each block around the law buys: switched on one after the other, on the paper's vehicle."""

import pytest

from tests.flight.flights import flown

OFF = {
    "actuator_compensation": "controller.actuator_compensation=false",
    "delay_prediction": "controller.delay_prediction=false",
    "observer": "controller.observer=backward_euler",
    "composite": "controller.composite=off",
}


def rms(scenario: str, *overrides: str, duration_s: float = 20.0) -> float:
    """RMS error [cm] over the steady part; a flight that crashed counts as a metre."""
    value = flown(scenario, *overrides, duration_s=duration_s).verdict.rms_cm
    return 100.0 if value is None else value


@pytest.mark.tried(1)  # test_scenarios.py holds what is flown to its figures
@pytest.mark.parametrize(
    ("scenario", "switch", "factor"),
    [
        ("paper", "actuator_compensation", 10.0),
        ("paper", "delay_prediction", 4.0),
        ("paper", "observer", 1.5),
        ("fast", "composite", 4.0),
    ],
)
def test_switching_one_block_off_alone_costs_accuracy(
    scenario: str, switch: str, factor: float
) -> None:
    assert rms(scenario, OFF[switch]) > factor * rms(scenario)


def test_weak_thrust_does_not_eat_the_bound_on_the_wind() -> None:
    weak = ("sim.thrust_gain=0.75", "controller.b_bound=2")
    # A quarter of g is beyond the bound.
    assert rms("paper", *weak, "controller.effectiveness_deviation=0") > 5.0
    assert rms("paper", *weak) < 0.15
