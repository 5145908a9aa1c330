"""What ``groundstation-sim compare`` does: controllers side by side, as a table and a picture."""

import argparse
import json
import os
import shlex
import sys
from pathlib import Path

import msgspec

from groundstation.config import ConfigError
from sim.scenarios import SCENARIOS, prepare


def compare(args: argparse.Namespace) -> int:
    """Fly controllers side by side."""
    from groundstation.core.control import make_controller
    from sim.cli.console import Counter
    from sim.runs import STEADY_S
    from sim.studies.compare import (
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
    with Counter("flights", len(work) * args.seeds, quiet=args.json or not sys.stderr.isatty()) as counter:
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
