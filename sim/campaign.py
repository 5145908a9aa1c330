"""``groundstation-sim campaign``: a scenario flown a thousand times in drawn worlds, as arrays, on all cores.

Every flight is drawn from its seed alone, and neither the size of the batches nor the number of the processes
changes a figure of it.
"""

import math
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (  # noqa: TID251  # processes, no threads, and no code of a flight sees them
    ProcessPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool  # noqa: TID251  # as above
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import ConfigError
from groundstation.settings import Config
from sim.batch import fly_batch, refusal
from sim.campaign_draws import DRAWN, LAG, MASS, THRUST_GAIN, drawn
from sim.campaign_folder import Folder, Row, program_sha256
from sim.referee import STEADY_S
from sim.world import World


class Campaign(msgspec.Struct, frozen=True, kw_only=True):
    """What all flights share."""

    scenario: str
    world: World
    """What the draws of :func:`sim.campaign_draws.drawn` start from."""
    config: Config
    duration_s: float
    """Of each flight, from the release [s]."""
    overrides: list[str]
    """``--set`` as given, to name the command that flies one flight again."""

    def check(self) -> None:
        """Refuse what cannot be flown or would not be true.

        Raises:
            ConfigError: a controller that no batch flies, a value that is drawn anyway, or too short flights.
        """
        if (reason := refusal(self.config)) is not None:
            raise ConfigError("controller", reason)
        if self.duration_s <= STEADY_S:
            raise ConfigError("--duration", f"flights are judged from {STEADY_S:g} s on, expected more than that")
        if any(o.partition("=")[0].strip() == "sim.thrust_gain" for o in self.overrides):
            low, high = THRUST_GAIN
            raise ConfigError("sim.thrust_gain", f"a campaign draws it, from {low:g} to {high:g}", "--set")

    def settings(self) -> dict[str, Any]:
        """What makes two rows comparable, for ``settings.json``."""
        return {
            "scenario": self.scenario,
            "duration_s": self.duration_s,
            "drawn": {"fields": DRAWN, "mass": MASS, "lag": LAG, "thrust_gain": THRUST_GAIN},
            "sim": msgspec.to_builtins(self.world),
            "told": msgspec.to_builtins(self.config),
            "program_sha256": program_sha256(),
        }


def run(
    campaign: Campaign,
    seeds: Sequence[int],
    *,
    out: Path | None,
    batch: int,
    workers: int,
    on_progress: Callable[[int], None] = lambda done: None,
) -> tuple[list[Row], int]:
    """Fly the ``seeds`` that ``out`` does not hold yet, ``batch`` at a time in ``workers`` processes.

    ``on_progress`` hears how many rows there are. Returns all rows in the order of the seeds, and how many of
    them were flown now.

    Raises:
        ConfigError: see :meth:`Campaign.check` and :class:`Folder`; or a process was ended from outside.
    """
    campaign.check()
    folder = Folder(out, campaign.settings()) if out is not None else None
    wanted = set(seeds)
    rows = {row.seed: row for row in (folder.rows if folder is not None else []) if row.seed in wanted}
    missing = [seed for seed in seeds if seed not in rows]
    chunks = [missing[i : i + batch] for i in range(0, len(missing), batch)]
    on_progress(len(rows))
    for flown in _flown(campaign, chunks, workers):
        if folder is not None:
            folder.add(flown)
        rows |= {row.seed: row for row in flown}
        on_progress(len(rows))
    return [rows[seed] for seed in seeds], len(missing)


def _flown(campaign: Campaign, chunks: list[list[int]], workers: int) -> Iterator[list[Row]]:
    """Chunks as they are done."""
    if min(workers, len(chunks)) <= 1:
        for chunk in chunks:
            yield fly_chunk(campaign, chunk)
        return
    pool = ProcessPoolExecutor(min(workers, len(chunks)), multiprocessing.get_context("spawn"), _dies_with_ctrl_c)
    try:
        for done in as_completed([pool.submit(fly_chunk, campaign, chunk) for chunk in chunks]):
            yield done.result()
    except BrokenProcessPool:
        raise ConfigError(
            "--batch",
            "a process was ended from outside, perhaps for want of memory; take smaller batches, fewer workers",
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _dies_with_ctrl_c() -> None:
    """In a worker: go without a word. The program says what there is to say."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def fly_chunk(campaign: Campaign, seeds: list[int]) -> list[Row]:
    """Fly ``seeds`` as one batch."""
    worlds = [drawn(campaign.world, seed) for seed in seeds]
    flights = fly_batch(worlds, campaign.config, seeds, duration_s=campaign.duration_s)
    figures = zip(*(column.tolist() for column in flights), strict=True)
    return [_row(seed, world, *figure) for seed, world, figure in zip(seeds, worlds, figures, strict=True)]


def _row(seed: int, w: World, rms_m: float, max_m: float, settle_s: float, saturated: float, survived: bool) -> Row:
    return Row(
        seed=seed,
        mass_kg=w.mass_kg,
        thrust_lag_s=w.thrust_lag_s,
        rate_lag_s=w.rate_lag_s,
        thrust_gain=w.thrust_gain,
        wind_north=w.wind_mean[0],
        wind_east=w.wind_mean[1],
        wind_down=w.wind_mean[2],
        gust_north=w.wind_gust[0],
        gust_east=w.wind_gust[1],
        gust_down=w.wind_gust[2],
        rms_cm=_known(100.0 * rms_m),
        max_cm=_known(100.0 * max_m),
        settle_s=_known(settle_s),
        saturated=saturated,
        survived=survived,
    )


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
