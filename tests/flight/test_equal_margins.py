"""``compare --equal-margins``: who may win a search, and what is flown again of it."""

import pytest

from groundstation.core.control.controllers import Pid
from sim.runs import Flyers
from sim.studies import SEARCHED_LAWS, compare_at_equal_margins, equal_margins as module
from sim.studies.equal_margins import FLOORS, EqualTerms, SearchedLaw, make_wrong
from sim.studies.tune import Search, SortieOutcome, TuningTrial, stage_scenarios
from sim.studies.tune.tune import CRASH_CM, Sortie
from tests.flight.flights import UnflownFlyers

LAW = SearchedLaw("pid", "pid", {"p_position": 2.0, "p_velocity": 5.0})


class Judges(UnflownFlyers):
    """Flights that nobody flies: the stiffer, the closer, the more effort, the less margin."""

    def judge(self, sortie: Sortie) -> SortieOutcome:
        gains, world = sortie.stage.config.controller, sortie.stage.world
        assert isinstance(gains, Pid) and gains.actuator_compensation
        if gains.p_position > 4.0 and world.command_delay_s:
            return SortieOutcome(50.0, "flown to the end", 0.3)
        if gains.p_position > 3.5 and sortie.stage.scenario == "rotors_mqx_radio":
            return SortieOutcome(0.5, "flown to the end", 0.3, saturated=0.4)
        if gains.p_velocity > 14.0:
            return SortieOutcome(None, "crashed: hit the floor")
        return SortieOutcome(2.0 / gains.p_position, "flown to the end", 0.06 * gains.p_velocity)


def search() -> Search:
    return module._search(LAW)


def judged(position: float, velocity: float) -> TuningTrial:
    gains = {"p_position": position, "p_velocity": velocity}
    return EqualTerms()(search(), gains, Judges(), 1)


@pytest.mark.parametrize(
    ("position", "velocity", "why"),
    [
        (4.5, 5.0, "rotors_mqx_radio: RMS 0.50 cm, 40.0 % of the commands at a limit"),
        (2.0, 12.0, "paper: effort 0.72 rad/s"),
        (2.0, 15.0, "paper: crashed: hit the floor"),
    ],
)
def test_what_breaks_a_floor_never_wins_and_says_which(
    position: float, velocity: float, why: str
) -> None:
    trial = judged(position, velocity)
    assert trial.broken == [why]
    assert trial.cost >= CRASH_CM


def test_a_floor_makes_one_thing_wrong_by_what_is_told() -> None:
    paper, adverse = stage_scenarios(["paper", "adverse"], None, [])
    for floor in FLOORS:
        for stage in (paper, adverse):
            world = make_wrong(stage, floor).world
            fields = world.__struct_fields__
            changed = [one for one in fields if getattr(world, one) != getattr(stage.world, one)]
            assert changed == [floor.field]
            assert make_wrong(stage, floor).config == stage.config
    slow = next(floor for floor in FLOORS if floor.field == "rate_lag_s" and floor.value == 1.5)
    lag_s = make_wrong(adverse, slow).world.rate_lag_s
    assert lag_s == pytest.approx(1.5 * adverse.config.vehicle.rate_lag_s)


def test_the_best_of_each_law_is_flown_once_more_on_other_seeds() -> None:
    judges, done = Judges(), list[int]()
    (row,) = compare_at_equal_margins(
        judges, trials=6, seeds=2, laws=[LAW], on_done=lambda: done.append(1)
    )
    assert len(done) == 7
    assert row.keeps and row.evaluations == 6
    again = [sortie for sortie in judges.flights if sortie.seed == 1]
    reflown = {(sortie.stage.scenario, sortie.duration_s) for sortie in again}
    whole_laps = {(name, 60.0 if name in module.JUDGED else 20.0) for name in module.REFLOWN}
    assert reflown == whole_laps
    pushed = [sortie for sortie in judges.flights if sortie.stage.scenario in module.PUSHED]
    assert {sortie.stage.scenario for sortie in pushed} == set(module.PUSHED)
    # The push is flown.
    assert all(sortie.duration_s > sortie.stage.world.wind_step_time_s for sortie in pushed)
    flown = judges.flights[-1].stage.config.controller
    assert isinstance(flown, Pid) and flown.p_position == pytest.approx(row.gains["p_position"])


@pytest.mark.matrix  # twelve flights of a page of figures, which `make margins` makes
def test_ours_as_shipped_keeps_the_floors() -> None:
    shipped = next(law for law in SEARCHED_LAWS if not law.start)
    assert EqualTerms()(module._search(shipped), {}, Flyers(1), 0).broken == []
