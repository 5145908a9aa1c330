"""Whole flights in virtual time, flown once in a run of tests however many of them look at it."""

from functools import cache
from statistics import median
from typing import Any

from groundstation.config import ConfigError
from sim.runs import fly
from sim.runs.flight import Result
from sim.scenarios import SCENARIOS, prepare
from sim.studies.campaign import Campaign, Local, report, run
from tests.flown_once import once

__all__ = ["ConfigError", "campaign_of", "flown", "median_of", "middle"]


@cache
def flown(scenario: str, *overrides: str, seed: int = 0, duration_s: float = 60.0, source: str = "vicon") -> Result:
    """One flight of ``scenario`` with ``--set`` overrides."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source)
    key = ("flown", world, config, seed, duration_s)
    return once(key, lambda _: fly(world, config, seed=seed, duration_s=duration_s))


def campaign_of(flights: int, *, duration_s: float, workers: int) -> dict[str, Any]:
    """The figures of the `adverse` campaign's first flights, as its report has them."""
    world, config = prepare(SCENARIOS["adverse"], [])
    campaign = Campaign(scenario="adverse", world=world, config=config, duration_s=duration_s, overrides=[])
    rows, flown = run(campaign, range(flights), Local(workers))
    return report(campaign, rows, flown=flown, wall_s=1.0, workers=workers)


def median_of(values: list[float | None]) -> float:
    """Their median; one flight that has no such figure fails the test."""
    assert None not in values
    return median(v for v in values if v is not None)


def middle(scenario: str, field: str, *overrides: str, seeds: int = 10, duration_s: float = 60.0) -> float:
    """The median of one figure of the verdict over seeds 0 .. ``seeds`` - 1; every flight must be completed."""
    results = [flown(scenario, *overrides, seed=seed, duration_s=duration_s) for seed in range(seeds)]
    assert all(r.completed for r in results), [r.why for r in results]
    return median_of([getattr(r.verdict, field) for r in results])
