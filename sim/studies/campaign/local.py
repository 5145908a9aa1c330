"""A campaign's crew on this machine: processes, as many as asked for."""

import multiprocessing
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import (  # noqa: TID251  # processes, no threads, and no code of a flight sees them
    ProcessPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool  # noqa: TID251  # as above

from groundstation.config.load import ConfigError
from sim.studies.campaign.campaign import Campaign, fly_chunk
from sim.studies.campaign.folder import Row


class Local:
    """So many processes of this machine; one flies in this very process."""

    def __init__(self, workers: int) -> None:
        """Nothing is started before there is work."""
        self.workers = workers

    def fly(self, campaign: Campaign, chunks: Sequence[list[int]]) -> Iterator[list[Row]]:
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
