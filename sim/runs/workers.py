"""Flights on several cores."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Self, TypeVar

if TYPE_CHECKING:
    from sim.runs.pool import Workers

A = TypeVar("A")
T = TypeVar("T")


class Flyers:
    """Processes that fly, for as long as this is open.

    With one worker it is this process, and none is started.
    """

    def __init__(self, workers: int) -> None:
        """``workers`` >= 1."""
        self.workers = workers
        self._pool: Workers | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def as_done(self, fn: Callable[[A], T], work: Sequence[A]) -> Iterator[tuple[int, T]]:
        """Number and result of each of ``work``, as they come.

        Raises:
            ConfigError: a process was ended from outside.
        """
        if self.workers == 1:
            yield from ((i, fn(one)) for i, one in enumerate(work))
            return
        if self._pool is None:
            from sim.runs.pool import Workers  # only now: one flight alone needs no processes

            self._pool = Workers(self.workers)
        yield from self._pool.as_done(fn, work)

    def each(
        self,
        fn: Callable[[A], T],
        work: Sequence[A],
        on_done: Callable[[int], None] = lambda done: None,
    ) -> list[T]:
        """Results in the order of ``work``; ``on_done`` hears how many there are."""
        found: dict[int, T] = {}
        for number, result in self.as_done(fn, work):
            found[number] = result
            on_done(len(found))
        return [found[i] for i in range(len(work))]
