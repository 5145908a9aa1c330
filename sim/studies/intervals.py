"""Coverage of the intervals that ``groundstation identify`` gives, over simulated flights."""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

from groundstation.analysis.identify import identify, read_stretch
from groundstation.core.vehicle import Vehicle
from sim.runs import RECORDING, simulate
from sim.scenarios import SCENARIOS, override_world
from sim.world import World

SECONDS = 31.0
"""Duration of each flight [s]."""
ASKED = ("trajectory.kind=excitation", "trajectory.laps=2")
UNTOLD = {"adverse": ("sim.thrust_delay_s=0.012", "sim.rate_delay_s=0.025", "sim.drag_per_s=0.3")}
"""Additional truth of a scenario that the controller is not configured with."""
SHOWN = {
    "thrust_scale": ("thrust scale", 100.0, "%"),
    "thrust_curve": ("thrust curve f", 1.0, ""),
    "thrust_sag": ("thrust lost to the battery", 1.0, "1/min"),
    "thrust_lag": ("thrust lag", 1e3, "ms"),
    "thrust_delay": ("thrust delay", 1e3, "ms"),
    "rate_lag": ("rate lag, roll and pitch", 1e3, "ms"),
    "rate_delay": ("rate delay, roll and pitch", 1e3, "ms"),
    "yaw_rate_lag": ("rate lag, yaw", 1e3, "ms"),
    "yaw_rate_delay": ("rate delay, yaw", 1e3, "ms"),
    "rate_response": ("rate lag + delay, roll and pitch", 1e3, "ms"),
    "yaw_rate_response": ("rate lag + delay, yaw", 1e3, "ms"),
    "drag": ("linear drag", 1.0, "1/s"),
    "pose_latency": ("latency of poses", 1e3, "ms"),
}
"""Name of each parameter, and the factor and unit in which half of its interval is shown."""


class ToldInterval(NamedTuple):
    """Interval of one parameter from one flight."""

    scenario: str
    name: str
    value: float
    low: float
    high: float


def identify_flights(scenario: str, flights: int) -> Iterator[list[ToldInterval]]:
    """Identify ``flights`` excitation flights, seeds 0 and up.

    Yield the identifiable parameters of each.
    """
    for seed in range(flights):
        with tempfile.TemporaryDirectory(prefix="groundstation-intervals-") as folder:
            overrides = [*ASKED, *UNTOLD.get(scenario, ())]
            simulate(
                scenario,
                seed=seed,
                duration=SECONDS,
                overrides=overrides,
                out=Path(folder) / "flight",
            )
            found = identify(read_stretch(Path(folder) / "flight" / RECORDING)).parameters
        told = [one for one in found.values() if one.name in SHOWN]
        yield [
            ToldInterval(scenario, one.name, one.value, *one.interval)
            for one in told
            if one.value is not None and one.interval is not None
        ]


def truths(scenario: str) -> dict[str, float]:
    """The parameters of a scenario that are known; those of a rate loop's lag and delay are not."""
    told, room = SCENARIOS[scenario].vehicle, SCENARIOS[scenario].world
    world = override_world(room, list(UNTOLD.get(scenario, ())))
    known = {
        "thrust_scale": _scale(world, told),
        "thrust_sag": world.thrust_sag,
        "drag": world.drag_per_s,
        "pose_latency": world.pose_latency_s,
    }
    if world.plant == "rotors":
        return known
    delay = world.command_delay_s
    return known | {
        "thrust_curve": world.thrust_curve,
        "thrust_lag": world.thrust_lag_s,
        "thrust_delay": delay + world.thrust_delay_s,
        **dict.fromkeys(("rate_lag", "yaw_rate_lag"), world.rate_lag_s),
        **dict.fromkeys(("rate_delay", "yaw_rate_delay"), delay + world.rate_delay_s),
        **dict.fromkeys(
            ("rate_response", "yaw_rate_response"), world.rate_lag_s + delay + world.rate_delay_s
        ),
    }


def _scale(world: World, told: Vehicle) -> float:
    """True thrust over mass, by what was told, in the middle of the flight: the battery sags."""
    middle = world.thrust_gain * (1.0 - world.thrust_sag * 0.5 * SECONDS / 60.0)
    return middle * (world.thrust_max_n / told.thrust_max_n) * (told.mass_kg / world.mass_kg)


def coverage_table(found: Sequence[ToldInterval], flights: int) -> str:
    """A row a parameter: in how many of the flights that told it the truth lies within, and half of
    the interval.
    """
    scenarios = list(dict.fromkeys(one.scenario for one in found))
    heads = " | ".join(f"`{name}`" for name in scenarios)
    lines = [f"| of {flights} flights | {heads} |", "|---|" + "---:|" * len(scenarios)]
    for name, (words, unit, unit_name) in SHOWN.items():
        cells = []
        for scenario in scenarios:
            here = [one for one in found if (one.scenario, one.name) == (scenario, name)]
            if not here:
                cells.append("not told")
                continue
            known = truths(scenario).get(name)
            true = sum(one.value for one in here) / len(here) if known is None else known
            within = sum(one.low <= true <= one.high for one in here)
            half = unit * median(0.5 * (one.high - one.low) for one in here)
            told = "" if len(here) == flights else f" of the {len(here)} that told it"
            cells.append(f"{within}{told} ({half:.2g} {unit_name})".replace(" )", ")"))
        lines.append(f"| {words} | {' | '.join(cells)} |")
    return "\n".join(lines)
