"""Flights that tuning judges: whole ones, through wire bytes, whatever the controller; several processes fly them.

Not the arrays of :mod:`sim.batch.batch`: those fly one kind of controller only, and pay from some 25 equal flights on,
while a set of gains is tried on about ten.
"""

import multiprocessing
import signal
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor  # noqa: TID251  # processes, no threads; no flight sees them
from concurrent.futures.process import BrokenProcessPool  # noqa: TID251  # as above
from typing import NamedTuple

import msgspec

from groundstation.config import ConfigError
from sim.runs import fly
from sim.studies.tune.stage import Staged

CRASH_CM = 200.0
"""A flight that ends early counts so much, and none counts more [cm]."""
AFTER_STEP_S = 10.0
"""Where the wind steps, flights last so much longer than that [s]."""


class Sortie(msgspec.Struct, frozen=True):
    """One flight to fly."""

    stage: Staged
    seed: int
    duration_s: float


class Outcome(NamedTuple):
    """What came of it."""

    rms_cm: float | None
    """From 15 s on; None where it did not get to its end."""
    why: str
    """How it ended, as a sentence."""

    @property
    def cost_cm(self) -> float:
        """The RMS error, or what stands for a crash [cm]."""
        return CRASH_CM if self.rms_cm is None else min(self.rms_cm, CRASH_CM)


def flown(sortie: Sortie) -> Outcome:
    """Fly it."""
    world, config = sortie.stage.world, sortie.stage.config
    result = fly(world, config, seed=sortie.seed, duration_s=sortie.duration_s)
    return Outcome(result.verdict.rms_cm if result.completed else None, result.why)


def sorties(stage: Staged, seeds: Sequence[int], duration_s: float) -> list[Sortie]:
    """One flight a seed, long enough to see the scenario's step of the wind if it has one."""
    if any(stage.world.wind_step):
        duration_s = max(duration_s, stage.world.wind_step_time_s + AFTER_STEP_S)
    return [Sortie(stage, seed, duration_s) for seed in seeds]


class Flyers:
    """Processes that fly. With one worker it is this process, and none is started."""

    def __init__(self, workers: int) -> None:
        """``workers`` >= 1."""
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> "Flyers":
        """Nothing starts before the first flight."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes; what they have not begun is left."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def fly(self, work: Sequence[Sortie]) -> list[Outcome]:
        """Fly all, in the order of ``work``.

        Raises:
            ConfigError: a process was ended from outside.
        """
        if self._workers == 1:
            return [flown(sortie) for sortie in work]
        if self._pool is None:
            # Spawned, as a forked process would inherit whatever threads this one has.
            self._pool = ProcessPoolExecutor(self._workers, multiprocessing.get_context("spawn"), _dies_with_ctrl_c)
        try:
            return list(self._pool.map(flown, work))
        except BrokenProcessPool:
            raise ConfigError("--workers", "a process was ended from outside; the same command goes on") from None


def _dies_with_ctrl_c() -> None:
    """In a worker: go without a word. The program says what there is to say."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
