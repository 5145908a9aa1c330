"""Equal margins: every law tuned by the same search under the same floors, its best reflown on other seeds.

A comparison of laws with gains of anybody's choice compares the choices: stiffer is closer, until the world is wrong.
Here the gains of each law are searched (:mod:`sim.studies.tune.tune`) with the same number of evaluations, for the
geometric mean of its RMS errors in two scenarios. None may win that does not still fly them with so much more delay, so
wrong a thrust and so wrong a rate lag as :data:`FLOORS` say, that takes more effort than :data:`EFFORT_RAD_S`, or that
fails on rotors. All get our estimate and our inversion of the lags. Each starts from round gains, and is searched
within a factor of :data:`SPREAD` around these.
"""

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from groundstation.analysis.report import figure_class
from groundstation.config import ConfigError
from sim.studies.comparison import STYLES
from sim.studies.tune import (
    DELAY,
    SEARCH_SEED,
    Floors,
    Flyers,
    Key,
    Search,
    SortieOutcome,
    Staged,
    TuningTrial,
    broken_cost,
    failure,
    geometric_mean,
    limit_cm,
    loses_proof,
    report,
    run,
    sorties,
    stage_scenarios,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class SearchedLaw(NamedTuple):
    """One law, and where its search begins."""

    name: str
    kind: str
    start: dict[str, float]
    """Every gain that is searched. Empty: flown as it comes."""


SEARCHED_LAWS = (
    SearchedLaw(
        "adaptive",
        "adaptive",
        {"k2": 2.0, "k3": 4.0, "k3_down": 8.0, "kb": 0.5, "kappa": 15.0, "sigma_slope": 4.0, "rho_slope": 2.0},
    ),
    SearchedLaw("adaptive, as shipped", "adaptive", {}),
    SearchedLaw(
        "geometric",
        "geometric",
        {"k_position": 9.0, "k_velocity": 5.0, "k_integral": 5.0, "coupling": 1.5, "k_attitude": 8.0},
    ),
    SearchedLaw(
        "l1",
        "l1",
        {"k_position": 9.0, "k_velocity": 5.0, "predictor_pole": 0.5, "bandwidth_rad_s": 5.0, "k_attitude": 6.0},
    ),
    SearchedLaw(
        "pid",
        "pid",
        {"p_position": 2.0, "p_velocity": 5.0, "i_velocity": 4.0, "d_velocity": 0.02, "p_attitude": 8.0},
    ),
    SearchedLaw(
        "indi",
        "indi",
        {"k_position": 9.0, "k_velocity": 5.0, "k_acceleration": 0.1, "filter_s": 0.01, "k_attitude": 8.0},
    ),
)
SPREAD = 3.0
"""Each gain is searched from its start over this to its start times this."""
FLOORED = ("paper", "adverse")
"""Judged, and kept flying with what :data:`FLOORS` has wrong."""
ON_ROTORS = ("rotors_mqx", "rotors_mqx_radio")
REFLOWN = ("paper", "fast", "adverse", "storm", "quad1kg", "rotors_mqx_radio")
EFFORT_RAD_S = {"paper": 0.57, "adverse": 0.79}
"""Most that may be commanded, as ``effort_rad_s`` of ``fly --json`` has it: the median over the seeds."""
SCATTER = 1.1
"""What one flight may have more of it in a search."""
ROTORS_CM, ROTORS_SATURATED = 1.0, 0.01
"""On rotors no more error [cm], and no more of the commands at a limit [-]."""
LQG_CM = {"paper": 0.055, "adverse": 0.68}
"""The least that a linear-quadratic-Gaussian regulator was found to reach that knows lags, delays and the spectra of
wind and noise exactly, and still flies with 21.5 ms of extra delay [cm]; no law is told as much."""
TRIALS, SEEDS = 32, 10
DURATION_S = 20.0
"""Of each flight [s]; errors count from 15 s on."""


class Floor(NamedTuple):
    """One thing that is wrong, untold: the value of a field of the world, and of which scenario alone."""

    what: str
    field: str
    value: float
    """Seconds; of a lag or a thrust, true over told."""
    only: str = ""


FLOORS = (
    Floor("21.5 ms more command delay", "command_delay_s", 0.0215),
    Floor("thrust 0.62 of told", "thrust_gain", 0.62, "paper"),
    Floor("thrust 0.70 of told", "thrust_gain", 0.70, "adverse"),
    Floor("rate lag 1.5 of told", "rate_lag_s", 1.5),
    Floor("thrust 1.6 of told", "thrust_gain", 1.6),
    Floor("rate lag 0.5 of told", "rate_lag_s", 0.5),
)


def make_wrong(stage: Staged, floor: Floor) -> Staged:
    """``stage`` in a world that is wrong by ``floor``."""
    world, told = stage.world, stage.config.vehicle
    value = {
        "command_delay_s": world.command_delay_s + floor.value,
        "thrust_gain": floor.value,
        "rate_lag_s": floor.value * told.rate_lag_s,
    }[floor.field]
    return msgspec.structs.replace(stage, world=msgspec.structs.replace(world, **{floor.field: value}))


class EqualTerms:
    """Judges gains for a search; what does not beat the best so far is not put to the floors, as it can't win."""

    def __init__(self, best_cm: float = math.inf) -> None:
        """``best_cm``: the cost to beat."""
        self._best = best_cm

    def __call__(self, search: Search, gains: dict[str, float], flyers: Flyers, number: int) -> TuningTrial:
        """Fly one set of gains."""
        stages = {stage.scenario: stage.with_gains(gains) for stage in search.stages}
        if loses_proof(stages[FLOORED[0]].config.controller):
            return _broken(number, gains, math.inf, "the proof does not hold for these gains", 10.0)

        def fly(chosen: Iterable[Staged]) -> list[SortieOutcome]:
            return flyers.fly([s for one in chosen for s in sorties(one, search.flight_seeds, search.duration_s)])

        plain = dict(zip(FLOORED, fly(stages[name] for name in FLOORED), strict=True))
        rms_cm = geometric_mean([outcome.cost_cm for outcome in plain.values()])
        for name, outcome in plain.items():
            if outcome.rms_cm is None:
                return _broken(number, gains, rms_cm, f"{name}: {outcome.why}", 10.0)
            over = outcome.effort_rad_s / (SCATTER * EFFORT_RAD_S[name])
            if over > 1.0:
                return _broken(number, gains, rms_cm, f"{name}: effort {outcome.effort_rad_s:.2f} rad/s", over)
        if rms_cm >= self._best:
            return TuningTrial(number=number, gains=gains, rms_cm=rms_cm, broken=[], cost=rms_cm)
        for name, outcome in zip(ON_ROTORS, fly(stages[name] for name in ON_ROTORS), strict=True):
            if outcome.rms_cm is None or outcome.rms_cm > ROTORS_CM or outcome.saturated > ROTORS_SATURATED:
                return _broken(number, gains, rms_cm, f"{name}: {outcome.describe()}", outcome.cost_cm)
        for floor in FLOORS:
            held = [name for name in FLOORED if floor.only in ("", name)]
            for name, outcome in zip(held, fly(make_wrong(stages[name], floor) for name in held), strict=True):
                limit = limit_cm([plain[name]])
                assert limit is not None
                if (why := failure([outcome], limit)) is not None:
                    return _broken(number, gains, rms_cm, f"{name}, {floor.what}: {why}", outcome.cost_cm / limit)
        self._best = rms_cm
        return TuningTrial(number=number, gains=gains, rms_cm=rms_cm, broken=[], cost=rms_cm)


def _broken(number: int, gains: dict[str, float], rms_cm: float, why: str, excess: float) -> TuningTrial:
    return TuningTrial(number=number, gains=gains, rms_cm=rms_cm, broken=[why], cost=broken_cost(excess))


class EqualMarginsRow(msgspec.Struct, frozen=True, kw_only=True):
    """One law with its best gains, reflown."""

    law: str
    gains: dict[str, float]
    evaluations: int
    """How many sets of gains were tried; 0: as it comes."""
    keeps: bool
    """Whether it keeps all floors, with the seed of the search, and the effort of the reflown."""
    rms_cm: dict[str, float | None]
    """Scenario to the median over the seeds; None where a flight did not get to its end."""
    effort_rad_s: dict[str, float]
    """The same of the effort, in the two judged scenarios."""
    delay_s: dict[str, float]
    """In these, the extra command delay at which it fails [s]; 0 where it fails without."""


class EqualMargins(NamedTuple):
    """What came of it."""

    trials: dict[str, list[TuningTrial]]
    """Law to all that was tried."""
    rows: list[EqualMarginsRow]


def compare_at_equal_margins(
    flyers: Flyers,
    *,
    trials: int = TRIALS,
    seeds: int = SEEDS,
    laws: Sequence[SearchedLaw] = SEARCHED_LAWS,
    known: dict[str, list[TuningTrial]] | None = None,
    keep: Callable[[dict[str, list[TuningTrial]]], None] = lambda trials: None,
    on_done: Callable[[int], None] = lambda done: None,
) -> EqualMargins:
    """Search the gains of each of ``laws`` with ``trials`` evaluations, and refly the best with ``seeds`` others.

    Laws of which ``known`` has as many evaluations are not searched again, but the best there is judged anew. ``keep``
    is shown all evaluations after each law. ``on_done`` hears how many are done; the flights at the end count as one
    each law.
    """
    searched = dict(known or {})
    rows: list[EqualMarginsRow] = []
    done = 0

    def count() -> None:
        nonlocal done
        done += 1
        on_done(done)

    for law in laws:
        search, kept = _search(law), (known or {}).get(law.name, [])
        if law.start and len(kept) >= trials:
            found = kept[:trials]
            done += trials
        elif law.start:
            found = run(search, flyers, trials=trials, judge=EqualTerms(), on_trial=lambda trial, best: count())
        else:
            found = [EqualTerms()(search, {}, flyers, 0)]
            count()
        searched[law.name] = found
        keep(searched)
        # Of those that keep the floors the best; where none does, the least broken. What a table has is judged anew.
        ranked = sorted(found, key=lambda trial: trial.cost)
        best = ranked[0]
        if law.start and len(kept) >= trials:
            again = (EqualTerms()(search, one.gains, flyers, one.number) for one in ranked if not one.broken)
            best = next((one for one in again if not one.broken), best)
        rows.append(_refly(law, best, len(found), flyers, seeds))
        count()
    return EqualMargins(searched, rows)


def _stages(law: SearchedLaw, scenarios: Sequence[str]) -> list[Staged]:
    lead = [] if law.kind == "adaptive" else ["controller.actuator_compensation=true"]
    stages = stage_scenarios(scenarios, None, [f"controller.kind={law.kind}", *lead])
    if not law.start:
        return stages
    return [stage.with_gains(law.start) for stage in stages]


def _search(law: SearchedLaw) -> Search:
    return Search(
        stages=_stages(law, [*FLOORED, *ON_ROTORS]),
        keys=[Key(name, value / SPREAD, value * SPREAD, value) for name, value in law.start.items()],
        seeds=1,
        duration_s=DURATION_S,
        floors=Floors(delay_s=0.0, gain=0.0),
    )


def _refly(law: SearchedLaw, best: TuningTrial, count: int, flyers: Flyers, seeds: int) -> EqualMarginsRow:
    stages = [stage.with_gains(best.gains) for stage in _stages(law, REFLOWN)]
    outcomes = iter(flyers.fly([s for stage in stages for s in sorties(stage, range(seeds), DURATION_S)]))
    flown = {stage.scenario: [next(outcomes) for _ in range(seeds)] for stage in stages}
    delay_s: dict[str, float] = {}
    for stage in stages:
        if stage.scenario in FLOORED:
            found = report(stage, flyers, seeds=1, duration_s=DURATION_S, axes=(DELAY,)).margins
            delay_s[stage.scenario] = (found[0].fails or found[0].holds) if found else 0.0
    effort_rad_s = {name: median(one.effort_rad_s for one in flown[name]) for name in FLOORED}
    return EqualMarginsRow(
        law=law.name,
        gains=best.gains,
        evaluations=count if law.start else 0,
        keeps=not best.broken and all(effort_rad_s[name] <= most for name, most in EFFORT_RAD_S.items()),
        rms_cm={name: _median([one.rms_cm for one in some]) for name, some in flown.items()},
        effort_rad_s=effort_rad_s,
        delay_s=delay_s,
    )


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if len(known) == len(values) else None


def find_dominators(rows: Sequence[EqualMarginsRow], law: str = "adaptive") -> list[str]:
    """Who is at least as close, as calm and as tolerant of delay as ``law``, and better in one: a sentence each."""
    ours = next((row for row in rows if row.law == law), None)
    said: list[str] = []
    for row in rows:
        if ours is None or row.law.startswith("adaptive") or not row.keeps:
            continue
        for name in FLOORED:
            theirs_cm, ours_cm = row.rms_cm[name], ours.rms_cm[name]
            if theirs_cm is None or ours_cm is None:
                continue
            mine = (ours_cm, ours.effort_rad_s[name], -ours.delay_s[name])
            other = (theirs_cm, row.effort_rad_s[name], -row.delay_s[name])
            if all(a <= b for a, b in zip(other, mine, strict=True)) and other != mine:
                said.append(f"{row.law} dominates {law} in `{name}`")
    return said


COLUMNS = ("law", "evaluation", "rms_cm", "cost", "broken", "gains")


def read_trials(path: Path) -> dict[str, list[TuningTrial]]:
    """What :func:`write_trials` has written; nothing where there is no such file.

    Raises:
        ConfigError: it is no such table.
    """
    found: dict[str, list[TuningTrial]] = {}
    try:
        rows = list(csv.DictReader(path.read_text("utf-8").splitlines())) if path.exists() else []
        for row in rows:
            gains = {name: float(value) for name, _, value in (one.partition("=") for one in row["gains"].split())}
            trial = TuningTrial(
                number=int(row["evaluation"]),
                gains=gains,
                rms_cm=float(row["rms_cm"]),
                broken=[row["broken"]] if row["broken"] else [],
                cost=float(row["cost"]),
            )
            found.setdefault(row["law"], []).append(trial)
    except (OSError, KeyError, ValueError) as error:
        raise ConfigError("--table", f"{path} is no table of evaluations: {error}") from None
    return found


def write_trials(path: Path, trials: dict[str, list[TuningTrial]]) -> None:
    """Every evaluation as a row of CSV.

    Raises:
        ConfigError: the file can't be written.
    """
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            for law, found in trials.items():
                for one in found:
                    gains = " ".join(f"{name}={value:g}" for name, value in one.gains.items())
                    figures = f"{one.rms_cm:.4g}", f"{one.cost:.8g}"
                    writer.writerow([law, one.number, *figures, "; ".join(one.broken), gains])
    except OSError as error:
        raise ConfigError("--table", f"cannot write {path}: {error.strerror}") from None


def equal_margins_table(rows: Sequence[EqualMarginsRow]) -> str:
    """One row a law: RMS errors, effort, delay margin; then its gains."""
    head = ["RMS error, cm", *(f"`{name}`" for name in REFLOWN), "effort, rad/s", "fails at +ms of delay", "keeps"]
    lines = [f"| {' | '.join(head)} |", f"|---|{'---:|' * (len(head) - 1)}"]
    for row in rows:
        cells = [row.law, *("crash" if (e := row.rms_cm[n]) is None else f"{e:.3g}" for n in REFLOWN)]
        cells.append(" / ".join(f"{row.effort_rad_s[name]:.2f}" for name in FLOORED))
        cells.append(" / ".join(f"{1e3 * row.delay_s[name]:.0f}" for name in FLOORED))
        cells.append("all" if row.keeps else "not all")
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "| law | evaluations | gains |", "|---|---:|---|"]
    for row in rows:
        gains = ", ".join(f"{name} {value:.3g}" for name, value in row.gains.items()) or "as they come"
        lines.append(f"| {row.law} | {row.evaluations} | {gains} |")
    said = find_dominators(rows)
    verdict = f"{'; '.join(said)}." if said else "No law that keeps all floors dominates the adaptive one in either."
    return "\n".join(
        [*lines, "", "Effort and delay: `paper` / `adverse`. Dominates: as close, as calm and as tolerant. " + verdict]
    )


def draw_equal_margins(rows: Sequence[EqualMarginsRow]) -> "Figure":
    """RMS error against delay margin and against effort, in the two judged scenarios, with the LQG limit as a line."""
    figure = figure_class()(figsize=(9.5, 7.0), layout="constrained")
    panels: Any = figure.subplots(len(FLOORED), 2, squeeze=False, sharey="row", sharex="col")
    for (left, right), name in zip(panels, FLOORED, strict=True):
        for row in rows:
            if (rms_cm := row.rms_cm[name]) is None:
                continue
            style = STYLES.get(row.law, {"color": "#0072B2", "marker": "*"})
            look: dict[str, Any] = {"linestyle": "none", "markersize": 9, "label": row.law}
            look |= {"color": style["color"], "marker": style["marker"], "fillstyle": "full" if row.keeps else "none"}
            left.plot(1e3 * row.delay_s[name], rms_cm, **look)
            right.plot(row.effort_rad_s[name], rms_cm, **look)
        for panel in (left, right):
            panel.axhline(LQG_CM[name], color="black", linestyle="--", linewidth=1.0, label="LQG limit")
            panel.set_yscale("log")
            panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
            panel.yaxis.set_minor_formatter(lambda value, _: f"{value:g}")
            panel.grid(which="both", color="0.85", linewidth=0.8)
        left.axvline(21.5, color="0.4", linewidth=0.8)
        right.axvline(EFFORT_RAD_S[name], color="0.4", linewidth=0.8)
        left.set_ylabel(f"{name}: RMS error [cm]")
    panels[-1][0].set_xlabel("extra command delay at which it fails [ms]; floor at the grey line")
    panels[-1][1].set_xlabel("effort [rad/s]; no more than the grey line")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=4, loc="outside lower center", frameon=False)
    return figure


def describe_terms(trials: int, seeds: int) -> str:
    """How it was done, as a paragraph."""
    return (
        f"Each law: {trials} evaluations with seed {SEARCH_SEED}, flights of {DURATION_S:g} s, gains within {SPREAD:g} "
        f"times their start either way; then medians of seeds 0 to {seeds - 1}. Floors in `paper` and `adverse`: "
        f"{', '.join(floor.what + (f' ({floor.only})' if floor.only else '') for floor in FLOORS)}; effort at most "
        f"{' / '.join(f'{value:g}' for value in EFFORT_RAD_S.values())} rad/s; on rotors at most {ROTORS_CM:g} cm and "
        f"{100.0 * ROTORS_SATURATED:g} % of commands at a limit."
    )
