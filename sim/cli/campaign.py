"""What ``groundstation-sim campaign`` does: fly, check against whole flights, draw, sum up."""

import argparse
import json
import os
import sys
from contextlib import AbstractContextManager, nullcontext
from time import perf_counter  # noqa: TID251  # how long it took is for people; no flight sees it

from groundstation.settings import Config
from sim.batch import chosen
from sim.cli.console import Progress
from sim.studies.campaign import USUAL, Campaign, Cluster, Crew, Local, plot, report, run, text, verify
from sim.studies.compare import check_plot
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
    if args.cluster is None and (note := chosen(args.kernel)[1]):
        print(note, file=sys.stderr)
    quiet = args.json or not sys.stderr.isatty()
    with _crew(args.cluster, here) as crew, Progress(args.flights, quiet=quiet, unit="flights", digits=0) as progress:
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
