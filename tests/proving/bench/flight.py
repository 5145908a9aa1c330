"""Flight seconds per second of ``fly``: one vehicle, through real wire bytes."""

from functools import partial
from typing import Any

from groundstation.settings import Config
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from sim.world import World
from tests.proving.bench.bench import Options, in_turns

FLOWN = ("paper", "adverse", "quad1kg")
DURATION_S = 60.0
ROUNDS = 5


def once(world: World, config: Config) -> None:
    """One flight."""
    fly(world, config, seed=0, duration_s=DURATION_S)


def measure(options: Options) -> dict[str, Any]:
    """The figures of each scenario, measured in turns."""
    del options
    found = in_turns({name: partial(once, *prepare(SCENARIOS[name], [])) for name in FLOWN}, ROUNDS)
    return {
        "duration_s": DURATION_S,
        "rounds": ROUNDS,
        "rows": [
            {"scenario": name, "median_s": spent, "times_real_time": DURATION_S / spent}
            for name, spent in found.items()
        ],
    }


def text(facts: dict[str, Any]) -> list[str]:
    """One line a scenario."""
    return [
        f"{row['scenario']:10} {facts['duration_s']:g} s flown in {row['median_s']:.2f} s: "
        f"{row['times_real_time']:.0f} times real time (median of {facts['rounds']})"
        for row in facts["rows"]
    ]
