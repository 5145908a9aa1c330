"""Timing in turns (A B A B …), so that a machine that slows down slows all alike; and medians."""

from collections.abc import Callable
from statistics import median
from time import perf_counter


def in_turns(runs: dict[str, Callable[[], None]], rounds: int) -> dict[str, float]:
    """The median duration [s] of each of ``runs``, after one round that does not count."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(rounds + 1):
        for name, run in runs.items():
            start = perf_counter()
            run()
            if turn:
                times[name].append(perf_counter() - start)
    return {name: median(found) for name, found in times.items()}


def percentile(values: list[float], share: float) -> float:
    """The value below which ``share`` (0..1) of them lie."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
