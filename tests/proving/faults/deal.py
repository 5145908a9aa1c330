"""The cells of the fault deck, and how they are flown: virtual ones by several processes, then the real-time ones."""

import asyncio
import concurrent.futures as cf  # noqa: TID251  # processes, not threads, and none of them around an event loop
from collections.abc import Callable, Sequence

import msgspec

from sim.runs import Workers
from tests.proving.faults.cell import fly_together
from tests.proving.faults.faults import FAULTS, STATES
from tests.proving.faults.judge import Row

SPREAD = ("tracking", "hold", "take-off", "landing", "returning", "descent", "moving")
"""The states that a quick deck goes around in."""
AGAIN = ("dropout", "mode stolen", "controller exception", "frame loss")
"""Faults that it strikes with once more, in another state."""
TOGETHER = 12
"""So many cells at most are flown together by one process, that all processes have enough to do."""


class Cell(msgspec.Struct, frozen=True):
    """One fault in one state."""

    fault: str
    state: str

    @property
    def live(self) -> bool:
        """Whether it is flown by processes of their own, in real time."""
        return self.state in FAULTS[self.fault].live


def deal_cells(fault: str | None = None, state: str | None = None) -> list[Cell]:
    """Every cell; or those of one fault, or of one state."""
    return [
        Cell(name, place)
        for name, told in FAULTS.items()
        for place in told.states or STATES
        if fault in (None, name) and state in (None, place)
    ]


def quick() -> list[Cell]:
    """In virtual time every fault that needs no other process, and every state."""
    names = [name for name, told in FAULTS.items() if told.strike is not None]
    found: list[Cell] = []
    for names_, offset in ((names, 0), (AGAIN, 3)):
        for i, name in enumerate(names_):
            told = FAULTS[name]
            places = [place for place in told.states or SPREAD if place not in told.live]
            found.append(Cell(name, places[(i + offset) % len(places)]))
    return [*dict.fromkeys(found), Cell("dropout", "ready"), Cell("SIGTERM", "arming"), Cell("freeze", "spool-up")]


def pick_worst(flown: Sequence[Sequence[Row]]) -> list[Row]:
    """Of rows of the same cells with several seeds the worst: one that is not safe, else the one farthest off."""
    return [max(rows, key=lambda row: (not row.safe, row.peak_error_m)) for rows in zip(*flown, strict=True)]


def fly_all(
    work: Sequence[Cell],
    *,
    seed: int,
    scenario: str,
    overrides: Sequence[str],
    workers: int,
    on_done: Callable[[int], None] | None = None,
) -> list[Row]:
    """The rows of ``work``, in its order; ``on_done`` hears how many are flown."""
    rows: dict[Cell, Row] = {}

    def done(cell: Cell, row: Row) -> None:
        rows[cell] = row
        if on_done is not None:
            on_done(len(rows))

    alike: dict[object, list[Cell]] = {}
    for cell in work:
        told = FAULTS[cell.fault]
        if not cell.live:
            alike.setdefault((cell.state, told.link, told.source, told.overrides), []).append(cell)
    jobs = [cells[i : i + TOGETHER] for cells in alike.values() for i in range(0, len(cells), TOGETHER)]
    with Workers(max(1, min(workers, len(jobs)))) as pool:
        futures = {
            pool.submit(
                fly_together, [cell.fault for cell in job], job[0].state,
                seed=seed, scenario=scenario, overrides=tuple(overrides),
            ): job
            for job in jobs
        }  # fmt: skip
        for future in cf.as_completed(futures):
            for cell, row in zip(futures[future], future.result(), strict=True):
                done(cell, row)
    live = [cell for cell in work if cell.live]
    if live:
        from tests.proving.faults.live import fly_live_cells

        try:
            asyncio.run(fly_live_cells([(c.fault, c.state) for c in live], lambda f, s, row: done(Cell(f, s), row)))
        except asyncio.CancelledError:  # told to end
            raise KeyboardInterrupt from None
    return [rows[cell] for cell in work]
