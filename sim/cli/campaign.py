"""``groundstation-sim campaign`` and ``compare``: many flights drawn and summed up; controllers side by side."""

import argparse
import json
import os
import shlex
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from time import perf_counter  # noqa: TID251  # how long it took is for people; no flight sees it

import msgspec

from groundstation.config import ConfigError
from groundstation.settings import Config
from sim.batch import choose_stages
from sim.cli.console import ProgressBar
from sim.scenarios import SCENARIOS, prepare
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
    quiet = args.json or not sys.stderr.isatty()
    with (
        _crew(args.cluster, here) as crew,
        ProgressBar("flying", args.flights, quiet=quiet, unit="flights") as progress,
    ):
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


def _crew(address: str | None, workers: int) -> AbstractContextManager[Crew]:
    return Cluster(address) if address is not None else nullcontext(Local(workers))


def compare(args: argparse.Namespace) -> int:
    """Fly controllers side by side."""
    from groundstation.core.control import make_controller
    from sim.runs import STEADY_S
    from sim.studies import (
        CONTROLLERS,
        cases,
        check_markers,
        check_plot,
        fly_all,
        plot,
        rows,
        text_table,
        write_between_markers,
    )

    if args.duration <= STEADY_S + 1.0:
        raise ConfigError(
            "--duration", f"expected more than {STEADY_S + 1:g} s, as figures are taken from {STEADY_S:g} s"
        )
    for name in args.scenarios or ():
        if name not in SCENARIOS:
            raise ConfigError("--scenarios", f"expected some of {sorted(SCENARIOS)}, got {name!r}")
    work = cases(args.scenarios or SCENARIOS, args.controllers or CONTROLLERS, args.overrides)
    for case in work:  # what can't fly says so before anything flies
        _, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
        make_controller(config.controller, config.vehicle)
    if args.plot is not None:
        check_plot(args.plot)
    if args.write is not None:
        check_markers(args.write)
    with ProgressBar("flights", len(work) * args.seeds, quiet=args.json or not sys.stderr.isatty()) as counter:
        flights = fly_all(
            work,
            args.seeds,
            args.duration,
            workers=args.workers or os.cpu_count() or 1,
            traced=args.plot is not None,
            on_done=counter.at,
        )
    table = rows(flights)
    if args.plot is not None:
        plot(args.plot, table, flights)
    if args.write is not None:
        write_between_markers(args.write, table, _comparison(args))
    print(json.dumps({"rows": msgspec.to_builtins(table)}) if args.json else text_table(table))
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
