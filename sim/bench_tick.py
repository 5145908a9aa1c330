"""The flying path: law, observer and predictor for one command, and all that it needs, in whole virtual flights."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from statistics import median
from time import perf_counter_ns, thread_time_ns
from typing import TYPE_CHECKING, Any

from groundstation.control.adaptive import Adaptive
from groundstation.control.estimator import ModelEstimator
from groundstation.pilot import Pilot
from sim.bench_monitor import GOAL_SHARE, monitor
from sim.bench_timing import percentile
from sim.fly import fly
from sim.prepare import prepare
from sim.scenarios import SCENARIOS

if TYPE_CHECKING:
    from sim.bench import Options

FLOWN = ("paper", "adverse", "quad1kg")
TICKS = 20_000
"""Commands in each flight."""
LIMIT_US = 60.0
"""Goal for the median [µs]."""


CORE = ((ModelEstimator, "pose"), (ModelEstimator, "predict"), (Adaptive, "decide"))
"""Law, observer and predictor."""
WHOLE = ((Pilot, "pose"), (Pilot, "tick"))
"""All that a command needs: the reference, the bring-down it carries, the watch and the monitor too."""


@contextmanager
def timed(parts: Sequence[tuple[type, str]], clock: Callable[[], int]) -> Iterator[list[float]]:
    """Within it the time spent in ``parts`` is measured from outside [µs]; the last of them ends an entry."""
    found: list[float] = []
    spent = 0
    inner = [(owner, name, getattr(owner, name)) for owner, name in parts]

    def wrapped(method: Callable[..., Any], *, last: bool) -> Callable[..., Any]:
        def measured(*arguments: Any, **options: Any) -> Any:
            nonlocal spent
            start = clock()
            result = method(*arguments, **options)
            spent += clock() - start
            if last:
                found.append(1e-3 * spent)
                spent = 0
            return result

        return measured

    for number, (owner, name, method) in enumerate(inner, 1):
        setattr(owner, name, wrapped(method, last=number == len(inner)))
    try:
        yield found
    finally:
        for owner, name, method in inner:
            setattr(owner, name, method)


def one(scenario: str, ticks: int) -> dict[str, Any]:
    """The figures of one flight of ``ticks`` commands, flown three times, and what :func:`monitor` finds."""
    world, config = prepare(SCENARIOS[scenario], [])

    def flown(parts: Sequence[tuple[type, str]], clock: Callable[[], int]) -> list[float]:
        with timed(parts, clock) as found:
            fly(world, config, seed=0, duration_s=ticks * world.frame_period_s)
        return found

    core, busy, whole = flown(CORE, perf_counter_ns), flown(CORE, thread_time_ns), flown(WHOLE, perf_counter_ns)
    return {
        "scenario": scenario,
        "ticks": len(core),
        "median_us": median(core),
        "p99_us": percentile(core, 0.99),
        "cpu_median_us": median(busy),
        "cpu_p99_us": percentile(busy, 0.99),
        "whole_median_us": median(whole),
        "whole_p99_us": percentile(whole, 0.99),
        **monitor(scenario),
    }


def measure(options: "Options") -> dict[str, Any]:
    """The figures of each scenario."""
    del options
    return {
        "goal_median_us": LIMIT_US,
        "goal_monitor_share": GOAL_SHARE,
        "rows": [one(scenario, TICKS) for scenario in FLOWN],
    }


def text(facts: dict[str, Any]) -> list[str]:
    """One line a scenario."""
    return [
        f"{row['scenario']:10} law, observer, predictor: median {row['median_us']:.1f} µs, p99 {row['p99_us']:.1f} µs "
        f"a command (of the processor's time {row['cpu_median_us']:.1f} and {row['cpu_p99_us']:.1f}); "
        f"all of a command {row['whole_median_us']:.1f} and {row['whole_p99_us']:.1f}; "
        f"the monitor of the poses takes {row['monitor_us']:.1f} µs, {100.0 * row['monitor_share']:.1f} % "
        f"(goal: at most {100.0 * facts['goal_monitor_share']:g} %), of which the second witness "
        f"{100.0 * row['witness_share']:.1f} % "
        f"({row['ticks']} commands; goal: median below {facts['goal_median_us']:g} µs)"
        for row in facts["rows"]
    ]
