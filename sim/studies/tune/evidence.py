"""What tuned gains are worth: flown beside the old ones with seeds that no search sees, and written down."""

import importlib.metadata
import platform
import textwrap
from collections.abc import Iterator
from statistics import median

import msgspec

from groundstation.config import dump
from groundstation.runtime import __version__
from groundstation.settings import Config
from sim.studies.tune.flights import Flyers, sorties
from sim.studies.tune.margins import DELAY, GAIN_DOWN, GAIN_UP, MarginReport, criterion, format_margin, report
from sim.studies.tune.tune import PROBE_SEEDS, Floors, Search, TuningTrial, geometric_mean

VERIFY_S = 60.0
"""Flights that verify last as long as the scenarios' figures are defined for [s]."""
FLOORED = (DELAY, GAIN_UP, GAIN_DOWN)
"""Margins that have floors; the others are for ``tune --report``."""


class Figure(msgspec.Struct, frozen=True, kw_only=True):
    """One scenario with one set of gains, over the seeds that verify."""

    scenario: str
    rms_cm: float | None
    """Median of the RMS errors; None, as the next, where a flight crashed."""
    worst_cm: float | None
    crashed: int


class Side(msgspec.Struct, frozen=True, kw_only=True):
    """One set of gains, verified."""

    gains: dict[str, float]
    mean_cm: float
    """Geometric mean of the RMS errors of all flights; a crash counts 2 m."""
    figures: list[Figure]
    margins: MarginReport
    """Those with floors, in the first scenario."""


class Evidence(msgspec.Struct, frozen=True, kw_only=True):
    """Before and after."""

    seeds: int
    """Flights a scenario, with seeds from 0 on: none that the search has flown."""
    before: Side
    after: Side
    complaints: list[str]
    """Why the gains after are not to be used; empty where they are."""


def verify(search: Search, start: TuningTrial, best: TuningTrial, flyers: Flyers, seeds: int) -> Evidence:
    """Fly the configuration as it came and with the ``best`` gains, with seeds 0 to ``seeds`` - 1 (at most 100)."""
    before, after = _side(search, start.gains, flyers, seeds), _side(search, best.gains, flyers, seeds)
    complaints = [f"{f.scenario}: {f.crashed} of {seeds} flights crashed" for f in after.figures if f.crashed]
    complaints += short_of(search.floors, after.margins)
    if after.mean_cm >= before.mean_cm and not start.broken:
        complaints.append(f"the mean error is {after.mean_cm:.3g} cm, and was {before.mean_cm:.3g} cm")
    return Evidence(seeds=seeds, before=before, after=after, complaints=complaints)


def short_of(floors: Floors, margins: MarginReport) -> list[str]:
    """Which of ``floors`` the measured ``margins`` do not reach."""
    if margins.limit_cm is None:
        return ["it crashes with nothing wrong"]
    held = {margin.name: margin.holds if margin.fails is not None else None for margin in margins.margins}
    short: list[str] = []
    for axis, value in floors.wrongs():
        reached = held.get(axis.name)
        if reached is not None and abs(reached - axis.neutral) < abs(value - axis.neutral):
            short.append(f"{axis.label}: holds {_number(reached)}, not {_number(value)}")
    return short


def _side(search: Search, gains: dict[str, float], flyers: Flyers, seeds: int) -> Side:
    stages = [stage.with_gains(gains) for stage in search.stages]
    work = [sorties(stage, range(seeds), VERIFY_S) for stage in stages]
    outcomes = iter(flyers.fly([sortie for flights in work for sortie in flights]))
    figures: list[Figure] = []
    costs: list[float] = []
    for stage in stages:
        flown = [next(outcomes) for _ in range(seeds)]
        costs += [outcome.cost_cm for outcome in flown]
        errors = [outcome.rms_cm for outcome in flown if outcome.rms_cm is not None]
        whole = len(errors) == seeds
        figures.append(
            Figure(
                scenario=stage.scenario,
                rms_cm=median(errors) if whole else None,
                worst_cm=max(errors) if whole else None,
                crashed=seeds - len(errors),
            )
        )
    few = min(seeds, PROBE_SEEDS)
    margins = report(stages[0], flyers, seeds=few, duration_s=search.duration_s, axes=FLOORED)
    return Side(gains=gains, mean_cm=geometric_mean(costs), figures=figures, margins=margins)


def unverified_toml(config: Config, best: TuningTrial, command: str) -> str:
    """The best so far of a search under way."""
    note = (
        f"The best so far of a search under way (trial {best.number}), NOT VERIFIED: it was only flown with the seeds "
        f"it was searched with. The same command goes on with it: {command}"
    )
    return "\n".join([*_comment(note), "", dump(config)])


def toml(
    config: Config, search: Search, trials: list[TuningTrial], best: TuningTrial, evidence: Evidence, command: str
) -> str:
    """The tuned configuration, with where it comes from and what it is worth as comments."""
    return "\n".join([*_lines(search, trials, best, evidence, command), "", dump(config)])


def _lines(
    search: Search, trials: list[TuningTrial], best: TuningTrial, evidence: Evidence, command: str
) -> Iterator[str]:
    first, last = search.flight_seeds[0], search.flight_seeds[-1]
    scenarios = ", ".join(stage.scenario for stage in search.stages)
    floors = search.floors
    yield from _comment(f"Tuned by: {command}")
    yield from _comment(f"Trial {best.number} of {len(trials)}, sampler seed {search.sampler_seed}. {versions()}.")
    yield "#"
    yield from _comment(
        f"Searched: the geometric mean of the RMS errors, from 15 s on, of flights of {search.duration_s:g} s through "
        f"{scenarios} with seeds {first} to {last}: {trials[0].rms_cm:.3g} cm before, {best.rms_cm:.3g} cm after. "
        f"Constraints: the law's proof, where there is one; no crash; and in {search.stages[0].scenario} it still "
        f"flies with {1e3 * floors.delay_s:g} ms of delay or {100.0 * floors.gain:g} % of thrust that nobody told it "
        "(searched with a tenth more)."
    )
    for key in search.keys:
        yield f"#   {key.name:<16} {_number(key.start):>9} -> {_number(best.gains[key.name]):>9}" + (
            f"   within {_number(key.low)} … {_number(key.high)}"
        )
    yield "#"
    yield from _comment(
        f"Verified with seeds 0 to {evidence.seeds - 1}, none of which the search has seen; flights of {VERIFY_S:g} s. "
        "RMS error: median and worst, cm."
    )
    yield from (f"#   {line}" for line in table(evidence))
    yield "#"
    yield from _comment(
        f"How wrong {search.stages[0].scenario} may be. {criterion(evidence.after.margins)} It fails at:"
    )
    yield from (f"#   {line}" for line in margins_table(evidence))


def table(evidence: Evidence) -> list[str]:
    """Errors before and after, one line a scenario."""
    lines = [f"{'':<24} {'before':>16} {'after':>16}"]
    for old, new in zip(evidence.before.figures, evidence.after.figures, strict=True):
        lines.append(f"{old.scenario:<24} {_errors(old):>16} {_errors(new):>16}")
    mean = (f"{side.mean_cm:.3g}" for side in (evidence.before, evidence.after))
    return [*lines, f"{'geometric mean':<24} {next(mean):>16} {next(mean):>16}"]


def margins_table(evidence: Evidence) -> list[str]:
    """Margins before and after, one line each."""
    sides = [
        {margin.name: format_margin(margin) for margin in side.margins.margins}
        for side in (evidence.before, evidence.after)
    ]
    return [
        f"{axis.label:<24} {sides[0].get(axis.name, '-'):>16} {sides[1].get(axis.name, '-'):>16}" for axis in FLOORED
    ]


def versions() -> str:
    """What made it."""
    others = (f"{name} {importlib.metadata.version(name)}" for name in ("optuna", "numpy"))
    return ", ".join([f"groundstation {__version__}", *others, f"Python {platform.python_version()}"])


def _errors(figure: Figure) -> str:
    if figure.rms_cm is None:
        return f"{figure.crashed} crashed"
    return f"{figure.rms_cm:.2f}, {figure.worst_cm:.2f}"


def _number(value: float) -> str:
    return f"{value:.4g}"


def _comment(text: str) -> list[str]:
    # A path that is broken at a hyphen can't be copied.
    return textwrap.wrap(
        text, 116, initial_indent="# ", subsequent_indent="# ", break_long_words=False, break_on_hyphens=False
    )
