"""``groundstation-sim tune``: its arguments, files and output."""

import argparse
import json
import sys
import textwrap
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import ConfigError, refuse_io
from groundstation.core.control import make_controller
from groundstation.core.messages import LEAST_JUDGED_S
from groundstation.machine import fill_markers, replace_between_markers, write_whole
from groundstation.runtime import Exit, require_package
from sim.cli.console import ProgressBar, typed_command
from sim.runs import Flyers, check_duration
from sim.studies.tune import (
    AXES,
    SEARCH_SEED,
    Evidence,
    Floors,
    Search,
    Staged,
    TuningTrial,
    criterion,
    describe_evidence,
    find_best,
    make_station,
    markdown_table,
    report as measured,
    run,
    space,
    stage_scenarios,
    toml,
    verify,
    with_gains,
)
from sim.text import notice

SCENARIOS = ["paper", "adverse"]
"""Default scenarios of a search: one for accuracy, one for robustness."""


def report(args: argparse.Namespace) -> Exit:
    """Print the margins of a configuration.

    Exit code 1 if its flights fail even without any model error.
    """
    stages = _stages(args, SCENARIOS[:1])
    if args.out is not None:
        raise ConfigError("--out", notice("tune.report_out"))
    if args.write is not None:
        fill_markers(args.write, {"figures": ""})
    margins = len(stages) * len(AXES)
    with (
        Flyers(args.workers) as flyers,
        ProgressBar("margins", margins, quiet=args.json) as counter,
    ):
        reports = [
            measured(
                stage,
                flyers,
                seeds=args.seeds,
                duration_s=args.duration,
                on_done=lambda _: counter.step(),
            )
            for stage in stages
        ]
    made = f"{markdown_table(reports)}\n\n{textwrap.fill(criterion(reports[0]))}"
    if args.write is not None:
        replace_between_markers(args.write, f"{made}\n\nMade by `{typed_command()}`.")
    print(json.dumps({"margins": msgspec.to_builtins(reports)}) if args.json else made)
    return Exit.DONE if all(one.limit_cm is not None for one in reports) else Exit.FAILED


def search(args: argparse.Namespace) -> Exit:
    """Search, verify and write; exit code 1 where nothing better was found."""
    _check(args)
    stages = _stages(args, SCENARIOS)
    if any(stage.config.vehicle != stages[0].config.vehicle for stage in stages):
        names = ", ".join(stage.scenario for stage in stages)
        raise ConfigError("--scenarios", notice("tune.vehicles", names=names))
    require_package("optuna", "tune", "tune")
    wanted = Search(
        stages=stages,
        keys=space(stages[0].config.controller, args.keys or []),
        seeds=args.seeds,
        duration_s=args.duration,
        floors=Floors(delay_s=1e-3 * args.delay_margin, gain=0.01 * args.gain_margin),
        sampler_seed=args.seed,
    )
    base = make_station(args.config, args.overrides, stages[0])
    with Flyers(args.workers) as flyers:
        trials = _run_trials(args, wanted, flyers)
        best = find_best(trials)
        if best is None:
            return _report_failure(args, trials)
        evidence = verify(wanted, trials[0], best, flyers, args.verify)
    written = None if evidence.complaints else args.out
    if written is not None:
        tuned = msgspec.structs.replace(base, controller=with_gains(base.controller, best.gains))
        with refuse_io("--out", "file.unwritten", written):
            write_whole(written, toml(tuned, wanted, trials, evidence, typed_command()))
    if args.json:
        print(json.dumps(_facts(trials, best, evidence, written)))
    else:
        print(_text(wanted, trials, best, evidence, written))
    return Exit.FAILED if evidence.complaints else Exit.DONE


def _run_trials(args: argparse.Namespace, wanted: Search, flyers: Flyers) -> list[TuningTrial]:
    """Run the search; tell how an interrupted one continues."""
    with ProgressBar("trials", args.trials, quiet=args.json) as counter:
        try:
            return run(
                wanted,
                flyers,
                trials=args.trials,
                journal=journal_of(args.out),
                on_trial=lambda trial: counter.at(trial.number + 1),
            )
        except KeyboardInterrupt:
            kept = journal_of(args.out)
            says = (
                "nothing is kept of this search: with --out FILE.toml it would be"
                if kept is None
                else f"the trials are kept in {kept}: the same command goes on with them, or with "
                "--trials N ends at N"
            )
            print(says, file=sys.stderr)
            raise


def journal_of(out: Path | None) -> Path | None:
    """Return the file with the trials of a search that writes to ``out``."""
    return None if out is None else out.with_name(f"{out.name}.trials")


def _check(args: argparse.Namespace) -> None:
    """Refuse options that contradict each other, or would overwrite a file."""
    if args.write is not None:
        raise ConfigError("--write", notice("tune.search_write"))
    if args.verify > SEARCH_SEED:
        raise ConfigError("--verify", notice("tune.seeds", most=SEARCH_SEED))
    if (
        args.out is not None
        and args.config is not None
        and args.out.resolve() == args.config.resolve()
    ):
        raise ConfigError("--out", notice("tune.out_is_start", path=args.out))
    if args.out is not None and not args.out.absolute().parent.is_dir():
        raise ConfigError("--out", notice("tune.no_out_folder", path=args.out))
    journal = journal_of(args.out)
    if journal is not None and args.out.exists() and not journal.exists():
        raise ConfigError("--out", notice("tune.out_exists", path=args.out))


def _stages(args: argparse.Namespace, default: list[str]) -> list[Staged]:
    """Return the scenarios to fly, checked as far as possible without a flight."""
    check_duration(args.duration, LEAST_JUDGED_S)
    stages = stage_scenarios(args.scenarios or default, args.config, args.overrides)
    for stage in stages:
        make_controller(stage.config.controller, stage.config.vehicle)
    return stages


def _report_failure(args: argparse.Namespace, trials: list[TuningTrial]) -> Exit:
    """Print why no trial is better than the configuration at the start."""
    start = trials[0]
    if args.json:
        print(json.dumps(_facts(trials, None, None, None)))
    elif start.broken:
        print(
            f"none of {len(trials)} sets of gains keeps the constraints; those there are: "
            f"{'; '.join(start.broken)}"
        )
    else:
        print(
            f"none of {len(trials)} sets of gains is better than those there are "
            f"({start.rms_cm:.3g} cm)"
        )
    return Exit.FAILED


def _facts(
    trials: list[TuningTrial], best: TuningTrial | None, evidence: Evidence | None, out: Path | None
) -> dict[str, Any]:
    return {
        "trials": len(trials),
        "start": msgspec.to_builtins(trials[0]),
        "best": msgspec.to_builtins(best),
        "evidence": msgspec.to_builtins(evidence),
        "written": None if out is None else str(out),
    }


def _text(
    search: Search,
    trials: list[TuningTrial],
    best: TuningTrial,
    evidence: Evidence,
    out: Path | None,
) -> str:
    lines = [f"trial {best.number} of {len(trials)}:", "", *describe_evidence(search, evidence), ""]
    if evidence.complaints:
        lines.append(f"NOT to be used, and not written: {'; '.join(evidence.complaints)}")
    elif out is not None:
        lines.append(f"written to {out}, with this evidence")
    else:
        lines.append("nothing was written: --out FILE.toml would")
    return "\n".join(lines)
