"""``groundstation-sim dev faults`` and ``honest``: break one thing, or disturb what is whole."""

import argparse
import json
import os
import shlex
import sys
from collections.abc import Collection, Sequence

import msgspec

from groundstation.config import ConfigError
from groundstation.runtime import Exit
from sim.cli import ProgressBar
from sim.scenarios import scenario_of
from tests.proving.faults import (
    CASES,
    FAULTS,
    MOMENTS,
    Kind,
    Planned,
    Row,
    check_forced,
    deal_cells,
    fly_all,
    is_within,
    name_of,
    pick_worst,
    plan_honest,
    tell_honest,
    text,
    write,
    write_csv,
)


def faults(args: argparse.Namespace) -> Exit:
    """Break one thing in every state of a mission."""
    scenario_of(args.scenario)
    known = {**CASES, **FAULTS}
    _check_choice("--fault", args.fault, known)
    _check_choice("--state", args.state, MOMENTS)
    if args.seeds < 1:
        raise ConfigError("--seeds", f"expected 1 or more, got {args.seeds}")
    kinds = _read_kinds(args.kind)
    work = [cell for cell in deal_cells(args.fault, args.state, args.link) if not kinds or cell.fault.kind in kinds]
    if not work:
        raise ConfigError("--state", f"{args.fault or 'nothing'} is not flown there")
    seeds = range(args.seed, args.seed + args.seeds)
    plan = [Planned(cell, args.scenario, seed) for seed in seeds for cell in work]
    flown = _fly(plan, args)
    rows = pick_worst([flown[i : i + len(work)] for i in range(0, len(flown), len(work))])
    if args.write is not None:
        left_out = {"--json", "--workers", str(args.workers), "--csv", str(args.csv), str(args.write)}
        words = [word for word in sys.argv[1:] if word not in left_out]
        write(args.write, rows, shlex.join(["groundstation-sim", *words]))
    print(json.dumps({"rows": msgspec.to_builtins(rows)}) if args.json else text(rows))
    return Exit.DONE if is_within(rows) else Exit.FAILED


def _fly(plan: Sequence[Planned], args: argparse.Namespace) -> list[Row]:
    """Return the rows of ``plan``; written as CSV, too, where that is asked for."""
    with ProgressBar("flights", len(plan), quiet=args.json) as counter:
        workers = args.workers or os.cpu_count() or 1
        rows = fly_all(plan, overrides=args.overrides, workers=workers, on_done=counter.at)
    if args.csv is not None:
        write_csv(args.csv, rows)
    return rows


def _check_choice(option: str, given: str | None, known: Collection[str]) -> None:
    if given is not None and given not in known:
        raise ConfigError(option, f"expected one of {list(known)}, got {given!r}")


def _read_kinds(given: Sequence[str] | None) -> set[str]:
    """Return the kinds of rows that are asked for; empty for all."""
    for kind in given or ():
        _check_choice("--kind", kind, [str(one) for one in Kind])
    return set(given or ())


def honest(args: argparse.Namespace) -> Exit:
    """Disturb flights whose poses are true, and hold them against the same without guards."""
    for scenario in args.scenarios:
        scenario_of(scenario)
    for state in args.states:
        _check_choice("--states", state, MOMENTS)
    cases = [case for case, fault in CASES.items() if fault.kind is Kind.HONEST]
    for one in args.only:
        _check_choice("--only", one, dict.fromkeys((*map(name_of, cases), *cases)))
    check_forced(args.forced)
    plan = plan_honest(
        scenarios=args.scenarios,
        links=args.links,
        states=args.states,
        seeds=range(args.seed, args.seed + args.seeds),
        only=[case for case in cases if {case, name_of(case)} & set(args.only)],
        forced=args.forced,
    )
    rows = _fly(plan, args)
    print(json.dumps({"rows": msgspec.to_builtins(rows)}) if args.json else tell_honest(rows))
    return Exit.DONE if all(row.safe for row in rows) else Exit.FAILED
