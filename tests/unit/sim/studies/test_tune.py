"""Tuning without flying: gains and their bounds, worlds, and a search that is given verdicts."""

import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from groundstation.config import ConfigError
from groundstation.core.control import DecreaseProof, Gains, bound_decrease
from sim.scenarios import SCENARIOS
from sim.studies.tune import (
    AXES,
    DELAY,
    Floors,
    Search,
    SortieOutcome,
    TuningTrial,
    failure,
    find_best,
    limit_cm,
    make_station,
    run,
    space,
    stage_scenarios,
)
from sim.studies.tune.tune import CRASH_CM, GAIN_DOWN, GAIN_UP, Sortie, try_gains, verify
from tests.flight.flights import UnflownFlyers

# ---- which gains


@pytest.mark.parametrize("text", [
    "k9", "gravity", "observer", "vehicle.mass_kg", "projection_order", "k2=3:1", "k2=0:1",
    "k2=a:b", "k2=1", "k2=1:nan", "k2=1:inf", "attitude_gain=0.5:2",
])  # fmt: skip
def test_what_is_no_gain_or_no_range_that_the_config_takes_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="--keys"):
        space(Gains(), [text])


# ---- in which world


def test_a_vehicle_of_ones_own_meets_the_air_of_the_scenario(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(
        "[vehicle]\nmass_kg = 0.5\nthrust_max_n = 10.0\nthrust_lag_s = 0.05\nrate_lag_s = 0.04\n"
        "command_delay_s = 0.01\nframe_period_s = 0.0125\nhover_thrust = 0.4\nthrust_curve = 0.3\n"
        "[link]\nperiod_s = 0.0125\n[pose]\nrate_hz = 120\nlatency_s = 0.012\n[controller]\nk2 = "
        "3.0\n"
    )
    asked = ["controller.k3=5.0", "sim.wind_turbulence=0.3", "trajectory.scale_m=0.5"]
    (stage,) = stage_scenarios(["adverse"], path, asked)
    world, config, adverse = stage.world, stage.config, SCENARIOS["adverse"].world
    of_file = {
        "mass_kg": 0.5, "thrust_curve": 0.3, "thrust_lag_s": 0.05, "rate_lag_s": 0.04,
        "pose_rate_hz": 120.0, "pose_latency_s": 0.012, "frame_period_s": 0.0125,
        "command_delay_s": 0.01,
    }  # fmt: skip
    air = {"thrust_gain": 0.85, "wind_turbulence": 0.3, "wind_gust": adverse.wind_gust}
    assert {key: getattr(world, key) for key in of_file | air} == of_file | air
    full_n = pytest.approx(0.5 * 9.81 / (0.3 * 0.4**2 + 0.7 * 0.4))
    assert world.thrust_max_n == config.full_thrust_n == full_n
    for made in (config, make_station(path, asked, stage)):
        told = msgspec.to_builtins(made)
        gains, pose = told["controller"], told["pose"]
        assert (gains["k2"], gains["k3"], told["trajectory"]["scale_m"]) == (3.0, 5.0, 0.5)
        assert (pose["kind"], pose["latency_s"]) == ("vicon", 0.012)
        assert (told["vehicle"]["mass_kg"], told["link"]["period_s"]) == (0.5, 0.0125)


# ---- margins


def test_a_flight_fails_by_a_crash_or_by_five_times_the_error_but_never_below_10_cm() -> None:
    def ends(*rms_cm: float | None) -> list[SortieOutcome]:
        return [SortieOutcome(one, "crashed: hit the floor") for one in rms_cm]

    assert limit_cm(ends(0.1, 0.2, 9.0)) == 10.0
    assert limit_cm(ends(4.0)) == 20.0
    assert limit_cm(ends(4.0, None)) is None
    assert failure(ends(10.0), 10.0) is None
    assert failure(ends(1.0, 10.1), 10.0) == "RMS 10.1 cm"
    assert failure(ends(None), 10.0) == "crashed: hit the floor"


def test_each_axis_changes_one_thing_of_the_truth_and_nothing_that_is_told() -> None:
    (stage,) = stage_scenarios(["paper"], None, [])
    for axis in AXES:
        wrong = axis.wrong(stage, axis.value(0.1))
        before, after = map(msgspec.structs.asdict, (stage.world, wrong.world))
        assert {key for key in before if after[key] != before[key]} == {axis.field}
        assert wrong.config == stage.config
        assert axis.wrong(stage, axis.value(0.0)) == stage
    assert DELAY.wrong(stage, 0.03).world.command_delay_s == 0.03
    assert GAIN_DOWN.value(0.1) < 1.0 < GAIN_UP.value(0.1)


# ---- the search


class Judges(UnflownFlyers):
    """Judges flights unflown: errors grow with the distance of k2 from 3 and k3 from 9."""

    def judge(self, sortie: Sortie) -> SortieOutcome:
        gains = sortie.stage.config.controller
        assert isinstance(gains, Gains)
        if gains.k2 > 3.5 and sortie.stage.world.command_delay_s:
            return SortieOutcome(50.0, "flown to the end")
        if gains.k3 > 14.0:
            return SortieOutcome(None, "crashed: hit the floor")
        error_cm = 1.0 + math.log(gains.k2 / 3.0) ** 2 + math.log(gains.k3 / 9.0) ** 2
        return SortieOutcome(error_cm, "flown to the end")


def _search(*overrides: str, keys: Sequence[str] = ("k2", "k3"), sampler_seed: int = 0) -> Search:
    stages = stage_scenarios(["paper"], None, overrides)
    return Search(
        stages=stages,
        keys=space(stages[0].config.controller, keys),
        seeds=2,
        duration_s=20.0,
        floors=Floors(delay_s=0.02, gain=0.25),
        sampler_seed=sampler_seed,
    )


BAD = ("controller.k2=0.5", "controller.k3=1.2", "controller.kappa=0.2")


def test_a_search_gets_from_bad_gains_to_good_ones_and_again_the_same() -> None:
    heard: list[TuningTrial] = []
    trials = run(_search(*BAD), Judges(), trials=40, on_trial=heard.append)
    assert heard == trials
    assert [trial.number for trial in trials] == list(range(40))
    assert trials[0].gains == {"k2": 0.5, "k3": 1.2}
    best = find_best(trials)
    assert best is not None and find_best(trials[:1]) is None
    assert trials[0].cost > 3.0
    assert best.cost == min(trial.cost for trial in trials) < 1.1
    assert best.gains["k2"] == pytest.approx(3.0, rel=0.3)
    assert run(_search(*BAD), Judges(), trials=12) == trials[:12]
    assert run(_search(*BAD, sampler_seed=1), Judges(), trials=5)[1:] != trials[1:5]


def test_what_breaks_a_constraint_never_wins_however_small_its_error() -> None:
    fragile = try_gains(_search(), {"k2": 3.6, "k3": 9.0}, Judges(), 1)
    assert fragile.broken == ["extra command delay 22 ms: RMS 50.0 cm"]
    crashed = try_gains(_search(), {"k2": 3.0, "k3": 15.0}, Judges(), 1)
    assert crashed.broken == ["paper: crashed: hit the floor"]
    poor = try_gains(_search(), {"k2": 1.0, "k3": 2.0}, Judges(), 1)
    assert not poor.broken
    assert fragile.rms_cm < poor.rms_cm < CRASH_CM <= min(fragile.cost, crashed.cost)
    assert not fragile.beats(poor)
    assert poor.beats(fragile)


def test_gains_without_the_proof_are_never_flown() -> None:
    judges = Judges()
    trials = run(_search(keys=["k2", "k3", "kb=0.2:8", "kappa=1:40"]), judges, trials=25)
    for sortie in judges.flights:
        assert isinstance(sortie.stage.config.controller, Gains)
        assert bound_decrease(sortie.stage.config.controller).proof is DecreaseProof.COMPOSITE
    # So the bounds do not keep it by themselves.
    assert max(trial.gains["kb"] for trial in trials) > 1.0


def test_what_a_search_found_is_judged_once_more_by_the_floors_on_seeds_of_its_own() -> None:
    search, judges = _search(), Judges()
    far, near, fragile = (
        try_gains(search, {"k2": k2, "k3": 9.0}, Judges(), number)
        for number, k2 in enumerate((1.0, 2.9, 3.6))
    )
    evidence = verify(search, far, near, judges, 3)
    assert evidence.complaints == []
    flown = {(sortie.seed, sortie.duration_s) for sortie in judges.flights}
    assert flown == {(seed, 60.0) for seed in range(3)}
    worlds = [sortie.stage.world for sortie in judges.flights]
    wrong = {(one.command_delay_s, one.thrust_gain) for one in worlds}
    assert wrong == {(0, 1), (0.02, 1), (0, 0.75), (0, 1.25)}
    assert (evidence.after.figures[0].rms_cm, evidence.after.figures[0].crashed) == (near.rms_cm, 0)
    (worse,) = verify(search, near, far, Judges(), 3).complaints
    assert worse.startswith("the mean error is 2.21 cm, and was 1")
    broken = verify(search, far, fragile, Judges(), 3).complaints
    assert "extra command delay 20 ms: RMS 50.0 cm" in broken


class Interrupted(Judges):
    def judge(self, sortie: Sortie) -> SortieOutcome:
        if len(self.flights) > 50:
            raise KeyboardInterrupt
        return super().judge(sortie)


def test_an_interrupted_search_goes_on_as_if_it_had_not_been(tmp_path: Path) -> None:
    whole = run(_search(*BAD), Judges(), trials=14)
    journal = tmp_path / "x.toml.trials"
    with pytest.raises(KeyboardInterrupt):
        run(_search(*BAD), Interrupted(), trials=14, journal=journal)
    heard: list[TuningTrial] = []
    judges = Judges()
    resumed = run(_search(*BAD), judges, trials=14, journal=journal, on_trial=heard.append)
    assert resumed == heard == whole
    assert 0 < len(judges.flights) < 14 * 8
    again = Judges()
    assert run(_search(*BAD), again, trials=14, journal=journal) == whole
    assert again.flights == []
