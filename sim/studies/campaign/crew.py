"""Crew of a campaign: processes on this machine, as many as asked for, or the workers of a Dask cluster.

Every worker of a cluster must run this very program: it is asked before the first flight, and once more by every
batch, as workers come and go. What a lost worker was flying, Dask gives to another one. Verification flies some flights
again, one by one, through wire bytes, and compares.
"""

import logging
import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (  # noqa: TID251  # processes, no threads, and no code of a flight sees them
    ProcessPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool  # noqa: TID251  # as above
from functools import partial
from types import TracebackType
from typing import Any

from groundstation.config import ConfigError
from sim.runs import fly
from sim.studies.campaign.campaign import Campaign, fly_chunk
from sim.studies.campaign.draws import draw_world
from sim.studies.campaign.folder import CampaignRow, program_sha256
from sim.world import generator

CONNECT_S = 10.0
"""How long to wait for the scheduler [s]."""


class Cluster:
    """The workers of the Dask scheduler at ``address``, as host:port or tcp://host:port."""

    def __init__(self, address: str) -> None:
        """Connect.

        Raises:
            ConfigError: dask.distributed is missing, nobody answers, no worker is there, or one runs another program.
        """
        try:
            from distributed import Client
        except ImportError:
            raise ConfigError(
                "--cluster",
                "needs dask.distributed, which is not installed: pip install 'quadrotor-groundstation[cluster]'",
            ) from None
        self._address = address
        for name in ("client", "core", "utils"):
            # What they tell in tracebacks is said here in a sentence.
            logging.getLogger(f"distributed.{name}").setLevel(logging.CRITICAL)
        try:
            self._client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = str(error) or type(error).__name__
            raise ConfigError("--cluster", f"no Dask scheduler answers at {address!r}: {reason}") from None
        try:
            self.workers = self._check()
        except BaseException:
            self._client.close()
            raise

    def _check(self) -> int:
        """How many workers there are, all of them running this program."""
        found: dict[str, Any] = self._client.run(program_sha256, on_error="return")
        if not found:
            raise ConfigError(
                "--cluster",
                f"the scheduler at {self._address} has no workers; start some: "
                f"dask worker {self._address} --nthreads 1",
            )
        mine = program_sha256()
        for worker, theirs in found.items():
            if theirs != mine:
                raise _foreign(worker, mine, theirs)
        return len(found)

    def __enter__(self) -> "Cluster":
        """Connected already."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect; what is still being flown is called off."""
        self._client.close()

    def fly(self, campaign: Campaign, chunks: Sequence[list[int]]) -> Iterator[list[CampaignRow]]:
        """See :class:`sim.studies.campaign.campaign.Crew`."""
        from distributed import CancelledError, KilledWorker, as_completed

        mine = program_sha256()
        futures = [self._client.submit(_fly_there, mine, campaign, chunk, pure=False) for chunk in chunks]
        try:
            for done in as_completed(futures, loop=self._client.loop):
                flown = done.result()
                if isinstance(flown, tuple):
                    worker, theirs = flown
                    raise _foreign(worker, mine, theirs)
                done.release()
                yield flown
        except (ImportError, AttributeError) as error:
            raise ConfigError(
                "--cluster", f"a worker lacks this program ({error}): install the same version of groundstation there"
            ) from None
        except KilledWorker as error:
            raise ConfigError(
                "--batch", f"worker after worker was lost over one batch, perhaps for want of memory: {error}"
            ) from None
        except CancelledError:
            raise ConfigError(
                "--cluster",
                f"the scheduler at {self._address} is gone; start it and its workers again, then this command: "
                "with --out it goes on where it was",
            ) from None
        finally:
            self._client.cancel(futures)


def _fly_there(program: str, campaign: Campaign, seeds: list[int]) -> list[CampaignRow] | tuple[str, str]:
    """On a worker: the flights of ``seeds``; or, where this is not ``program``, the worker's address and program."""
    mine = program_sha256()
    if mine != program:
        from distributed import get_worker

        return get_worker().address, mine
    return fly_chunk(campaign, seeds)


def _foreign(worker: str, mine: str, theirs: Any) -> ConfigError:
    what = f"sha256 {theirs[:12]}…" if isinstance(theirs, str) else f"it answers {theirs!r}"
    return ConfigError(
        "--cluster",
        f"the worker {worker} runs another program than this one ({what}, here {mine[:12]}…): figures of both must not "
        "be mixed; install the same version of groundstation there",
    )


class Local:
    """So many processes of this machine; one flies in this very process."""

    def __init__(self, workers: int) -> None:
        """Nothing is started before there is work."""
        self.workers = workers

    def fly(self, campaign: Campaign, chunks: Sequence[list[int]]) -> Iterator[list[CampaignRow]]:
        """See :class:`sim.studies.campaign.campaign.Crew`."""
        workers = min(self.workers, len(chunks))
        if workers <= 1:
            for chunk in chunks:
                yield fly_chunk(campaign, chunk)
            return
        pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _dies_with_ctrl_c)
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


LIMIT_CM = 0.01
"""How far two RMS errors of one flight may lie apart [cm]."""


def verify(campaign: Campaign, rows: Sequence[CampaignRow], count: int, *, workers: int) -> dict[str, Any]:
    """Fly ``count`` of the ``rows`` again, chosen at random but always the same ones, in ``workers`` processes.

    Returns how many, the largest distance of two RMS errors [cm] (None where none can be told), and the seeds of
    those that lie too far apart or ended otherwise.
    """
    chosen = generator(rows[0].seed, "verify").choice(len(rows), min(count, len(rows)), replace=False)
    sample = [rows[i] for i in sorted(chosen.tolist())]
    again = partial(_refly, campaign)
    if workers == 1:
        return _compare(sample, map(again, sample))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        flights: Callable[..., Iterable[tuple[bool, float | None]]] = pool.map
        return _compare(sample, flights(again, sample))


def _refly(campaign: Campaign, row: CampaignRow) -> tuple[bool, float | None]:
    """Whether the flight came to its end, and its RMS error [cm]."""
    world = draw_world(campaign.world, row.seed, campaign.draws)
    result = fly(world, campaign.config, seed=row.seed, duration_s=campaign.duration_s)
    return result.completed, result.verdict.rms_cm if result.completed else None


def _compare(sample: Sequence[CampaignRow], flights: Iterable[tuple[bool, float | None]]) -> dict[str, Any]:
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
