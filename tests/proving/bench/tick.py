"""The flying path: law, observer and predictor for one command, and all that it needs, in whole virtual flights.

And what the monitor of the poses and the second witness take of a command: a flight's time with and without the methods
of the pilot that watch the poses, and that of the witness.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from statistics import median
from time import perf_counter_ns, thread_time_ns
from typing import Any

from groundstation.core.control import Adaptive
from groundstation.core.estimation import ModelEstimator
from groundstation.core.pilot import Pilot
from groundstation.core.safety import Witness
from sim.runs import fly, percentile
from sim.scenarios import SCENARIOS, prepare
from tests.proving.bench.bench import Options

GOAL_SHARE = 0.1
"""Largest share of a command's time for the monitor of the poses and the second witness [-]."""
MONITOR_TICKS = 1500
"""Commands in a flight of the monitor's measurement."""
ROUNDS = 5
"""Flights of each of its measurements; the fastest counts, which other programs disturbed least."""


"""Classes whose calls are recorded, and the methods that their owner calls."""

Method = Callable[..., Any]


@contextmanager
def wrap_methods(parts: Sequence[tuple[type, str]], wrap: Callable[[str, Method], Method]) -> Iterator[None]:
    """Within it each method of ``parts`` is what ``wrap`` makes of its name and itself."""
    inner = [(owner, name, getattr(owner, name)) for owner, name in parts]
    for owner, name, method in inner:
        setattr(owner, name, wrap(name, method))
    try:
        yield
    finally:
        for owner, name, method in inner:
            setattr(owner, name, method)


FLOWN = ("paper", "adverse", "quad1kg")
TICKS = 20_000
"""Commands in each flight."""
LIMIT_US = 60.0
"""Goal for the median [µs]."""


CORE = ((ModelEstimator, "update"), (ModelEstimator, "predict"), (Adaptive, "decide"))
"""Law, observer and predictor."""
WHOLE = ((Pilot, "add_pose"), (Pilot, "tick"))
"""All that a command needs: the reference, the bring-down it carries, the watch and the monitor too."""


@contextmanager
def time_calls(parts: Sequence[tuple[type, str]], clock: Callable[[], int]) -> Iterator[list[float]]:
    """Within it the time spent in ``parts`` is measured from outside [µs]; the last of them ends an entry."""
    found: list[float] = []
    spent = 0

    def wrap(name: str, method: Method) -> Method:
        def measure_call(*arguments: Any, **options: Any) -> Any:
            nonlocal spent
            start = clock()
            result = method(*arguments, **options)
            spent += clock() - start
            if name == parts[-1][1]:
                found.append(1e-3 * spent)
                spent = 0
            return result

        return measure_call

    with wrap_methods(parts, wrap):
        yield found


UNWATCHED: dict[str, Any] = {"_accepts": True, "_check_response": None, "_suspect_new_wind": None}
"""Methods of the pilot that watch the poses, and their answers where every pose is believed unseen."""
WITNESS = ((Witness, "add_attitude"), (Witness, "arm"), (Witness, "add_pose"))


def monitor(scenario: str) -> dict[str, float]:
    """Return the time of monitor and witness for a command [µs], and their share of all of it."""
    world, config = prepare(SCENARIOS[scenario], [])

    def each_us(parts: Sequence[tuple[type, str]], unwatched: Sequence[str] = ()) -> float:
        with (
            wrap_methods([(Pilot, name) for name in unwatched], lambda name, _: lambda *_, **__: UNWATCHED[name]),
            time_calls(parts, thread_time_ns) as found,
        ):
            fly(world, config, seed=0, duration_s=MONITOR_TICKS * world.frame_period_s)
        return sum(found) / MONITOR_TICKS

    pilot, plain, witness = (
        min(each_us(*what) for _ in range(ROUNDS)) for what in ((WHOLE,), (WHOLE, tuple(UNWATCHED)), (WITNESS,))
    )
    return {
        "monitor_us": pilot - plain + witness,
        "monitor_share": (pilot - plain + witness) / (pilot + witness),
        "witness_share": witness / (pilot + witness),
    }


def one(scenario: str, ticks: int) -> dict[str, Any]:
    """The figures of one flight of ``ticks`` commands, flown three times, and what :func:`monitor` finds."""
    world, config = prepare(SCENARIOS[scenario], [])

    def fly_once(parts: Sequence[tuple[type, str]], clock: Callable[[], int]) -> list[float]:
        with time_calls(parts, clock) as found:
            fly(world, config, seed=0, duration_s=ticks * world.frame_period_s)
        return found

    core, busy, whole = (
        fly_once(CORE, perf_counter_ns),
        fly_once(CORE, thread_time_ns),
        fly_once(WHOLE, perf_counter_ns),
    )
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


def measure(options: Options) -> dict[str, Any]:
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
