"""``groundstation-sim dev faults``: break one thing, or disturb what is whole."""

import argparse
import json
import os

import msgspec

from groundstation.config import ConfigError
from groundstation.runtime import Exit
from sim.cli import ProgressBar
from sim.scenarios import scenario_of
from sim.text import notice
from tests.proving import faults as deck


def faults(args: argparse.Namespace) -> Exit:
    """Break one thing in every state of a mission."""
    scenario_of(args.scenario)
    kinds = set(args.kind or ())
    cases = list({**deck.CASES, **deck.FAULTS})
    choices = [("--fault", args.fault, cases), ("--state", args.state, list(deck.MOMENTS))]
    choices += [("--kind", kind, list(map(str, deck.Kind))) for kind in args.kind or ()]
    for option, given, known in choices:
        if given is not None and given not in known:
            raise ConfigError(option, notice("value.choice", choices=known, found=given))
    deck.check_forced(args.forced)
    if args.forced and kinds != {deck.Kind.HONEST}:
        raise ConfigError("--forced", notice("dev.forced"))
    cells = deck.deal_cells(args.fault, args.state, args.link)
    work = [cell for cell in cells if not kinds or cell.fault.kind in kinds]
    if not work:
        raise ConfigError("--state", notice("dev.state", fault=args.fault or "nothing"))
    seeds = range(args.seed, args.seed + args.seeds)
    plan = [deck.Planned(cell, args.scenario, seed, args.forced) for seed in seeds for cell in work]
    with ProgressBar("flights", len(plan), quiet=args.json) as counter:
        workers = args.workers or os.cpu_count() or 1
        flown = deck.fly_all(plan, overrides=args.overrides, workers=workers, on_done=counter.at)
    rows = deck.pick_worst([flown[i : i + len(work)] for i in range(0, len(flown), len(work))])
    if args.write is not None:
        deck.write(args.write, rows)
    print(json.dumps({"rows": msgspec.to_builtins(rows)}) if args.json else deck.text(rows))
    return Exit.DONE if deck.is_within(rows) else Exit.FAILED
