"""Many flights at once agree with whole flights one at a time, so that two simulators cannot drift apart."""

import math

import numpy as np
import pytest

from groundstation.core.geometry import Vec3
from sim.batch import fly_batch
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from sim.world import Wind
from tests.flight.flights import flown

SEEDS = 2
DURATION_S = 17.0
"""Two seconds count; what differs by then does not agree again."""
DELAYS = (
    "sim.thrust_delay_s=0.03",
    "sim.rate_delay_s=0.011",
    "vehicle.thrust_delay_s=0.03",
    "vehicle.rate_delay_s=0.011",
)


@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        ("paper", ("vehicle.thrust_delay_s=0.004", "vehicle.rate_delay_s=0.01")),
        ("adverse", ()),
        ("paper", (*DELAYS, "sim.drag_body_per_s=[0.3,0.2,0.1]", "sim.inflow_drag_per_m=[0.1,0.1]")),
        ("rotors_mqx_radio", (*DELAYS, "sim.thrust_gain=0.9", "vehicle.rate_lag_s=0.07", "vehicle.rate_delay_s=0.066")),
    ],
)
def test_a_batch_agrees_with_whole_flights_to_a_micrometre(
    scenario: str, overrides: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = scenario.startswith("rotors")  # a flight whose lags are told so wrongly asks its poses, which no batch does
    if asked:
        monkeypatch.setattr("groundstation.core.pilot.pilot.ASKS", math.inf)
    world, config = prepare(SCENARIOS[scenario], list(overrides))
    batch = fly_batch([world] * SEEDS, config, list(range(SEEDS)), duration_s=DURATION_S)
    assert batch.survived.all()
    for seed in range(SEEDS):
        verdict = (
            fly(world, config, seed=seed, duration_s=DURATION_S)
            if asked
            else flown(scenario, *overrides, seed=seed, duration_s=DURATION_S)
        ).verdict
        assert 100.0 * batch.rms_m[seed] == pytest.approx(verdict.rms_cm, abs=1e-4, rel=1e-4)
        assert batch.settle_s[seed] == pytest.approx(verdict.settle_s, abs=0.006)  # two steps of the plant


def test_a_last_frame_whose_every_step_ends_after_the_flight_adds_nothing() -> None:
    world, config = prepare(SCENARIOS["adverse"], ["sim.frame_period_s=0.011"])
    shorter, longer = (fly_batch([world], config, [0], duration_s=s) for s in (0.011, 0.0111))
    assert longer.survived.all()
    assert longer.settle_s.tobytes() == shorter.settle_s.tobytes()


def test_a_batch_feels_a_thrust_curve_as_a_whole_flight_does() -> None:
    world, config = prepare(SCENARIOS["paper"], ["sim.thrust_curve=0.4", "vehicle.thrust_curve=0.5"])
    batch = fly_batch([world], config, [3], duration_s=18.0)
    whole = fly(world, config, seed=3, duration_s=18.0)
    assert 100.0 * batch.rms_m[0] == pytest.approx(whole.verdict.rms_cm, abs=0.01)


@pytest.mark.parametrize(("jitter_ms", "most_cm"), [(1.0, 0.5), (3.0, 1.5)])
def test_stamps_that_are_off_at_a_metre_and_a_half_a_second_cost_little(jitter_ms: float, most_cm: float) -> None:
    key = f"pose_jitter_s={1e-3 * jitter_ms}"
    world, config = prepare(SCENARIOS["fast"], [f"sim.{key}"])
    batch = fly_batch([world] * 3, config, [0, 1, 2], duration_s=20.0)
    whole = fly(world, config, seed=2, duration_s=20.0).verdict.rms_cm
    assert 100.0 * batch.rms_m[2] == pytest.approx(whole, abs=1e-3)
    assert 100.0 * np.median(batch.rms_m) <= most_cm
    by_rms = {
        told: 100.0 * np.median(fly_batch([world] * 3, told_so, [0, 1, 2], duration_s=20.0).rms_m)
        for told in ("0", key.partition("=")[2])
        for _, told_so in [prepare(SCENARIOS["fast"], [f"sim.{key}", f"controller.pose_jitter_s={told}"])]
    }
    exact, told = by_rms.values()
    assert told < exact


def test_a_vehicle_of_a_kilogram_holds_its_place_in_three_quarters_of_its_weight_of_wind() -> None:
    blown = "sim.wind_mean=[7.5, 0, 0]"
    held, lost = (
        flown("quad1kg", blown, *told, duration_s=20.0).verdict.rms_cm for told in ((), ("controller.b_bound=5.001",))
    )
    assert held is not None and held <= 0.30
    assert lost is None or lost > 10.0


LAG_2X = f"sim.thrust_lag_s={2.0 * SCENARIOS['paper'].world.thrust_lag_s}"
TWO_LOOKS = 0.006
"""As a share of the commands of 8 s: rounding may move what is clamped, or lasts, by a command."""


@pytest.mark.parametrize(
    ("scenario", "overrides", "violated", "suspended"),
    [
        ("adverse", (), 0.0, 0.0),  # the seeds' first moments alone
        ("paper", (LAG_2X,), 0.0, 0.5),  # commands swing from limit to limit
        ("paper", ("controller.b_bound=0.5", "sim.wind_mean=[0.9, 0, 0]"), 0.5, 0.0),  # |b̂| above B
        ("paper", ("sim.thrust_gain=0.7",), 0.0, 0.1),  # thrust at its limit
    ],
)
def test_the_certificate_of_a_batch_is_the_one_watched_in_flight(
    scenario: str, overrides: tuple[str, ...], violated: float, suspended: float
) -> None:
    world, config = prepare(SCENARIOS[scenario], list(overrides))
    seeds = [0, 1]
    batch = fly_batch([world] * len(seeds), config, seeds, duration_s=8.0)
    for seed in seeds:
        verdict = fly(world, config, seed=seed, duration_s=8.0).verdict
        assert verdict.certificate_violated >= violated
        assert verdict.certificate_suspended >= suspended
        assert batch.certificate_violated[seed] == pytest.approx(verdict.certificate_violated, abs=TWO_LOOKS)
        assert batch.certificate_suspended[seed] == pytest.approx(verdict.certificate_suspended, abs=TWO_LOOKS)


def test_vehicles_of_a_batch_do_not_touch_each_other() -> None:
    world, config = prepare(SCENARIOS["adverse"], [])
    heavy, _ = prepare(SCENARIOS["adverse"], ["sim.mass_kg=0.4"])
    together = fly_batch([world, heavy, world], config, [7, 8, 9], duration_s=18.0)
    alone = fly_batch([world], config, [9], duration_s=18.0)
    assert together.survived.tolist() == [True, False, True]
    assert np.isnan(together.rms_m[1])
    assert together.rms_m[2] == alone.rms_m[0]


def test_worlds_that_cannot_share_a_batch_are_refused() -> None:
    world, config = prepare(SCENARIOS["paper"], [])
    other, _ = prepare(SCENARIOS["paper"], ["sim.pose_rate_hz=100"])
    with pytest.raises(ValueError, match="pose_rate_hz"):
        fly_batch([world, other], config, [0, 1])


def test_nobody_asks_for_the_wind_ahead_of_the_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    # The turbulence never goes back: whoever asks too early changes the wind that the vehicle then feels.
    asked: list[float] = []
    answer = Wind.at

    def at(self: Wind, flight_time: float) -> Vec3:
        asked.append(flight_time)
        return answer(self, flight_time)

    monkeypatch.setattr(Wind, "at", at)
    world, config = prepare(SCENARIOS["adverse"], [])
    fly(world, config, seed=0, duration_s=1.0)
    assert len(asked) > 400
    assert all(later >= earlier - 1e-9 for earlier, later in zip(asked, asked[1:], strict=False))


def test_a_latency_that_is_not_the_one_told_stamps_poses_wrongly_as_in_whole_flights() -> None:
    world, config = prepare(SCENARIOS["paper"], ["sim.pose_latency_s=0.035"])
    late, told = fly_batch([world, SCENARIOS["paper"].world], config, [0, 0], duration_s=16.0).rms_m
    verdict = flown("paper", "sim.pose_latency_s=0.035", duration_s=16.0).verdict
    assert 100.0 * late == pytest.approx(verdict.rms_cm, abs=1e-4)
    assert late > told + 0.001


def test_where_poses_stay_away_too_long_the_flight_ends() -> None:
    overrides = ["sim.outage_s=0.5", "sim.outage_period_s=3"]
    world, config = prepare(SCENARIOS["paper"], overrides)
    batch = fly_batch([world], config, [0], duration_s=5.0)
    assert not batch.survived[0]
    whole = flown("paper", *overrides, duration_s=5.0)
    assert not whole.completed
    assert "no pose for" in whole.why
