"""``groundstation-sim campaign`` and ``compare``: many flights drawn and summed up; controllers side by side."""

import argparse
import json
import os
import shlex
import sys
import textwrap
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from time import perf_counter  # noqa: TID251  # how long it took is for people; no flight sees it

import msgspec

from groundstation.config import ConfigError
from groundstation.runtime import replace_between_markers, split_at_markers
from groundstation.settings import Config
from sim.batch import choose_stages
from sim.cli.console import ProgressBar
from sim.studies import check_plot
from sim.studies.campaign import USUAL, Campaign, Cluster, Crew, Local, plot, report, run, text, verify
from sim.world import World


def campaign(args: argparse.Namespace, scenario: str, world: World, config: Config) -> int:
    """Fly ``scenario`` many times, in drawn worlds; 1 where a flight failed or does not agree with ``fly``."""
    shared = Campaign(
        scenario=scenario,
        world=world,
        config=config,
        duration_s=args.duration,
        overrides=args.overrides,
        draws=USUAL if args.draw is None else tuple(args.draw),
        kernel=args.kernel,
    )
    shared.check()  # what can't fly says so before a cluster is called
    if args.plot is not None:
        check_plot(args.plot)
    here = args.workers or os.cpu_count() or 1
    start = perf_counter()
    if args.cluster is None and (note := choose_stages(args.kernel)[1]):
        print(note, file=sys.stderr)
    flyers: AbstractContextManager[Crew] = nullcontext(Local(here)) if args.cluster is None else Cluster(args.cluster)
    with flyers as crew, ProgressBar("flying", args.flights, quiet=args.json, unit="flights") as progress:
        rows, flown = run(
            shared,
            range(args.first_seed, args.first_seed + args.flights),
            crew,
            out=args.out,
            batch=args.batch,
            on_progress=progress.at,
        )
        facts = report(shared, rows, flown=flown, wall_s=perf_counter() - start, workers=crew.workers)
    if args.verify:
        facts["verified"] = verify(shared, rows, args.verify, workers=here)
    if args.plot is not None:
        plot(args.plot, shared, rows)
    print(json.dumps(facts) if args.json else text(facts))
    agree = not args.verify or not facts["verified"]["apart"]
    return 0 if agree and all(row.survived for row in rows) else 1


def compare(args: argparse.Namespace) -> int:
    """Fly controllers side by side."""
    from sim.studies import CONTROLLERS, text_table, write_between_markers
    from sim.studies import compare as fly_side_by_side
    from sim.studies import plot as draw

    if args.plot is not None:
        check_plot(args.plot)
    if args.write is not None:
        split_at_markers(args.write)
    if args.equal_margins:
        return _at_equal_margins(args)
    if args.table is not None or args.trials is not None:
        raise ConfigError("--table" if args.table is not None else "--trials", "is for --equal-margins")
    with ProgressBar("flights", quiet=args.json) as bar:
        try:
            found = fly_side_by_side(
                args.controllers or CONTROLLERS,
                scenarios=args.scenarios or None,
                seeds=args.seeds,
                duration=args.duration,
                overrides=args.overrides,
                workers=args.workers or os.cpu_count() or 1,
                traced=args.plot is not None,
                on_done=bar.at,
            )
        except ConfigError as error:
            if error.key != "controller.kind" or args.controllers is None:
                raise
            raise ConfigError("--controllers", error.problem) from None
    if args.plot is not None:
        draw(args.plot, found.rows, found.flights)
    if args.write is not None:
        write_between_markers(args.write, found.rows, _comparison(args))
    print(json.dumps({"rows": msgspec.to_builtins(found.rows)}) if args.json else text_table(found.rows))
    return 0


def _at_equal_margins(args: argparse.Namespace) -> int:
    """Tune every law under the same floors, and refly the best of each."""
    from sim.cli.tune import need_optuna
    from sim.studies import (
        SEARCHED_LAWS,
        TRIALS,
        compare_at_equal_margins,
        describe_terms,
        draw_equal_margins,
        equal_margins_table,
        read_trials,
        write_trials,
    )
    from sim.studies.tune import Flyers

    need_optuna()
    for option in ("scenarios", "overrides"):
        if getattr(args, option):
            raise ConfigError(f"--{option}".replace("overrides", "set"), "is told by --equal-margins itself")
    args.trials = args.trials or TRIALS
    known = {law.name.partition(",")[0] for law in SEARCHED_LAWS}
    for name in args.controllers or ():
        if name not in known:
            raise ConfigError("--controllers", f"expected some of {sorted(known)}, got {name!r}")
    laws = [law for law in SEARCHED_LAWS if not args.controllers or law.name.partition(",")[0] in args.controllers]
    table: Path | None = args.table
    steps = sum(args.trials + 1 if law.start else 2 for law in laws)
    workers = args.workers or os.cpu_count() or 1
    with Flyers(workers) as flyers, ProgressBar("evaluations", steps, quiet=args.json) as progress:
        found = compare_at_equal_margins(
            flyers,
            trials=args.trials,
            seeds=args.seeds,
            laws=laws,
            known=read_trials(table) if table is not None else None,
            keep=lambda tried: None if table is None else write_trials(table, tried),
            on_done=progress.at,
        )
    if args.plot is not None:
        draw_equal_margins(found.rows).savefig(args.plot, dpi=150)
    shown = f"{equal_margins_table(found.rows)}\n\n{textwrap.fill(describe_terms(args.trials, args.seeds), 118)}"
    if args.write is not None:
        replace_between_markers(args.write, shown)
    print(json.dumps({"rows": msgspec.to_builtins(found.rows)}) if args.json else shown)
    return 0


def _comparison(args: argparse.Namespace) -> str:
    """The command that makes this comparison's table, and its picture, again in the folder of ``--write``."""
    words = ["groundstation-sim", "compare"]
    for option in ("scenarios", "controllers"):
        names = getattr(args, option)
        words += [f"--{option}", ",".join(names)] if names else []
    words += ["--seeds", str(args.seeds)]
    words += ["--duration", f"{args.duration:g}"] if args.duration != 60.0 else []
    for override in args.overrides:
        words += ["--set", override]
    if args.plot is not None:
        plot = os.path.relpath(args.plot.absolute(), args.write.absolute().parent)
        words += ["--plot", Path(plot).as_posix()]
    return shlex.join([*words, "--write", args.write.name])
