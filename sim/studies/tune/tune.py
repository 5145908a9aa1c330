"""The search for gains: optuna's sampler proposes, whole flights judge, what breaks a constraint never wins.

What a set of gains costs is the geometric mean of the RMS errors of its flights. Hard constraints: the law's proof
holds (where the form that flies has one), no flight crashes, and the controller still flies, by the measure of
:mod:`sim.studies.tune.margins`, with so much delay and so wrong a thrust as the floors say, with a tenth in hand.

One trial after the other, its flights side by side; the sampler is seeded anew for each trial. So a search is a
function of its arguments, and one that was interrupted goes on as if it had not been.
"""

import json
import math
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic  # noqa: TID251  # when to stop searching; no flight sees it
from typing import TYPE_CHECKING, Any

import msgspec

from groundstation.config import ConfigError
from sim.studies.campaign import program_sha256
from sim.studies.tune.flights import CRASH_CM, Flyers, SortieOutcome, Staged, sorties
from sim.studies.tune.margins import DELAY, GAIN_DOWN, GAIN_UP, MarginAxis, failure, limit_cm
from sim.studies.tune.search_space import Key, loses_proof, with_gains

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


def words(axis: MarginAxis, value: float) -> str:
    """``extra command delay 22 ms``, ``thrust gain 0.75``."""
    name = axis.label.partition(",")[0]
    return f"{name} {value:.2f}" if axis.direction else f"{name} {1e3 * value:.0f} ms"


def geometric_mean(values: Sequence[float]) -> float:
    """Of positive numbers."""
    return math.exp(sum(map(math.log, values)) / len(values))


def run(
    search: Search,
    flyers: Flyers,
    *,
    trials: int,
    timeout_s: float = math.inf,
    journal: Path | None = None,
    on_trial: Callable[[TuningTrial, TuningTrial], None] = lambda trial, best: None,
) -> list[TuningTrial]:
    """Try until there are ``trials`` sets of gains, or ``timeout_s`` is over; returns them as they were tried.

    With ``journal`` every trial is kept there as soon as it is done, and those that are there are not flown again.
    ``on_trial`` hears each, with the best so far.

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
        take(_next(search, study, flyers, len(done)))
    return done


def _next(search: Search, study: "optuna.Study", flyers: Flyers, number: int) -> TuningTrial:
    from optuna.distributions import FloatDistribution
    from optuna.trial import TrialState, create_trial

    ranges: Any = {key.name: FloatDistribution(key.low, key.high, log=True) for key in search.keys}
    if number == 0:
        trial = try_gains(search, {key.name: key.start for key in search.keys}, flyers, number)
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
            trial = try_gains(search, gains, flyers, number)
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
