"""Cells of the fault deck, flown by several processes: ``groundstation-sim dev faults``.

Processes that die in real time are no part of it: tests/e2e kills and freezes each of them.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from functools import partial

import msgspec
from msgspec.structs import replace

from groundstation.config import ConfigError, refuse_io, suggest
from groundstation.runtime import Exit
from sim.cli import ProgressBar, typed_command
from sim.runs.pool import Workers
from sim.scenarios import find_scenario
from sim.text import notice
from tests.proving.faults.cell import Cell, fly_together
from tests.proving.faults.fault import MOMENTS, Kind, name_of
from tests.proving.faults.faults import CASES, FAULTS, STATES
from tests.proving.faults.judge import Row, judge_honest
from tests.proving.faults.monitors import FAILED, FAILURES, SUSPECT, UNGUARDED
from tests.proving.faults.table import is_within, page, text

TOGETHER = 12
"""At most this many cells are flown together by one process: all processes have enough to do."""


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
    """Return the rows of cells that are set up alike.

    Honest ones are held against the same flight without guards.
    """
    honest = [cell for cell in job if cell.fault.kind is Kind.HONEST]
    unguarded = [replace(cell, forced=UNGUARDED) for cell in honest]
    rows = dict(zip([*job, *unguarded], fly_together([*job, *unguarded], overrides), strict=True))
    for cell, other in zip(honest, unguarded, strict=True):
        must = cell.state in cell.fault.flies_on and not cell.forced.startswith(FAILED)
        rows[cell] = judge_honest(rows[cell], rows[other], must_fly_on=must)
    return [rows[cell] for cell in job]


def faults(args: argparse.Namespace) -> Exit:
    """Break one thing in every state of a mission."""
    find_scenario(args.scenario)
    kinds = set(args.kind or ())
    choices = [("--fault", args.fault, [*{**CASES, **FAULTS}]), ("--state", args.state, [*MOMENTS])]
    choices += [("--kind", kind, list(map(str, Kind))) for kind in kinds]
    doubts = [SUSPECT, *(f"{FAILED}{reason}" for reason in FAILURES)]
    choices.append(("--forced", args.forced or None, doubts))
    for option, given, known in choices:
        if given is not None and given not in known:
            if option == "--fault":
                nearest = suggest(given, known)
                raise ConfigError(option, notice("dev.fault", found=given, nearest=nearest))
            raise ConfigError(option, notice("value.choice", choices=known, found=given))
    if args.forced and kinds != {Kind.HONEST}:
        raise ConfigError("--forced", notice("dev.forced"))
    dealt = deal_cells(args.fault, args.state, args.link)
    work = [cell for cell in dealt if not kinds or cell.fault.kind in kinds]
    if not work:
        raise ConfigError("--state", notice("dev.state", fault=args.fault or "nothing"))
    seeds = range(args.seed, args.seed + args.seeds)
    plan = [
        replace(cell, scenario=args.scenario, seed=seed, forced=args.forced)
        for seed in seeds
        for cell in work
    ]
    with ProgressBar("flights", len(plan), quiet=args.json) as counter:
        flown = fly_all(plan, overrides=args.overrides, workers=args.workers, on_done=counter.at)
    # Of each cell the worst of its seeds.
    rows = [
        max(flown[i :: len(work)], key=lambda row: (not row.safe, row.worst, row.peak_error_m))
        for i in range(len(work))
    ]
    if args.write is not None:
        with refuse_io("--write", "file.unwritten", args.write):
            args.write.write_text(page(rows, typed_command()), "utf-8")
    print(json.dumps({"rows": msgspec.to_builtins(rows)}) if args.json else text(rows))
    return Exit.DONE if is_within(rows) else Exit.FAILED
