"""How the baselines got their gains: ``python -m sim.tune_baselines [CONTROLLER …]`` prints them. Takes minutes.

Each gets the same budget on the same flights: a third of it looks around (log-uniform over the whole space), the rest
walks from the best place found, in steps that grow with success and shrink without. The flights share no seed with
those that are reported. docs/decisions/0006-baselines.md has the figures.
"""

import argparse
import json
import math
import random
from collections.abc import Callable, Mapping
from typing import NamedTuple

from sim.commands import prepare
from sim.fly import fly
from sim.scenarios import SCENARIOS

SPACES: dict[str, dict[str, tuple[float, float]]] = {
    "geometric": {
        "k_position": (0.5, 20.0),
        "k_velocity": (0.7, 10.0),
        "k_integral": (0.05, 10.0),
        "coupling": (0.3, 3.0),
        "k_attitude": (1.0, 20.0),
    },
    "pid": {
        "p_position": (0.3, 5.0),
        "p_velocity": (0.7, 10.0),
        "i_velocity": (0.05, 10.0),
        "d_velocity": (0.01, 0.9),
        "p_attitude": (1.0, 20.0),
    },
    "indi": {
        "k_position": (0.5, 20.0),
        "k_velocity": (0.7, 10.0),
        "k_acceleration": (0.01, 1.0),
        "filter_s": (0.003, 0.3),
        "k_attitude": (1.0, 20.0),
    },
}
"""What is searched, and between which bounds; units in each controller's file."""
TUNING_SCENARIOS = ("paper", "fast", "adverse")
TUNING_SEEDS = (100, 101, 102)
DURATION_S = 25.0
"""Flights are judged from 15 s on, so over 10 s."""
BUDGET = 80
"""Sets of gains tried, each on every flight."""
CRASH_CM = 200.0
"""A flight that ends early counts so much, and none counts more."""

Point = Mapping[str, float]


class Tuned(NamedTuple):
    """The best gains found, and their figure."""

    gains: dict[str, float]
    score_cm: float
    """Geometric mean of the RMS errors of all flights [cm]."""


def search(space: dict[str, tuple[float, float]], cost: Callable[[Point], float], budget: int, seed: str) -> Tuned:
    """The cheapest of ``budget`` points of ``space``; its cost as the score. A pure function of its arguments."""
    draw = random.Random(seed)
    best: dict[str, float] = {}
    least = math.inf
    step = 0.3  # of the logarithmic width of each bound
    for trial in range(budget):
        around = trial < budget // 3
        point: dict[str, float] = {}
        for key, (low, high) in space.items():
            width = math.log(high / low)
            if around:
                value = low * math.exp(width * draw.random())
            else:
                value = best[key] * math.exp(step * width * draw.gauss(0.0, 1.0))
            point[key] = min(max(value, low), high)
        price = cost(point)
        if price < least:
            best, least = point, price
            step = step if around else step * 1.5
        elif not around:
            step = max(0.01, step * 0.9)
    return Tuned({key: float(f"{value:.3g}") for key, value in best.items()}, least)


def flown_cm(controller: str, gains: Mapping[str, float], extra: tuple[str, ...] = ()) -> float:
    """Geometric mean of the RMS errors [cm] of the tuning flights."""
    overrides = [f"controller.kind={controller}", *(f"controller.{key}={value!r}" for key, value in gains.items())]
    total = 0.0
    for name in TUNING_SCENARIOS:
        world, config = prepare(SCENARIOS[name], [*overrides, *extra])
        for seed in TUNING_SEEDS:
            result = fly(world, config, seed=seed, duration_s=DURATION_S)
            error = result.verdict.rms_cm if result.completed else None
            total += math.log(CRASH_CM if error is None else min(error, CRASH_CM))
    return math.exp(total / (len(TUNING_SCENARIOS) * len(TUNING_SEEDS)))


def tune(controller: str, extra: tuple[str, ...] = (), budget: int = BUDGET) -> Tuned:
    """The best gains of one baseline; ``extra`` are ``--set`` overrides that hold throughout."""
    return search(SPACES[controller], lambda point: flown_cm(controller, point, extra), budget, controller)


def _main() -> None:
    parser = argparse.ArgumentParser(prog="python -m sim.tune_baselines")
    parser.add_argument("controllers", nargs="*", metavar="CONTROLLER", help=f"of {', '.join(SPACES)}; default all")
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    args = parser.parse_args()
    for name in args.controllers or SPACES:
        tuned = tune(name, tuple(args.overrides))
        print(json.dumps({"controller": name, "score_cm": round(tuned.score_cm, 3), "gains": tuned.gains}), flush=True)


if __name__ == "__main__":
    _main()
