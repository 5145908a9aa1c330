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


ON = ("actuator_compensation=true", "delay_prediction=true", "observer=model", "composite=provable")


def test_each_block_of_the_ladder_lowers_the_error_with_the_papers_gains() -> None:
    ladder = ["controller.kind=uncompensated", *(f"controller.{switch}" for switch in ON)]
    printed, actuators, prediction, observer, composite = (rms("paper", *ladder[: i + 1]) for i in range(len(ladder)))
    assert actuators < 0.1 * printed
    assert prediction < 0.5 * actuators
    assert composite < 0.5 * min(prediction, observer)
    assert rms("paper") < composite


@pytest.mark.parametrize(
    ("scenario", "switch", "factor"),
    [
        ("paper", "actuator_compensation", 10.0),
        ("paper", "delay_prediction", 4.0),
        ("paper", "observer", 1.5),
        ("fast", "composite", 4.0),
    ],
)
def test_switching_one_block_off_alone_costs_accuracy(scenario: str, switch: str, factor: float) -> None:
    assert rms(scenario, OFF[switch]) > factor * rms(scenario)


@pytest.mark.parametrize(("scenario", "factor"), [("adverse", 1.2), ("storm", 1.25), ("paper", 0.95)])
def test_telling_weak_thrust_from_wind_helps_where_thrust_is_weak_and_costs_nothing_elsewhere(
    scenario: str, factor: float
) -> None:
    without = rms(scenario, "controller.effectiveness_deviation=0", duration_s=60.0)
    assert without > factor * rms(scenario, duration_s=60.0)  # thrust weakens with time


def test_weak_thrust_does_not_eat_the_bound_on_the_wind() -> None:
    weak = ("sim.thrust_gain=0.75", "controller.b_bound=2")
    assert rms("paper", *weak, "controller.effectiveness_deviation=0") > 5.0, "a quarter of g is beyond the bound"
    assert rms("paper", *weak) < 0.15


def test_the_provable_form_of_composite_adaptation_is_no_worse_than_the_raw_one() -> None:
    for scenario in ("adverse", "storm"):
        assert rms(scenario) <= rms(scenario, "controller.composite=raw")
