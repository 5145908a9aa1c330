"""The flying path: law, observer and predictor for one command, and all that it needs, in whole virtual flights."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from statistics import median
from time import perf_counter_ns
from typing import Any

import numpy as np

from groundstation.core.control import Adaptive
from groundstation.core.estimation import ModelEstimator
from groundstation.core.pilot import Pilot
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare

FLOWN = ("paper", "adverse", "quad1kg")
TICKS = 20_000
"""Commands in each flight."""
LIMIT_US = 60.0
"""Goal for the median [µs]."""

Parts = Sequence[tuple[type, str]]
"""Classes, and the methods of theirs that are timed."""
CORE: Parts = ((ModelEstimator, "update"), (ModelEstimator, "predict"), (Adaptive, "decide"))
"""Law, observer and predictor."""
WHOLE: Parts = ((Pilot, "estimate_state"), (Pilot, "compute_command"))
"""All that a command needs: the reference, the bring-down it carries, the watch and the monitor too."""


@contextmanager
def time_calls(parts: Parts) -> Iterator[list[float]]:
    """Within it the time spent in ``parts`` is measured from outside [µs]; the last of them ends an entry."""
    found: list[float] = []
    spent = 0

    def wrap(owner: type, name: str) -> None:
        method = getattr(owner, name)

        def measure_call(*arguments: Any, **options: Any) -> Any:
            nonlocal spent
            start = perf_counter_ns()
            result = method(*arguments, **options)
            spent += perf_counter_ns() - start
            if name == parts[-1][1]:
                found.append(1e-3 * spent)
                spent = 0
            return result

        setattr(owner, name, measure_call)

    methods = [(owner, name, getattr(owner, name)) for owner, name in parts]
    for owner, name in parts:
        wrap(owner, name)
    try:
        yield found
    finally:
        for owner, name, method in methods:
            setattr(owner, name, method)


def one(scenario: str, ticks: int) -> dict[str, Any]:
    """The figures of one flight of ``ticks`` commands, flown twice."""
    world, config = prepare(SCENARIOS[scenario], [])
    figures: dict[str, Any] = {"scenario": scenario}
    for name, parts in (("", CORE), ("whole_", WHOLE)):
        with time_calls(parts) as found:
            fly(world, config, seed=0, duration_s=ticks * world.frame_period_s)
        figures |= {
            f"{name}median_us": median(found),
            f"{name}p99_us": float(np.quantile(found, 0.99, method="higher")),
            "ticks": len(found),
        }
    return figures


def measure(_: float) -> dict[str, Any]:
    """The figures of each scenario."""
    return {"goal_median_us": LIMIT_US, "rows": [one(scenario, TICKS) for scenario in FLOWN]}


def text(facts: dict[str, Any]) -> list[str]:
    """One line a scenario."""
    return [
        f"{row['scenario']:10} law, observer, predictor: median {row['median_us']:.1f} µs, p99 {row['p99_us']:.1f} µs "
        f"a command; all of a command {row['whole_median_us']:.1f} and {row['whole_p99_us']:.1f} "
        f"({row['ticks']} commands; goal: median below {facts['goal_median_us']:g} µs)"
        for row in facts["rows"]
    ]
