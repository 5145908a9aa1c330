"""Search for gains: optuna's sampler proposes, whole flights judge, what breaks a constraint never wins.

What a set of gains costs is the geometric mean of the RMS errors of its flights. Hard constraints: the law's proof
holds (where the form that flies has one), no flight crashes, and the controller still flies, by the measure of
:mod:`sim.studies.tune.flights`, with so much delay and so wrong a thrust as the floors say, with a tenth in hand.

One trial after the other, its flights side by side; the sampler is seeded anew for each trial. So a search is a
function of its arguments, and one that was interrupted goes on as if it had not been. The evidence that is written
down: tuned gains flown beside the old ones with seeds that no search sees.
"""

import importlib.metadata
import json
import math
import platform
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from time import monotonic  # noqa: TID251  # when to stop searching; no flight sees it
from typing import TYPE_CHECKING, Any, TypeAlias

import msgspec

from groundstation.config import ConfigError, dump
from groundstation.runtime import __version__
from groundstation.settings import Config
from sim.studies.campaign import program_sha256
from sim.studies.tune.flights import (
    CRASH_CM,
    DELAY,
    GAIN_DOWN,
    GAIN_UP,
    Flyers,
    Key,
    MarginAxis,
    MarginReport,
    SortieOutcome,
    Staged,
    criterion,
    failure,
    format_margin,
    limit_cm,
    loses_proof,
    report,
    sorties,
    with_gains,
)

if TYPE_CHECKING:
    import optuna


SEARCH_SEED = 100
"""The first seed of the flights that a search sees. Figures are verified on seeds from 0 to 99."""
IN_HAND = 1.1
"""A search keeps its floors with this factor, so that they also hold in flights that it has not seen."""
PROBE_SEEDS = 2
"""Seeds that fly with something wrong, of those that fly with nothing wrong."""
PROPOSALS = 1000
"""Proposals for one trial; those that lose the proof are thrown away."""
RANDOM_TRIALS = 10
"""Drawn over the whole space before the sampler learns from them."""
BROKEN, UNPROVEN = 1e3, 1e6
"""What a broken constraint costs, on top of how badly it is broken: more than any flight."""


class Floors(msgspec.Struct, frozen=True, kw_only=True):
    """Margins that tuned gains must have, in the first scenario."""

    delay_s: float
    """Command delay beyond what is told [s]; 0 asks for none."""
    gain: float
    """Share by which the thrust may be wrong, either way, 0 to below 1; 0 asks for none."""

    def wrongs(self, factor: float = 1.0) -> list[tuple[MarginAxis, float]]:
        """What must still fly: each axis with its value, the floors being ``factor`` times what they are."""
        delay = [(DELAY, self.delay_s * factor)] if self.delay_s else []
        share = min(self.gain * factor, 0.99)
        return [*delay, (GAIN_DOWN, 1.0 - share), (GAIN_UP, 1.0 + share)] if share else delay


class Search(msgspec.Struct, frozen=True, kw_only=True):
    """What is searched, and how it is judged."""

    stages: list[Staged]
    keys: list[Key]
    seeds: int
    duration_s: float
    floors: Floors
    sampler_seed: int = 0

    @property
    def flight_seeds(self) -> list[int]:
        """The seeds of its flights."""
        return list(range(SEARCH_SEED, SEARCH_SEED + self.seeds))

    def settings(self) -> dict[str, Any]:
        """What makes two trials comparable."""
        found: dict[str, Any] = json.loads(msgspec.json.encode(self))
        return {**found, "program_sha256": program_sha256()}


class TuningTrial(msgspec.Struct, frozen=True, kw_only=True):
    """One set of gains, tried."""

    number: int
    """From 0, which is the configuration as it came."""
    gains: dict[str, float]
    rms_cm: float
    """Geometric mean of the RMS errors of its flights with nothing wrong; a crash counts 2 m."""
    broken: list[str]
    """The constraints it breaks, as sentences; empty for one that may fly."""
    cost: float
    """What the sampler hears: ``rms_cm``, or more than any of those."""

    def beats(self, other: "TuningTrial") -> bool:
        """It breaks nothing, and is better."""
        return not self.broken and self.cost < other.cost


def try_gains(search: Search, gains: dict[str, float], flyers: Flyers, number: int) -> TuningTrial:
    """Fly one set of gains; not at all where it loses the proof."""
    stages = [stage.with_gains(gains) for stage in search.stages]
    if loses_proof(stages[0].config.controller):
        why = ["the proof does not hold for these gains"]
        return TuningTrial(number=number, gains=gains, rms_cm=CRASH_CM, broken=why, cost=UNPROVEN)
    first, seeds = stages[0], search.flight_seeds
    plain = [sorties(stage, seeds, search.duration_s) for stage in stages]
    probes = [
        (axis, value, sorties(axis.wrong(first, value), seeds[:PROBE_SEEDS], search.duration_s))
        for axis, value in search.floors.wrongs(IN_HAND)
    ]
    outcomes = iter(flyers.fly([sortie for work in (*plain, *(probe[2] for probe in probes)) for sortie in work]))
    flown = [[next(outcomes) for _ in work] for work in plain]
    probed = [(axis, value, [next(outcomes) for _ in work]) for axis, value, work in probes]
    return _judge(search, gains, flown, probed, number)


def _judge(
    search: Search,
    gains: dict[str, float],
    flown: list[list[SortieOutcome]],
    probed: list[tuple[MarginAxis, float, list[SortieOutcome]]],
    number: int,
) -> TuningTrial:
    rms_cm = geometric_mean([outcome.cost_cm for outcomes in flown for outcome in outcomes])
    broken: list[str] = []
    excess = 0.0
    for stage, outcomes in zip(search.stages, flown, strict=True):
        crashes = [outcome.why for outcome in outcomes if outcome.rms_cm is None]
        broken += [f"{stage.scenario}: {crashes[0]}"] if crashes else []
        excess += 10.0 * len(crashes)
    limit = limit_cm(flown[0])
    for axis, value, outcomes in probed:
        why = failure(outcomes, limit) if limit is not None else None
        if why is not None and limit is not None:
            broken.append(f"{words(axis, value)}: {why}")
            excess += math.log(max(max(outcome.cost_cm for outcome in outcomes) / limit, 1.0))
    cost = BROKEN + excess if broken else rms_cm
    return TuningTrial(number=number, gains=gains, rms_cm=rms_cm, broken=broken, cost=cost)


def broken_cost(excess: float) -> float:
    """What the sampler hears of gains that break a constraint by ``excess``: more than of any that do not."""
    return BROKEN + math.log(max(excess, 1.0))


def words(axis: MarginAxis, value: float) -> str:
    """``extra command delay 22 ms``, ``thrust gain 0.75``."""
    name = axis.label.partition(",")[0]
    return f"{name} {value:.2f}" if axis.direction else f"{name} {1e3 * value:.0f} ms"


def geometric_mean(values: Sequence[float]) -> float:
    """Of positive numbers."""
    return math.exp(sum(map(math.log, values)) / len(values))


Judge: TypeAlias = Callable[[Search, dict[str, float], Flyers, int], TuningTrial]
"""Flies one set of gains, the how-manieth of its search, and says what it is worth."""


def run(
    search: Search,
    flyers: Flyers,
    *,
    trials: int,
    timeout_s: float = math.inf,
    journal: Path | None = None,
    judge: Judge | None = None,
    on_trial: Callable[[TuningTrial, TuningTrial], None] = lambda trial, best: None,
) -> list[TuningTrial]:
    """Try until there are ``trials`` sets of gains, or ``timeout_s`` is over; returns them as they were tried.

    With ``journal`` every trial is kept there as soon as it is done, and those that are there are not flown again.
    ``judge`` flies each set of gains and says what it is worth: :func:`try_gains`, or as it. ``on_trial`` hears each,
    with the best so far.

    Raises:
        ConfigError: the journal can't be used, or holds another search.
    """
    began = monotonic()
    study = _study(search, journal)
    done: list[TuningTrial] = []
    best: TuningTrial | None = None

    def take(trial: TuningTrial) -> None:
        nonlocal best
        done.append(trial)
        best = trial if best is None or trial.beats(best) else best
        on_trial(trial, best)

    for kept in study.get_trials(deepcopy=False):
        if "trial" in kept.user_attrs:
            take(msgspec.convert(kept.user_attrs["trial"], TuningTrial))
    while len(done) < trials and (not done or monotonic() - began < timeout_s):
        take(_next(search, study, flyers, len(done), judge or try_gains))
    return done


def _next(search: Search, study: "optuna.Study", flyers: Flyers, number: int, judge: Judge) -> TuningTrial:
    from optuna.distributions import FloatDistribution
    from optuna.trial import TrialState, create_trial

    ranges: Any = {key.name: FloatDistribution(key.low, key.high, log=True) for key in search.keys}
    if number == 0:
        trial = judge(search, {key.name: key.start for key in search.keys}, flyers, number)
        inside = {key.name: min(max(key.start, key.low), key.high) for key in search.keys}
        kept = {"trial": msgspec.to_builtins(trial)}
        study.add_trial(create_trial(params=inside, distributions=ranges, value=trial.cost, user_attrs=kept))
        return trial
    for attempt in range(PROPOSALS):
        study.sampler = _sampler((search.sampler_seed * 1_000_003 + number) * PROPOSALS + attempt)
        asked = study.ask(ranges)
        gains = {key.name: key.round(asked.params[key.name]) for key in search.keys}
        try:
            if loses_proof(with_gains(search.stages[0].config.controller, gains)):
                study.tell(asked, state=TrialState.FAIL)
                continue
            trial = judge(search, gains, flyers, number)
        except BaseException:
            study.tell(asked, state=TrialState.FAIL)
            raise
        asked.set_user_attr("trial", msgspec.to_builtins(trial))
        study.tell(asked, trial.cost)
        return trial
    raise ConfigError("--keys", f"the proof holds for none of {PROPOSALS} draws between these bounds")


def _sampler(seed: int) -> "optuna.samplers.BaseSampler":
    from optuna.samplers import TPESampler

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gains depend on each other, and it warns that looking at that is new
        return TPESampler(seed=seed, multivariate=True, n_startup_trials=RANDOM_TRIALS)


def _study(search: Search, journal: Path | None) -> "optuna.Study":
    import optuna
    from optuna.storages import InMemoryStorage, JournalStorage
    from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    now = search.settings()
    try:
        storage = InMemoryStorage() if journal is None else JournalStorage(JournalFileBackend(str(journal)))
        study = optuna.create_study(storage=storage, study_name="tune", load_if_exists=True)
        before = study.user_attrs.get("settings")
    except OSError as error:
        raise ConfigError("--out", f"cannot use {journal}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError, AssertionError):
        raise ConfigError("--out", f"{journal} is no journal of a search") from None
    if before is None:
        study.set_user_attr("settings", now)
    elif before != now:
        changed = sorted(key for key in now if before.get(key) != now[key])
        raise ConfigError(
            "--out",
            f"the trials in {journal} were made with other {', '.join(changed)}; take another file, or delete it",
        )
    return study


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
