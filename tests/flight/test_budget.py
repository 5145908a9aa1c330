"""Error budgets: a recorded flight flown again without each source of its error."""

import json
from pathlib import Path

import pytest

import groundstation
from groundstation.analysis.report import FlightColumns, read_columns
from groundstation.interfaces.cli import commands
from groundstation.settings import Config
from sim.scenarios import SCENARIOS, prepare
from sim.studies import Contribution, budget as module
from sim.studies.budget import SOURCES, ErrorBudget, compute_budget, error_budget
from sim.world import World
from tests.flown_once import once
from tests.recordings import recorded

DURATION_S = 17.0
STILL = ("sim.pose_noise_m=0.0", "sim.attitude_noise_rad=0.0")


def computed(
    world: World, config: Config, *, seed: int, duration_s: float, simulated: bool = True
) -> ErrorBudget:
    """One budget, however many tests ask for it."""
    sources = [source.name for source in module.SOURCES]
    key = ("budget", sources, world, config, seed, duration_s, simulated)

    def make(_: Path) -> ErrorBudget:
        return compute_budget(world, config, seed=seed, duration_s=duration_s, simulated=simulated)

    return once(key, make)


@pytest.fixture(autouse=True)
def _computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "compute_budget", computed)


def flown(*overrides: str) -> ErrorBudget:
    world, config = prepare(SCENARIOS["paper"], list(overrides))
    return computed(world, config, seed=0, duration_s=DURATION_S)


def by_source(budget: ErrorBudget) -> dict[str, Contribution]:
    return {one.source: one for one in budget.contributions}


def test_the_model_flies_the_recorded_flight_again() -> None:
    path, result, _ = recorded(duration_s=DURATION_S)
    budget = error_budget(path)
    assert budget.rms_cm == pytest.approx(result.verdict.rms_cm, abs=1e-3)
    assert budget.of.startswith("This flight, flown again")
    assert set(by_source(budget)) == {"noise", "latency", "saturation"}  # it has no other source
    assert groundstation.error_budget is error_budget


@pytest.mark.matrix  # of the tool; the other tests of it add up budgets
@pytest.mark.parametrize(
    ("source", "overrides"),
    [
        ("noise", ()),
        ("gusts", (*STILL, "sim.wind_turbulence=0.3")),
        ("drag", (*STILL, "sim.drag_per_s=1.5")),
        ("lag mismatch", (*STILL, "sim.rate_lag_s=0.2", "sim.thrust_lag_s=0.15")),
        ("wrong thrust", (*STILL, "sim.thrust_sag=0.8")),
    ],
)
def test_without_the_only_disturbance_of_a_flight_its_error_vanishes(
    source: str, overrides: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    disturbances = tuple(one for one in SOURCES if one.name not in ("latency", "saturation"))
    monkeypatch.setattr(module, "SOURCES", disturbances)
    budget, undisturbed = flown(*overrides), flown(*STILL).rms_cm
    one = by_source(budget)[source]
    assert budget.rms_cm is not None and undisturbed is not None
    assert budget.rms_cm > 2.0 * undisturbed
    assert one.rms_cm == pytest.approx(undisturbed, rel=1e-3)
    assert one.squared_cm2 == pytest.approx(budget.rms_cm**2 - undisturbed**2, rel=1e-3)
    assert set(by_source(budget)) == {source}


def test_what_has_no_budget_says_why() -> None:
    def said(flight: FlightColumns) -> str:
        budget = error_budget(flight)
        assert budget.contributions == () and budget.rms_cm is None
        return budget.of

    short = read_columns(recorded()[0])
    assert "less than 16 s on the trajectory" in said(short)
    flight = read_columns(recorded(duration_s=DURATION_S)[0])
    told = flight.recording.about["config"]
    evil = 'factory = "evil:make"\nkind = "custom"'
    flight.recording.about["config"] = told.replace('kind = "adaptive"', evil)
    whys = ("can't be flown here", "no code that a recording names is run")
    assert any(why in said(flight) for why in whys)
    flight.recording.about["config"] = ""
    assert "holds no configuration" in said(flight)


def test_the_command_computes_it(capsys: pytest.CaptureFixture[str]) -> None:
    from groundstation.__main__ import parser

    path = recorded(duration_s=DURATION_S)[0]
    assert commands.report(parser().parse_args(["report", "--json", str(path)])) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    budget = flight["budget"]
    assert budget["rms_cm"] > 0.0 and budget["contributions"]
