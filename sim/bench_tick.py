"""The flying path: law, observer, predictor and watch for one command, in a real virtual flight."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median
from time import perf_counter_ns, thread_time_ns
from typing import TYPE_CHECKING, Any

from groundstation.pilot import Pilot, Tick
from groundstation.poses.port import Pose
from sim.bench_timing import percentile
from sim.commands import prepare
from sim.fly import fly
from sim.scenarios import SCENARIOS

if TYPE_CHECKING:
    from sim.bench import Options

FLOWN = ("paper", "adverse", "quad1kg")
TICKS = 20_000
"""Commands in each flight."""
LIMIT_US = 60.0
"""Goal for the median [µs]."""


@contextmanager
def timed(clock: Callable[[], int]) -> Iterator[tuple[list[float], list[float]]]:
    """Within it every pilot's poses, and its ticks with the poses before them, are timed from outside [µs]."""
    poses: list[float] = []
    ticks: list[float] = []
    inner_pose, inner_tick = Pilot.pose, Pilot.tick
    waiting = 0

    def pose(pilot: Pilot, pose: Pose) -> None:
        nonlocal waiting
        start = clock()
        inner_pose(pilot, pose)
        spent = clock() - start
        waiting += spent
        poses.append(1e-3 * spent)

    def tick(pilot: Pilot, time_s: float) -> Tick:
        nonlocal waiting
        start = clock()
        result = inner_tick(pilot, time_s)
        ticks.append(1e-3 * (clock() - start + waiting))
        waiting = 0
        return result

    setattr(Pilot, "pose", pose)  # noqa: B010  # mypy lets no method be assigned
    setattr(Pilot, "tick", tick)  # noqa: B010
    try:
        yield poses, ticks
    finally:
        setattr(Pilot, "pose", inner_pose)  # noqa: B010
        setattr(Pilot, "tick", inner_tick)  # noqa: B010


def one(scenario: str, ticks: int) -> dict[str, Any]:
    """The figures of one flight of ``ticks`` commands, flown twice: by the wall's clock and by the processor's."""
    world, config = prepare(SCENARIOS[scenario], [])
    with timed(perf_counter_ns) as (poses, whole):
        fly(world, config, seed=0, duration_s=ticks * world.frame_period_s)
    with timed(thread_time_ns) as (_, busy):
        fly(world, config, seed=0, duration_s=ticks * world.frame_period_s)
    return {
        "scenario": scenario,
        "ticks": len(whole),
        "median_us": median(whole),
        "p99_us": percentile(whole, 0.99),
        "cpu_median_us": median(busy),
        "cpu_p99_us": percentile(busy, 0.99),
        "pose_median_us": median(poses),
    }


def measure(options: "Options") -> dict[str, Any]:
    """The figures of each scenario."""
    del options
    return {"goal_median_us": LIMIT_US, "rows": [one(scenario, TICKS) for scenario in FLOWN]}


def text(facts: dict[str, Any]) -> list[str]:
    """One line a scenario."""
    return [
        f"{row['scenario']:10} median {row['median_us']:5.1f} µs, p99 {row['p99_us']:6.1f} µs a command and its poses; "
        f"of the processor's time {row['cpu_median_us']:.1f} and {row['cpu_p99_us']:.1f} µs "
        f"({row['ticks']} commands; goal: median below {facts['goal_median_us']:g} µs)"
        for row in facts["rows"]
    ]
