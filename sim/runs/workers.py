"""Worker processes: flights on several cores, ended by Ctrl-C without a word of theirs, also while they start."""

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor  # noqa: TID251  # processes, no threads; no flight sees them
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from types import TracebackType
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
A = TypeVar("A")
T = TypeVar("T")


class Workers(ProcessPoolExecutor):
    """Pool of processes. After an exception it begins nothing more."""

    def __init__(self, count: int) -> None:
        """Nothing is started before there is work. Spawned: a forked process would inherit this one's threads."""
        super().__init__(count, multiprocessing.get_context("spawn"), _obey_ctrl_c)

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """See :class:`concurrent.futures.Executor`; it may start a process."""
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            raise SystemExit(1)  # a worker reads the user's script, which asks for workers at once: who began says so
        resource_tracker.ensure_running()  # it would let SIGINT through, half-way
        with _ctrl_c_later():
            return super().submit(fn, *args, **kwargs)

    def each(self, fn: Callable[[A], T], items: Iterable[A]) -> Iterator[T]:
        """Apply ``fn`` to each item, results in order; all are begun at once.

        Not ``map``, which cancels here what its own thread gives up as Ctrl-C ends the processes: that thread then
        tells a traceback.
        """
        begun = [self.submit(fn, item) for item in items]
        return (future.result() for future in begun)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.shutdown(cancel_futures=True)


@contextmanager
def _ctrl_c_later() -> Iterator[None]:
    """A SIGINT waits: here until the new process has got all it reads, there, which inherits it, until it is obeyed."""
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
