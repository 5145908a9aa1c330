"""Do a campaign's flights agree with ``fly``? Some of them flown again, one by one, through wire bytes."""

import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor  # noqa: TID251  # processes, no threads
from functools import partial
from typing import Any

from sim.runs import fly
from sim.studies.campaign.campaign import Campaign
from sim.studies.campaign.draws import drawn
from sim.studies.campaign.folder import Row
from sim.world import generator

LIMIT_CM = 0.01
"""How far two RMS errors of one flight may lie apart [cm]."""


def verify(campaign: Campaign, rows: Sequence[Row], count: int, *, workers: int) -> dict[str, Any]:
    """Fly ``count`` of the ``rows`` again, chosen at random but always the same ones, in ``workers`` processes.

    Returns how many, the largest distance of two RMS errors [cm] (None where none can be told), and the seeds of
    those that lie too far apart or ended otherwise.
    """
    chosen = generator(rows[0].seed, "verify").choice(len(rows), min(count, len(rows)), replace=False)
    sample = [rows[i] for i in sorted(chosen.tolist())]
    again = partial(_refly, campaign)
    if workers == 1:
        return _compared(sample, map(again, sample))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        flights: Callable[..., Iterable[tuple[bool, float | None]]] = pool.map
        return _compared(sample, flights(again, sample))


def _refly(campaign: Campaign, row: Row) -> tuple[bool, float | None]:
    """Whether the flight came to its end, and its RMS error [cm]."""
    world = drawn(campaign.world, row.seed, campaign.draws)
    result = fly(world, campaign.config, seed=row.seed, duration_s=campaign.duration_s)
    return result.completed, result.verdict.rms_cm if result.completed else None


def _compared(sample: Sequence[Row], flights: Iterable[tuple[bool, float | None]]) -> dict[str, Any]:
    largest: float | None = None
    apart: list[int] = []
    for row, (completed, rms_cm) in zip(sample, flights, strict=True):
        if completed != row.survived:
            apart.append(row.seed)
        elif rms_cm is not None and row.rms_cm is not None:
            distance = abs(rms_cm - row.rms_cm)
            largest = max(largest or 0.0, distance)
            if distance > LIMIT_CM:
                apart.append(row.seed)
    return {"flights": len(sample), "largest_cm": largest, "limit_cm": LIMIT_CM, "apart": apart}
