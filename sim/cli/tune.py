"""``groundstation-sim tune``: what the command does with its words, its files and its answer."""

import argparse
import json
import math
import os
import shlex
import sys
import textwrap
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import ConfigError, refuse_io
from groundstation.core.control import make_controller
from groundstation.core.messages import STEADY_S
from groundstation.machine import replace_between_markers, split_at_markers, write_whole
from groundstation.runtime import Exit, describe_install
from groundstation.settings import Config
from sim.cli.console import ProgressBar
from sim.studies.tune import (
    AXES,
    SEARCH_SEED,
    Evidence,
    Floors,
    Flyers,
    Search,
    Staged,
    TuningTrial,
    criterion,
    margins_table,
    markdown_table,
    own,
    run,
    space,
    stage_scenarios,
    station_of,
    table,
    text,
    toml,
    unverified_toml,
    verify,
)
from sim.studies.tune import report as measured

SCENARIOS = ["paper", "adverse"]
"""Default scenarios of a search: one for accuracy, one for robustness."""


def report(args: argparse.Namespace) -> Exit:
    """Print the margins of a configuration; 1 where it fails with nothing wrong."""
    stages = _stages(args, SCENARIOS[:1])
    if args.out is not None:
        raise ConfigError("--out", "a report writes no configuration; --write puts it into a document")
    if args.write is not None:
        split_at_markers(args.write)
    margins = len(stages) * len(AXES)
    with Flyers(_workers(args)) as flyers, ProgressBar("margins", margins, quiet=args.json) as counter:
        reports = [
            measured(stage, flyers, seeds=args.seeds, duration_s=args.duration, on_found=counter.step)
            for stage in stages
        ]
    if args.write is not None:
        made = textwrap.fill(criterion(reports[0]), 118)
        replace_between_markers(args.write, f"{markdown_table(reports)}\n\n{made}\nMade by `{_command()}`.")
    if args.json:
        print(json.dumps({"margins": msgspec.to_builtins(reports)}))
    else:
        print("\n\n".join(map(text, reports)))
    return Exit.DONE if all(one.limit_cm is not None for one in reports) else Exit.FAILED


def search(args: argparse.Namespace) -> Exit:
    """Search, verify and write; 1 where nothing better was found."""
    _check(args)
    stages = _stages(args, SCENARIOS)
    if any(stage.config.vehicle != stages[0].config.vehicle for stage in stages):
        names = ", ".join(stage.scenario for stage in stages)
        raise ConfigError("--scenarios", f"{names} have different vehicles; name the one to tune for with --config")
    need_optuna()
    wanted = Search(
        stages=stages,
        keys=space(stages[0].config.controller, args.keys or []),
        seeds=args.seeds,
        duration_s=args.duration,
        floors=Floors(delay_s=1e-3 * args.delay_margin, gain=0.01 * args.gain_margin),
        sampler_seed=args.seed,
    )
    base = own(args.config, args.overrides) or station_of(stages[0])
    keeper = _Keeper(base, args.out)
    with Flyers(_workers(args)) as flyers:
        trials = _run_trials(args, wanted, flyers, keeper)
        best = keeper.best
        if best is None:
            return _nothing(args, trials)
        evidence = verify(wanted, trials[0], best, flyers, args.verify)
    written = None if evidence.complaints else args.out
    if written is not None:
        _write(written, toml(keeper.config(best), wanted, trials, best, evidence, _command()))
    elif args.out is not None:
        args.out.unlink(missing_ok=True)
    if args.json:
        print(json.dumps(_facts(trials, best, evidence, written)))
    else:
        print(_text(wanted, trials, best, evidence, written))
    return Exit.FAILED if evidence.complaints else Exit.DONE


def _run_trials(args: argparse.Namespace, wanted: Search, flyers: Flyers, keeper: "_Keeper") -> list[TuningTrial]:
    """Run the search; ``keeper`` has the best trial so far, also when it is interrupted."""
    with ProgressBar("trials", args.trials, quiet=args.json) as counter:

        def show_trial(trial: TuningTrial, best: TuningTrial) -> None:
            counter.at(trial.number + 1)
            keeper.keep(trial, best)

        try:
            return run(
                wanted,
                flyers,
                trials=args.trials,
                timeout_s=math.inf if args.timeout is None else args.timeout,
                journal=journal_of(args.out),
                on_trial=show_trial,
            )
        except KeyboardInterrupt:
            print(keeper.interrupted, file=sys.stderr)
            raise


def need_optuna() -> None:
    """Before anything flies.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import optuna as _  # noqa: F401  # only whether it is there
    except ImportError:
        raise ConfigError("tune", f"needs optuna, which is not installed: {describe_install('tune')}") from None


def journal_of(out: Path | None) -> Path | None:
    """Where the trials of a search are kept that writes to ``out``."""
    return None if out is None else out.with_name(f"{out.name}.trials")


class _Keeper:
    """Holds the best trial, and its configuration on disk from the moment that it is found."""

    def __init__(self, base: Config, out: Path | None) -> None:
        self._base = base
        self._out = out
        self.best: TuningTrial | None = None
        """The best that beats the configuration as it came."""

    @property
    def interrupted(self) -> str:
        """Describe the results that an interrupted search leaves."""
        if self._out is None:
            return "nothing is kept of this search: with --out FILE.toml it would be"
        best = f"the best so far is in {self._out}, not verified" if self.best is not None else "none is better so far"
        return f"the trials are kept in {journal_of(self._out)}: the same command goes on with them; {best}"

    def config(self, best: TuningTrial) -> Config:
        """The configuration with the gains of ``best``."""
        from sim.studies.tune import with_gains

        return msgspec.structs.replace(self._base, controller=with_gains(self._base.controller, best.gains))

    def keep(self, trial: TuningTrial, best: TuningTrial) -> None:
        """``trial`` has been tried; ``best`` is the best so far."""
        if trial is best and trial.number > 0:
            self.best = best
            if self._out is not None:
                _write(self._out, unverified_toml(self.config(best), best, _command()))


def _check(args: argparse.Namespace) -> None:
    if args.write is not None:
        raise ConfigError("--write", "is for --report; a search writes to --out FILE.toml")
    if args.verify > SEARCH_SEED:
        raise ConfigError("--verify", f"expected at most {SEARCH_SEED}: the seeds after these are the search's own")
    if args.out is not None and args.config is not None and args.out.resolve() == args.config.resolve():
        raise ConfigError("--out", f"{args.out} is the configuration to start from; take another name")
    if args.out is not None and not args.out.absolute().parent.is_dir():
        raise ConfigError("--out", f"cannot write {args.out}: there is no such folder")
    journal = journal_of(args.out)
    if journal is not None and args.out.exists() and not journal.exists():
        raise ConfigError("--out", f"{args.out} is there already, and no search has written it; take another name")


def _stages(args: argparse.Namespace, default: list[str]) -> list[Staged]:
    """The scenarios to fly, checked as far as that goes without flying."""
    if args.duration <= STEADY_S + 1.0:
        raise ConfigError("--duration", f"expected more than {STEADY_S + 1:g} s, as flights are judged from then on")
    stages = stage_scenarios(args.scenarios or default, args.config, args.overrides)
    for stage in stages:
        make_controller(stage.config.controller, stage.config.vehicle)
    return stages


def _workers(args: argparse.Namespace) -> int:
    return int(args.workers or os.cpu_count() or 1)


def _command() -> str:
    return shlex.join(["groundstation-sim", *sys.argv[1:]])


def _write(path: Path, content: str) -> None:
    with refuse_io("--out", f"cannot write {path}"):
        write_whole(path, content)


def _nothing(args: argparse.Namespace, trials: list[TuningTrial]) -> Exit:
    """Nothing beats the configuration as it came: say why, as far as that is known."""
    start = trials[0]
    if args.json:
        print(json.dumps(_facts(trials, None, None, None)))
    elif start.broken:
        print(f"none of {len(trials)} sets of gains keeps the constraints; those there are: {'; '.join(start.broken)}")
    else:
        print(f"none of {len(trials)} sets of gains is better than those there are ({start.rms_cm:.3g} cm)")
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


def _text(search: Search, trials: list[TuningTrial], best: TuningTrial, evidence: Evidence, out: Path | None) -> str:
    lines = [f"trial {best.number} of {len(trials)}:"]
    for key in search.keys:
        lines.append(f"    controller.{key.name} = {best.gains[key.name]:g}  # was {key.start:g}")
    lines += ["", f"RMS error, median and worst of {evidence.seeds} flights that no search has seen, cm:"]
    lines += table(evidence)
    lines += ["", f"fails at, in {search.stages[0].scenario}:", *margins_table(evidence), ""]
    if evidence.complaints:
        lines.append(f"NOT to be used, and not written: {'; '.join(evidence.complaints)}")
    elif out is not None:
        lines.append(f"written to {out}, with this evidence")
    else:
        lines.append("nothing was written: --out FILE.toml would")
    return "\n".join(lines)
