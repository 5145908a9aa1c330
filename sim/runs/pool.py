"""Worker processes, ended by Ctrl-C without a word of theirs, also while they start.

Loaded where there are any.
"""

import concurrent.futures as cf  # noqa: TID251  # processes, no threads; no flight sees them
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool  # noqa: TID251  # as above
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from types import TracebackType
from typing import ParamSpec, TypeVar

from groundstation.config import ConfigError
from sim.text import notice

P = ParamSpec("P")
A = TypeVar("A")
T = TypeVar("T")


class Workers(cf.ProcessPoolExecutor):
    """Pool of processes. After an exception it begins nothing more."""

    def __init__(self, count: int) -> None:
        """Nothing is started before there is work.

        Spawned: a forked process would inherit this one's threads.
        """
        super().__init__(count, multiprocessing.get_context("spawn"), _obey_ctrl_c)

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> cf.Future[T]:
        """See :class:`concurrent.futures.Executor`; it may start a process."""
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            # A worker reads the user's script, which asks for workers at once: who began says so.
            raise SystemExit(1)
        resource_tracker.ensure_running()  # it would let SIGINT through, half-way
        with _ctrl_c_later():
            return super().submit(fn, *args, **kwargs)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.shutdown(cancel_futures=True)

    def as_done(self, fn: Callable[[A], T], work: Sequence[A]) -> Iterator[tuple[int, T]]:
        """Number and result of each of ``work``, as they come.

        Raises:
            ConfigError: a process was ended from outside.
        """
        begun = {self.submit(fn, one): i for i, one in enumerate(work)}
        try:
            for future in cf.as_completed(begun):
                yield begun[future], future.result()
        except BrokenProcessPool:
            raise ConfigError("--workers", notice("sim.worker_ended")) from None


@contextmanager
def _ctrl_c_later() -> Iterator[None]:
    """A SIGINT waits: here until the new process has got all it reads, there, which inherits it,
    until it is obeyed.
    """
    came: list[int] = []
    before = None
    with suppress(ValueError):  # not the main thread: no Ctrl-C comes here
        before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if before is not None:
            signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


def _obey_ctrl_c() -> None:
    """In a worker: go at once, without a word. The program says what there is to say."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
