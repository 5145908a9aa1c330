"""Cells of the fault deck, flown by several processes: ``groundstation-sim dev faults``.

Processes that die in real time are no part of it: tests/e2e kills and freezes each of them.
"""

import argparse
import json
import os
from collections.abc import Callable, Sequence
from functools import partial

import msgspec
from msgspec.structs import replace

from groundstation.config import ConfigError
from groundstation.runtime import Exit
from sim.cli import ProgressBar
from sim.runs.pool import Workers
from sim.scenarios import scenario_of
from sim.text import notice
from tests.proving.faults.cell import FlightCopy, fly_together
from tests.proving.faults.fault import MOMENTS, Fault, Kind, name_of
from tests.proving.faults.faults import CASES, FAULTS, STATES, find_fault
from tests.proving.faults.judge import Row, judge_honest
from tests.proving.faults.monitors import FAILED, UNGUARDED, check_forced
from tests.proving.faults.table import is_within, text, write

TOGETHER = 12
"""At most this many cells are flown together by one process: all processes have enough to do."""


class Cell(msgspec.Struct, frozen=True):
    """One case in one state, on one link."""

    case: str
    state: str
    link: str
    scenario: str = "paper"
    seed: int = 0
    forced: str = ""
    """Doubt that is forced upon it, as :func:`monitors.go_on` has it; empty for none."""

    @property
    def fault(self) -> Fault:
        """Fault of this case as it is flown here."""
        return find_fault(self.case, self.state, self.link)

    def copies(self) -> tuple[FlightCopy, ...]:
        """Return what is flown for its row: honest rows have the same flight without guards."""
        copy = FlightCopy(self.case, self.forced)
        if self.fault.kind is not Kind.HONEST:
            return (copy,)
        return copy, FlightCopy(self.case, UNGUARDED)

    def row(self, flown: Sequence[Row]) -> Row:
        """Return its row, of those of its copies."""
        if len(flown) == 1:
            return flown[0]
        must = self.state in self.fault.flies_on and not self.forced.startswith(FAILED)
        return judge_honest(flown[0], flown[1], must_fly_on=must)


def deal_cells(
    fault: str | None = None, state: str | None = None, link: str | None = None
) -> list[Cell]:
    """Return every cell; or those of one fault or case, of one state, of one link."""
    return [
        Cell(case, place, on)
        for case, told in CASES.items()
        for on, places in ({told.link: told.states or STATES} | told.also).items()
        for place in places
        if fault in (None, case, name_of(case)) and state in (None, place) and link in (None, on)
    ]


def pick_worst(flown: Sequence[Sequence[Row]]) -> list[Row]:
    """Return, of rows of the same cells with several seeds, the worst of each cell."""
    return [
        max(rows, key=lambda row: (not row.safe, row.worst, row.peak_error_m))
        for rows in zip(*flown, strict=True)
    ]


def fly_all(
    cells: Sequence[Cell],
    *,
    overrides: Sequence[str],
    workers: int,
    on_done: Callable[[int], None] = lambda count: None,
) -> list[Row]:
    """Return the rows of ``cells``, in their order; ``on_done`` hears how many are flown."""
    rows: dict[Cell, Row] = {}
    alike: dict[object, list[Cell]] = {}
    for cell in cells:
        told = cell.fault
        setting = (cell.state, cell.link, told.source, told.overrides, told.kind is Kind.HONEST)
        alike.setdefault((cell.scenario, cell.seed, *setting), []).append(cell)
    jobs = [
        some[i : i + TOGETHER] for some in alike.values() for i in range(0, len(some), TOGETHER)
    ]
    # Never in this process, even with one worker: its bar has a thread, and a process that is
    # copied must have none.
    with Workers(max(1, min(workers, len(jobs)))) as pool:
        for number, found in pool.as_done(partial(_fly_job, tuple(overrides)), jobs):
            rows |= zip(jobs[number], found, strict=True)
            on_done(len(rows))
    return [rows[cell] for cell in cells]


def _fly_job(overrides: tuple[str, ...], job: Sequence[Cell]) -> list[Row]:
    """Return the rows of cells that are set up alike."""
    copies, (first, *_) = [copy for cell in job for copy in cell.copies()], job
    rows = fly_together(
        copies, first.state, link=first.link, seed=first.seed, scenario=first.scenario,
        overrides=overrides,
    )  # fmt: skip
    flown = iter(rows)
    return [cell.row([next(flown) for _ in cell.copies()]) for cell in job]


def faults(args: argparse.Namespace) -> Exit:
    """Break one thing in every state of a mission."""
    scenario_of(args.scenario)
    kinds = set(args.kind or ())
    cases = list({**CASES, **FAULTS})
    choices = [("--fault", args.fault, cases), ("--state", args.state, list(MOMENTS))]
    choices += [("--kind", kind, list(map(str, Kind))) for kind in args.kind or ()]
    for option, given, known in choices:
        if given is not None and given not in known:
            raise ConfigError(option, notice("value.choice", choices=known, found=given))
    check_forced(args.forced)
    if args.forced and kinds != {Kind.HONEST}:
        raise ConfigError("--forced", notice("dev.forced"))
    cells = deal_cells(args.fault, args.state, args.link)
    work = [cell for cell in cells if not kinds or cell.fault.kind in kinds]
    if not work:
        raise ConfigError("--state", notice("dev.state", fault=args.fault or "nothing"))
    seeds = range(args.seed, args.seed + args.seeds)
    plan = [
        replace(cell, scenario=args.scenario, seed=seed, forced=args.forced)
        for seed in seeds
        for cell in work
    ]
    with ProgressBar("flights", len(plan), quiet=args.json) as counter:
        workers = args.workers or os.cpu_count() or 1
        flown = fly_all(plan, overrides=args.overrides, workers=workers, on_done=counter.at)
    rows = pick_worst([flown[i : i + len(work)] for i in range(0, len(flown), len(work))])
    if args.write is not None:
        write(args.write, rows)
    print(json.dumps({"rows": msgspec.to_builtins(rows)}) if args.json else text(rows))
    return Exit.DONE if is_within(rows) else Exit.FAILED
