"""Campaigns: drawn from the seed alone, resumed, and flown again one by one."""

import json
import math
import shlex
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, strategies as st

from groundstation.config import ConfigError
from groundstation.core.control import Gains
from groundstation.core.messages import STEADY_S, Tick
from sim.__main__ import main
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from sim.studies.campaign import USUAL, Campaign, CampaignRow, Local, report, run, text
from sim.studies.campaign.campaign import Folder, command, draw_world, fields, overrides
from tests.e2e.stations import run_here
from tests.flight.flights import campaign_of, ticks_to

DURATION_S = 16.5
SEEDS = range(3, 7)


def _campaign(*told: str, **settings: Any) -> Campaign:
    world, config = prepare(SCENARIOS["adverse"], list(told))
    settings = {"duration_s": DURATION_S} | settings
    return Campaign(
        scenario="adverse", world=world, config=config, overrides=list(told), **settings
    )


@pytest.fixture(scope="module")
def rows() -> list[CampaignRow]:
    return run(_campaign(), SEEDS, Local(1))[0]


def test_an_interrupted_campaign_flies_only_what_is_missing_and_processes_change_no_figure(
    rows: list[CampaignRow], tmp_path: Path
) -> None:
    Folder(tmp_path, _campaign().settings()).add(rows[:3])
    table = tmp_path / "flights.csv"
    table.write_bytes(table.read_bytes()[:-20])  # the power went while the third row was written
    heard: list[int] = []
    resumed, flown = run(
        _campaign(), SEEDS, Local(2), out=tmp_path, batch=1, on_progress=heard.append
    )
    assert (flown, heard) == (2, [2, 3, 4])
    assert resumed == rows
    assert run(_campaign(), SEEDS, Local(1), out=tmp_path, batch=1) == (rows, 0)
    assert len(table.read_text().splitlines()) == 1 + len(rows)


@pytest.mark.parametrize(
    ("other", "key"),
    [
        (_campaign(duration_s=17.0), "duration_s = 16.5, now it is 17.0"),
        (_campaign("controller.kb=0.01"), "told.controller.kb"),
        (_campaign("sim.wind_turbulence=0.3"), "sim.wind_turbulence = 0.2"),
        (_campaign(draws=("mass", "wind")), "drawn.gain = thrust_gain 0.8 to 1.1"),
    ],
)
def test_flights_of_other_settings_are_not_mixed(other: Campaign, key: str, tmp_path: Path) -> None:
    Folder(tmp_path, _campaign().settings())
    with pytest.raises(ConfigError, match=key):
        run(other, SEEDS, Local(1), out=tmp_path)


def test_the_command_of_each_flight_flies_it_again(rows: list[CampaignRow]) -> None:
    row = rows[0]
    _, *words = shlex.split(command(_campaign(), row.seed))
    verdict = json.loads(run_here(main, *words, "--json").stdout)
    assert verdict["rms_cm"] == pytest.approx(row.rms_cm, abs=1e-3)
    assert verdict["max_cm"] == pytest.approx(row.max_cm, abs=1e-3)


@given(seed=st.integers(0, 2**31), scenario=st.sampled_from(sorted(SCENARIOS)))
def test_draws_stay_within_their_bounds_and_change_nothing_else(seed: int, scenario: str) -> None:
    truth = SCENARIOS[scenario].world
    world = draw_world(truth, seed)
    assert 0.9 <= world.mass_kg / truth.mass_kg <= 1.1
    assert 0.8 * truth.thrust_lag_s <= world.thrust_lag_s <= 1.2 * truth.thrust_lag_s
    assert 0.8 * truth.rate_lag_s <= world.rate_lag_s <= 1.2 * truth.rate_lag_s
    assert 0.8 <= world.thrust_gain <= 1.1
    assert math.hypot(*world.wind_mean) == pytest.approx(math.hypot(*truth.wind_mean))
    assert math.hypot(*world.wind_gust) == pytest.approx(math.hypot(*truth.wind_gust))
    drawn = {name: getattr(truth, name) for name in fields(USUAL)}
    assert msgspec.structs.replace(world, **drawn) == truth


def test_a_crash_is_worse_than_any_error(rows: list[CampaignRow]) -> None:
    def row(seed: int, rms_cm: float | None) -> CampaignRow:
        figures = {"rms_cm": rms_cm, "max_cm": rms_cm, "survived": rms_cm is not None}
        return msgspec.structs.replace(rows[0], seed=seed, **figures)

    many = [row(i, 0.1 * i) for i in range(99)] + [row(99, None)]
    facts = report(_campaign(), many, flown=100, wall_s=2.0, workers=2)
    assert facts["survived"] == 0.99
    assert facts["rms_cm"]["p50"] == 4.9
    assert facts["rms_cm"]["p90"] == pytest.approx(8.9)
    assert facts["rms_cm"]["p99"] == pytest.approx(9.8)
    assert facts["rms_cm"]["max"] is None
    assert [w["seed"] for w in facts["worst"]] == [99, 98, 97, 96, 95]
    assert "RMS error, worst        crashed" in text(facts)


@pytest.mark.matrix  # the other tests of a campaign fly a few
def test_forty_adverse_flights_stay_as_close_as_a_thousand() -> None:
    # The first of the thousand that `make soak` flies, and a third as long.
    facts = campaign_of(40, duration_s=20.0, workers=1)
    assert facts["survived"] == 1.0
    assert facts["rms_cm"]["p50"] <= 1.05
    assert facts["rms_cm"]["max"] <= 1.9


def test_the_certificate_of_each_flight_stands_in_its_row(rows: list[CampaignRow]) -> None:
    row = rows[0]
    drawn = overrides(draw_world(SCENARIOS["adverse"].world, row.seed))
    world, config = prepare(SCENARIOS["adverse"], drawn)
    gains = config.controller
    assert isinstance(gains, Gains)
    largest, margin = 0.0, math.inf

    def watch(tick: Tick) -> None:
        nonlocal largest, margin
        largest = max(largest, math.hypot(*tick.decision.diagnostics.b_hat))
        if tick.flight_time_s >= STEADY_S:
            thrust = tick.decision.drive.thrust
            margin = min(
                margin, thrust - config.vehicle.thrust_min_n, config.vehicle.thrust_max_n - thrust
            )

    flown = fly(world, config, seed=row.seed, duration_s=DURATION_S, watch=ticks_to(watch))
    verdict = flown.verdict
    assert row.lyapunov_start == pytest.approx(verdict.lyapunov_start, rel=1e-3)
    assert row.lyapunov_floor == pytest.approx(verdict.lyapunov_floor, rel=1e-3)
    assert row.b_hat_share_max == pytest.approx(largest / (gains.b_bound + gains.epsilon), rel=1e-3)
    assert row.thrust_margin_n == pytest.approx(margin, rel=1e-2)


AT_ONCE = "the commands of a batch act at once"
RIGHT = "the cameras of a batch make no such mistake"
NOT_BATCHED = {
    **dict.fromkeys(("vehicle.command_delay_s", "sim.command_delay_s"), AT_ONCE),
    "sim.thrust_delay_s": AT_ONCE,
    **dict.fromkeys(("sim.occlusion_s", "sim.swap_s", "sim.tracker_yaw_deg"), RIGHT),
    **dict.fromkeys(("sim.estimate_wander_m", "sim.estimate_yaw_step_deg"), RIGHT),
}


@pytest.mark.parametrize(("words", "complaint"), [
    ("--duration 16", "--duration: expected seconds, more than 16 and"),
    ("--set sim.thrust_gain=0.9", "sim.thrust_gain: a campaign draws it"),
    ("--draw losses --set sim.outage_s=0.1", "sim.outage_s: a campaign draws it, from 0 to 0.15"),
    ("--draw mass,luck", "--draw: expected some of ['mass', 'lags'"),
    ("--set controller.kind=uncompensated", "controller: a batch flies with the model's observer"),
    ("rotors_mqx", "sim.plant: a batch flies no rotors"),
    *((f"--set {key}=0.01", f"{key}: {why}") for key, why in NOT_BATCHED.items()),
])  # fmt: skip
def test_a_campaign_that_would_not_be_true_is_refused(words: str, complaint: str) -> None:
    done = run_here(main, "campaign", *words.split())
    assert done.returncode == 2
    assert complaint in done.stderr


def test_the_command_prints_one_object_and_says_that_a_kernel_has_no_effect(
    rows: list[CampaignRow], tmp_path: Path
) -> None:
    Folder(tmp_path, _campaign().settings()).add(rows)
    words = (
        f"campaign --first-seed 3 --flights 4 --duration 16.5 --out {tmp_path} --json --kernel c"
    )
    done = run_here(main, *words.split())
    assert done.returncode == 0
    assert "--kernel has no effect" in done.stderr
    facts = json.loads(done.stdout)
    assert (facts["flights"], facts["flown_now"], facts["survived"]) == (4, 0, 1.0)
    assert facts["rms_cm"]["max"] == max(row.rms_cm or 0.0 for row in rows)
