"""Comparison: controllers side by side in the same scenarios, with the same seeds, estimator and
wire bytes.

At equal margins the gains of each law are searched (:mod:`sim.studies.tune.tune`) with the same
number of evaluations, for the geometric mean of its RMS errors in two scenarios, and its best
reflown on other seeds. None may win that does not fly them with what :data:`FLOORS` have wrong,
that takes more effort than :data:`EFFORT_RAD_S`, or that fails on rotors. All get our estimate and
our inversion of the lags, and start from round gains.
"""

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from groundstation.analysis.report import figure_class
from groundstation.config import ConfigError, lend, several, without_frames
from groundstation.core.control import make_controller
from groundstation.core.messages import LEAST_JUDGED_S
from groundstation.core.vehicle import Vehicle
from groundstation.machine import replace_between_markers
from groundstation.runtime import require_package
from sim.runs import (
    DURATION_S,
    FlightVerdict,
    Flyers,
    check_duration,
    check_whole,
    fly,
    lend_name,
    run_beside,
)
from sim.scenarios import SCENARIOS, overridden, prepare
from sim.studies.tune import (
    DELAY,
    IN_HAND,
    SEARCH_SEED,
    Floors,
    Key,
    Search,
    SortieOutcome,
    Staged,
    TuningTrial,
    broken_cost,
    failure,
    fly_sortie,
    geometric_mean,
    limit_cm,
    loses_proof,
    report,
    run,
    sorties,
    stage_scenarios,
)
from sim.text import notice
from sim.world import World

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


CONTROLLERS = ("adaptive", "uncompensated", "geometric", "l1", "pid", "indi")
WITHOUT_ADAPTATION = "adaptive, kb=0"
"""Flown beside ``adaptive`` through the gust front: what adaptation buys."""
GUST = "gust_front"


class ControllerComparison:
    """Controllers side by side: ``rows`` for each in each scenario, and the ``flights`` that they
    sum up.
    """

    def __init__(self, flights: "Sequence[ComparedFlight]") -> None:
        self.flights = tuple(flights)
        self.rows = tuple(rows(flights))

    def __str__(self) -> str:
        """The table, as a terminal shows it."""
        return text_table(self.rows)

    __repr__ = __str__  # what a notebook shows

    def to_pandas(self) -> "DataFrame":
        """The rows as a table, by scenario and controller.

        Raises:
            ConfigError: pandas is not installed.
        """
        require_package("pandas", "to_pandas", "notebook")
        from pandas import DataFrame

        return DataFrame(msgspec.to_builtins(self.rows)).set_index(["scenario", "controller"])

    def plot(self) -> "Figure":
        """RMS error [cm] by scenario and controller, with no bar where a flight crashed.

        Raises:
            ConfigError: pandas or matplotlib is not installed.
        """
        require_package("matplotlib", "plot", "notebook")
        errors_cm = self.to_pandas()["rms_cm"].astype(float).unstack(sort=False)
        figure = figure_class()(figsize=(9.5, 4.6), layout="constrained")
        errors_cm.plot.bar(ax=figure.subplots(), logy=True, rot=0, ylabel="RMS position error [cm]")
        return figure


@without_frames
def compare(
    controllers: object = CONTROLLERS,
    *,
    scenarios: str | Iterable[str] | None = None,
    seeds: int = 1,
    duration: float = 60.0,
    overrides: str | Sequence[str] = (),
    workers: int = 1,
    on_done: Callable[[int, int], None] | None = None,
) -> ControllerComparison:
    """Fly controllers through the same scenarios with the same seeds: what
    ``groundstation-sim compare`` does.

    Args:
        controllers: one or several: names, or your own, as :func:`sim.runs.simulation.simulate`
            takes one.
        scenarios: their names; without them, all that are flown once a seed. Those with large
            pushes (``step_5``, ``push_10``, …) are flown from each direction, and the worst counts.
        seeds: each flies with seeds 0 to ``seeds`` - 1.
        duration: of each flight [s], longer than 16.
        overrides: ``"key=value"`` each, for all, as ``--set``.
        workers: how many processes fly. More than one wants ``if __name__ == "__main__":`` around a
            script; a controller that they could not import, as one written in a notebook, has all
            fly in this one.
        on_done: hears how many of how many flights are flown.

    Raises:
        ConfigError: an unknown name or key, a bad value, or a flight that the vehicle can't fly.
        UserCodeFault: a controller of your own failed in flight; its cause shows where.
    """
    duration = check_duration(duration, LEAST_JUDGED_S)
    seeds, workers = check_whole("--seeds", seeds, 1), check_whole("--workers", workers, 1)
    places = _check_scenarios(scenarios)
    own: dict[str, object] = {}
    given = several(controllers)
    if not given or any(one is None for one in given):
        says = notice("compare.controllers", choices=list(CONTROLLERS), found=controllers)
        raise ConfigError("--controllers", says)
    names = [str(lend_name(controller, own)) for controller in given]
    work = cases(places, names, [str(one) for one in several(overrides)])
    with lend(own):
        for case in work:  # what can't fly says so before anything flies
            _, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
            make_controller(config.controller, config.vehicle)
        count, done = len(work) * seeds, on_done or (lambda flown, of: None)
        done(0, count)
        with Flyers(workers if all(_can_be_imported(*one) for one in own.items()) else 1) as flyers:
            return ControllerComparison(
                fly_all(work, seeds, duration, flyers, lambda flown: done(flown, count))
            )


def _check_scenarios(scenarios: str | Iterable[str] | None) -> list[str]:
    """Return the names of ``scenarios``; without them, of all that have no variants.

    Raises:
        ConfigError: there is none, or one is unknown.
    """
    plain = [name for name, scenario in SCENARIOS.items() if not scenario.variants]
    places = several(plain if scenarios is None else scenarios)
    unknown = [place for place in places if not isinstance(place, str) or place not in SCENARIOS]
    if unknown or not places:
        says = notice("value.choices", choices=sorted(SCENARIOS), found=(unknown or [scenarios])[0])
        raise ConfigError("--scenarios", says)
    return places


class Case(msgspec.Struct, frozen=True):
    """One controller in one scenario."""

    scenario: str
    controller: str
    """As the table names it."""
    overrides: tuple[str, ...]
    """``--set`` overrides that choose it."""
    variant: int = 0
    """Which of the scenario's variants."""


class ComparedFlight(msgspec.Struct, frozen=True):
    """One flight of a case."""

    case: Case
    seed: int
    survived: bool
    verdict: FlightVerdict


class ComparisonRow(msgspec.Struct, frozen=True):
    """One controller in one scenario, over all seeds: medians, and the spread of the RMS error."""

    scenario: str
    controller: str
    flights: int
    survived: bool
    """True where every flight got to its end."""
    crashed: int
    """Number of flights that crashed."""
    rms_cm: float | None
    """RMS of the true error over the steady part (from 15 s); None where a flight crashed, as for
    all below."""
    rms_cm_min: float | None
    rms_cm_max: float | None
    max_cm: float | None
    settle_s: float | None
    """Time after which the error stays below 10 cm; None too where most flights never get there."""
    effort_rad_s: float | None
    """Control effort: see :class:`sim.runs.FlightVerdict`."""
    peak_cm: float | None = None
    """Largest error after the wind's step or push: the worst of the scenario's variants."""
    back_s: float | None = None
    """Longest time after the gust until the error stays below 5 cm [s]; None where it never
    does."""


def cases(
    scenarios: Iterable[str], controllers: Sequence[str], overrides: Sequence[str] = ()
) -> list[Case]:
    """Every controller in every scenario, and ours without adaptation in the gust front.

    ``overrides`` hold for all.
    """
    found: list[Case] = []
    for scenario in scenarios:
        for name in controllers:
            short, told = _short_name(name, controllers), (*overrides, f"controller.kind={name}")
            for number, variant in enumerate(SCENARIOS[scenario].variants or ((),)):
                found.append(Case(scenario, short, (*variant, *told), number))
            if scenario == GUST and name == "adaptive":
                off = ("controller.kb=0.0", "controller.composite=off")
                found.append(Case(scenario, WITHOUT_ADAPTATION, (*overrides, *off)))
    return found


def _short_name(name: str, among: Sequence[str]) -> str:
    """As a table names it: without the module, where no other is called so."""
    short = name.rpartition(":")[2]
    return short if sum(one.rpartition(":")[2] == short for one in among) == 1 else name


def fly_case(case: Case, seed: int, duration_s: float) -> ComparedFlight:
    """Fly one case once."""
    world, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
    result = fly(world, config, seed=seed, duration_s=duration_s)
    return ComparedFlight(case, seed, result.completed, result.verdict)


def fly_all(
    work: Sequence[Case],
    seeds: int,
    duration_s: float,
    flyers: Flyers,
    on_done: Callable[[int], None] = lambda done: None,
) -> list[ComparedFlight]:
    """Every case with seeds 0 … ``seeds`` - 1, in the order of ``work``.

    ``on_done`` hears how many are flown.
    """
    flights = [partial(fly_case, case, seed, duration_s) for case in work for seed in range(seeds)]
    return flyers.each(run_beside, flights, on_done)


def _can_be_imported(name: str, thing: object) -> bool:
    """Whether another process finds ``thing`` under its name."""
    module, _, attribute = name.partition(":")
    return module != "__main__" and getattr(sys.modules.get(module), attribute, None) is thing


def rows(results: Sequence[ComparedFlight]) -> list[ComparisonRow]:
    """One row a case, in the order of their first flights."""
    by_place: dict[tuple[str, str], list[ComparedFlight]] = {}
    for one in results:
        by_place.setdefault((one.case.scenario, one.case.controller), []).append(one)
    return [_row(flights[0].case, flights) for flights in by_place.values()]


def worst_of_variants(flights: Sequence[tuple[int, float | None]]) -> float | None:
    """The largest of the medians of each variant, of (variant, value); None where one has none."""
    by_variant: dict[int, list[float]] = {}
    for variant, value in flights:
        by_variant.setdefault(variant, []).append(math.inf if value is None else value)
    worst = max(median(values) for values in by_variant.values())
    return worst if math.isfinite(worst) else None


def _row(case: Case, flights: list[ComparedFlight]) -> ComparisonRow:
    crashed = sum(not one.survived for one in flights)
    verdicts = [one.verdict for one in flights]
    errors = [one.rms_cm for one in verdicts]
    known = [error for error in errors if error is not None] if not crashed else []
    # A flight that never settles counts as later than any.
    settled = median([math.inf if one.settle_s is None else one.settle_s for one in verdicts])
    nothing: tuple[float | None, float | None] = (None, None)
    pushed = [
        (one.verdict.gust_peak_cm, one.verdict.gust_back_s) if one.survived else nothing
        for one in flights
    ]
    variants = [one.case.variant for one in flights]
    return ComparisonRow(
        case.scenario,
        case.controller,
        flights=len(flights),
        survived=crashed == 0,
        crashed=crashed,
        rms_cm=_middle(errors, crashed),
        rms_cm_min=min(known, default=None),
        rms_cm_max=max(known, default=None),
        max_cm=_middle([one.max_cm for one in verdicts], crashed),
        settle_s=settled if not crashed and math.isfinite(settled) else None,
        effort_rad_s=_middle([one.effort_rad_s for one in verdicts], crashed),
        peak_cm=worst_of_variants(
            [(variant, peak) for variant, (peak, _) in zip(variants, pushed, strict=True)]
        ),
        back_s=worst_of_variants(
            [(variant, back) for variant, (_, back) in zip(variants, pushed, strict=True)]
        ),
    )


def _middle(values: list[float | None], crashed: int) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known and not crashed else None


NOTE = (
    "The error is the true one, from 15 s on. The baselines fly on our estimate and send commands "
    "as published, without inverting\nthe actuators' lags."
)
HEAD = (
    "scenario", "controller", "RMS cm", "spread", "max cm", "settled s", "effort", "peak cm",
    "back s", "survived",
)  # fmt: skip


def text_table(rows: Sequence[ComparisonRow]) -> str:
    """Columns aligned for a terminal."""
    lines = [HEAD, *map(_cells, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEAD))]
    shown: list[str] = []
    last = rows[0].scenario if rows else ""
    for line in lines:
        if line is not HEAD and line[0] != last:
            shown.append("")
            last = line[0]
        cells = [
            cell.ljust(w) if i < 2 else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        ]
        shown.append("  ".join(cells).rstrip())
    note = (
        "medians over the seeds; errors are true ones, from 15 s on; settled: the error stays "
        "below 10 cm"
    )
    pushed = (
        "peak, back: after the wind's step or push, until the error stays below 5 cm; the worst "
        "direction"
    )
    return "\n".join(
        [
            *shown,
            "",
            note,
            pushed,
            "effort: RMS of the commanded roll and pitch rates less their low-pass of 0.15 s "
            "[rad/s]",
        ]
    )


def markdown_table(rows: Sequence[ComparisonRow]) -> str:
    """One row a scenario, one column a controller: RMS error, and its spread over the seeds."""
    scenarios = list(dict.fromkeys(row.scenario for row in rows))
    controllers = list(dict.fromkeys(row.controller for row in rows))
    by_place = {(row.scenario, row.controller): row for row in rows}
    lines = [f"| RMS error, cm | {' | '.join(controllers)} |", f"|---|{'---:|' * len(controllers)}"]
    for scenario in scenarios:
        cells = [_rms(by_place.get((scenario, controller))) for controller in controllers]
        peak = ", peak after it" if SCENARIOS[scenario].variants else ""
        lines.append(f"| `{scenario}`{peak} | {' | '.join(cells)} |")
    return "\n".join(lines)


def write_between_markers(path: Path, rows: Sequence[ComparisonRow], command: str) -> None:
    """Replace what stands between the markers of ``path`` by the table and by the ``command`` that
    made it.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    flights = max((row.flights for row in rows), default=0)
    what = f"Medians over {flights} flights each" if flights > 1 else "One flight each"
    spread = ", smallest and largest in brackets" if flights > 1 else ""
    made = f"{what}{spread}; made by `{command}`.\n{NOTE}"
    replace_between_markers(path, f"{markdown_table(rows)}\n\n{made}")


def _cells(row: ComparisonRow) -> tuple[str, ...]:
    spread = "" if row.rms_cm_min is None else f"{row.rms_cm_min:.2f} … {row.rms_cm_max:.2f}"
    survived = "yes" if row.survived else f"{row.flights - row.crashed} of {row.flights}"
    settled = "never" if row.survived and row.settle_s is None else _number(row.settle_s, 1)
    return (
        row.scenario,
        row.controller,
        _number(row.rms_cm, 2),
        spread,
        _number(row.max_cm, 2),
        settled,
        _number(row.effort_rad_s, 2),
        _number(row.peak_cm, 1),
        _number(row.back_s, 2),
        survived,
    )


def _number(value: float | None, places: int) -> str:
    return "-" if value is None else f"{value:.{places}f}"


def _rms(row: ComparisonRow | None) -> str:
    if row is None:
        return ""
    if row.rms_cm is None:
        return f"{row.crashed} of {row.flights} crashed"
    if SCENARIOS[row.scenario].variants:
        back = "never back" if row.back_s is None else f"{row.back_s:.2f} s"
        return f"{_number(row.peak_cm, 1)} ({back})"
    spread = f" ({row.rms_cm_min:.2f}–{row.rms_cm_max:.2f})" if row.flights > 1 else ""
    return f"{row.rms_cm:.2f}{spread}"


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
        {
            "k2": 2.0,
            "k3": 4.0,
            "k3_down": 8.0,
            "kb": 0.5,
            "kappa": 15.0,
            "sigma_slope": 4.0,
            "rho_slope": 2.0,
        },
    ),
    SearchedLaw("adaptive, as shipped", "adaptive", {}),
    SearchedLaw(
        "geometric",
        "geometric",
        {
            "k_position": 9.0,
            "k_velocity": 5.0,
            "k_integral": 5.0,
            "coupling": 1.5,
            "k_attitude": 8.0,
        },
    ),
    SearchedLaw(
        "l1",
        "l1",
        {
            "k_position": 9.0,
            "k_velocity": 5.0,
            "predictor_pole": 0.5,
            "bandwidth_rad_s": 5.0,
            "k_attitude": 6.0,
        },
    ),
    SearchedLaw(
        "pid",
        "pid",
        {
            "p_position": 2.0,
            "p_velocity": 5.0,
            "i_velocity": 4.0,
            "d_velocity": 0.02,
            "p_attitude": 8.0,
        },
    ),
    SearchedLaw(
        "indi",
        "indi",
        {
            "k_position": 9.0,
            "k_velocity": 5.0,
            "k_acceleration": 0.1,
            "filter_s": 0.01,
            "k_attitude": 8.0,
        },
    ),
)
SPREAD = 3.0
"""Each gain is searched from its start over this to its start times this."""
FLOORED = ("paper", "adverse")
"""Judged, and kept flying with what :data:`FLOORS` has wrong."""
ON_ROTORS = ("rotors_mqx", "rotors_mqx_radio")
JUDGED = (*FLOORED, "rotors_mqx_radio")
"""Reflown for whole minutes."""
PUSHED = ("step_3", "step_5", "step_8", "push_6", "push_10")
"""Flown by the best of each law, with one seed a direction, and told; not searched."""
REFLOWN = ("paper", "fast", "adverse", "storm", "quad1kg", "rotors_mqx_radio")
EFFORT_RAD_S = {"paper": 0.57, "adverse": 0.79}
"""Most that may be commanded, as ``effort_rad_s`` of ``fly --json`` has it: the median over the
seeds."""
ROTORS_CM = 1.0
"""Largest additional error on rotors [cm]."""
ROTORS_SATURATED = 0.01
"""Largest additional share of commands at a limit on rotors [-]."""
TRIALS = 24
"""Number of evaluations of one search [-]."""
SEARCHED_S = 20.0
"""Duration of each flight of a search [s]. Errors count from 15 s on: 20 s hold half of the figure
of eight, which tells better gains from worse, but laws err in different parts of it."""


class ModelError(NamedTuple):
    """A world that is wrong in one thing, untold."""

    name: str
    field: str
    """Field of the world."""
    value: float
    """Value that is added (delay [s]), a share of what is configured (lag), or set (thrust,
    noise)."""
    only: str = ""
    """Scenario that is flown alone; empty for all."""

    def find_value(self, world: World, vehicle: Vehicle) -> float:
        """Value of the field that makes ``world`` wrong, where ``vehicle`` is configured."""
        if self.field == "command_delay_s":
            return world.command_delay_s + self.value
        return self.value * vehicle.rate_lag_s if self.field == "rate_lag_s" else self.value


FLOORS = (
    ModelError("21.5 ms more command delay", "command_delay_s", 0.0215),
    ModelError("thrust 0.62 of configured", "thrust_gain", 0.62, "paper"),
    ModelError("thrust 0.70 of configured", "thrust_gain", 0.70, "adverse"),
    ModelError("rate lag 1.5 of configured", "rate_lag_s", 1.5),
    ModelError("thrust 1.6 of configured", "thrust_gain", 1.6),
    ModelError("rate lag 0.5 of configured", "rate_lag_s", 0.5),
)


def make_wrong(stage: Staged, floor: ModelError) -> Staged:
    """``stage`` in a world that is wrong by ``floor``."""
    value = floor.find_value(stage.world, stage.config.vehicle)
    return msgspec.structs.replace(
        stage, world=msgspec.structs.replace(stage.world, **{floor.field: value})
    )


class EqualTerms:
    """Judges gains for a search.

    What does not beat the best so far is not put to the floors, as it can't win.
    """

    def __init__(self) -> None:
        self._best = math.inf

    def __call__(
        self, search: Search, gains: dict[str, float], flyers: Flyers, number: int
    ) -> TuningTrial:
        """Fly one set of gains."""
        stages = {stage.scenario: stage.with_gains(gains) for stage in search.stages}

        def lose(rms_cm: float, why: str, excess: float) -> TuningTrial:
            cost = broken_cost(excess)
            return TuningTrial(number=number, gains=gains, rms_cm=rms_cm, broken=[why], cost=cost)

        if loses_proof(stages[FLOORED[0]].config.controller):
            return lose(math.inf, "the proof does not hold for these gains", 10.0)

        def fly(chosen: Iterable[Staged]) -> list[SortieOutcome]:
            work = [
                s for one in chosen for s in sorties(one, search.flight_seeds, search.duration_s)
            ]
            return flyers.each(fly_sortie, work)

        plain = dict(zip(FLOORED, fly(stages[name] for name in FLOORED), strict=True))
        rms_cm = geometric_mean([outcome.cost_cm for outcome in plain.values()])
        for name, outcome in plain.items():
            if outcome.rms_cm is None:
                return lose(rms_cm, f"{name}: {outcome.why}", 10.0)
            over = outcome.effort_rad_s / (IN_HAND * EFFORT_RAD_S[name])
            if over > 1.0:
                return lose(rms_cm, f"{name}: effort {outcome.effort_rad_s:.2f} rad/s", over)
        if rms_cm >= self._best:
            return TuningTrial(number=number, gains=gains, rms_cm=rms_cm, broken=[], cost=rms_cm)
        for name, outcome in zip(ON_ROTORS, fly(stages[name] for name in ON_ROTORS), strict=True):
            is_far = outcome.rms_cm is None or outcome.rms_cm > ROTORS_CM
            if is_far or outcome.saturated > ROTORS_SATURATED:
                return lose(rms_cm, f"{name}: {outcome.describe()}", outcome.cost_cm)
        for floor in FLOORS:
            held = [name for name in FLOORED if floor.only in ("", name)]
            flown = fly(make_wrong(stages[name], floor) for name in held)
            for name, outcome in zip(held, flown, strict=True):
                limit = limit_cm([plain[name]])
                assert limit is not None
                if (why := failure([outcome], limit)) is not None:
                    excess = outcome.cost_cm / limit
                    return lose(rms_cm, f"{name}, {floor.name}: {why}", excess)
        self._best = rms_cm
        return TuningTrial(number=number, gains=gains, rms_cm=rms_cm, broken=[], cost=rms_cm)


class EqualMarginsRow(msgspec.Struct, frozen=True, kw_only=True):
    """One law with its best gains, reflown."""

    law: str
    gains: dict[str, float]
    evaluations: int
    """Number of sets of gains that were tried; 0: the default gains."""
    keeps: bool
    """Whether it keeps all floors, with the seed of the search, and the effort of the reflown."""
    rms_cm: dict[str, float | None]
    """Scenario to the median over the seeds; None where a flight did not get to its end."""
    effort_rad_s: dict[str, float]
    """Median effort in the two judged scenarios [rad/s]."""
    delay_s: dict[str, float]
    """In these, the extra command delay at which it fails [s]; 0 where it fails without."""
    peak_cm: dict[str, float | None] = {}
    """Large push to the peak in its worst direction [cm]; None where a flight did not get to its
    end."""


def compare_at_equal_margins(
    flyers: Flyers,
    *,
    trials: int = TRIALS,
    seeds: int,
    laws: Sequence[SearchedLaw] = SEARCHED_LAWS,
    on_done: Callable[[], None] = lambda: None,
) -> list[EqualMarginsRow]:
    """Search the gains of each of ``laws`` with ``trials`` evaluations, and refly the best with
    ``seeds`` others.

    ``on_done`` is called after each evaluation; the flights at the end count as one each law.
    """
    rows: list[EqualMarginsRow] = []
    for law in laws:
        search = _search(law)
        tries = trials if law.start else 1
        found = run(search, flyers, trials=tries, judge=EqualTerms(), on_trial=lambda _: on_done())
        # Of those that keep the floors the best; where none does, the least broken.
        best = min(found, key=lambda trial: trial.cost)
        rows.append(_refly(law, best, len(found), flyers, seeds))
        on_done()
    return rows


def _stages(law: SearchedLaw, scenarios: Sequence[str]) -> list[Staged]:
    lead = [] if law.kind == "adaptive" else ["controller.actuator_compensation=true"]
    stages = stage_scenarios(scenarios, None, [f"controller.kind={law.kind}", *lead])
    if not law.start:
        return stages
    return [stage.with_gains(law.start) for stage in stages]


def _search(law: SearchedLaw) -> Search:
    return Search(
        stages=_stages(law, [*FLOORED, *ON_ROTORS]),
        keys=[
            Key(name, value / SPREAD, value * SPREAD, value) for name, value in law.start.items()
        ],
        seeds=1,
        duration_s=SEARCHED_S,
        floors=Floors(delay_s=0.0, gain=0.0),
    )


def _refly(
    law: SearchedLaw, best: TuningTrial, count: int, flyers: Flyers, seeds: int
) -> EqualMarginsRow:
    stages = [stage.with_gains(best.gains) for stage in _stages(law, REFLOWN)]
    long_s = dict.fromkeys(JUDGED, DURATION_S)
    work = [
        sorties(stage, range(seeds), long_s.get(stage.scenario, SEARCHED_S)) for stage in stages
    ]
    outcomes = iter(flyers.each(fly_sortie, list(chain(*work))))
    flown = {stage.scenario: [next(outcomes) for _ in range(seeds)] for stage in stages}
    delay_s: dict[str, float] = {}
    for stage in stages:
        if stage.scenario in FLOORED:
            found = report(stage, flyers, seeds=1, duration_s=SEARCHED_S, axes=(DELAY,)).margins
            delay_s[stage.scenario] = (found[0].fails or found[0].holds) if found else 0.0
    effort_rad_s = {name: median(one.effort_rad_s for one in flown[name]) for name in FLOORED}
    return EqualMarginsRow(
        law=law.name,
        gains=best.gains,
        evaluations=count if law.start else 0,
        keeps=not best.broken
        and all(effort_rad_s[name] <= most for name, most in EFFORT_RAD_S.items()),
        rms_cm={name: _median([one.rms_cm for one in some]) for name, some in flown.items()},
        effort_rad_s=effort_rad_s,
        delay_s=delay_s,
        peak_cm={name: _find_peak(law, best, name, flyers) for name in PUSHED},
    )


def _find_peak(law: SearchedLaw, best: TuningTrial, name: str, flyers: Flyers) -> float | None:
    """The peak in the worst of the variants of the scenario ``name`` [cm], with one seed."""
    (stage,) = _stages(law, [name])
    stage = stage.with_gains(best.gains)
    worlds = [overridden(stage.world, list(variant)) for variant in SCENARIOS[name].variants]
    stages = [msgspec.structs.replace(stage, world=world) for world in worlds]
    outcomes = flyers.each(
        fly_sortie, [one for each in stages for one in sorties(each, [0], SEARCHED_S)]
    )
    peaks = [outcome.peak_cm if outcome.rms_cm is not None else None for outcome in outcomes]
    return worst_of_variants(list(enumerate(peaks)))


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if len(known) == len(values) else None


def equal_margins_table(rows: Sequence[EqualMarginsRow]) -> str:
    """One row a law: RMS errors, effort, delay margin; then its gains."""
    head = [
        "RMS error, cm",
        *(f"`{name}`" for name in REFLOWN),
        "effort, rad/s",
        "fails at +ms of delay",
        "keeps",
    ]
    lines = [f"| {' | '.join(head)} |", f"|---|{'---:|' * (len(head) - 1)}"]
    for row in rows:
        cells = [
            row.law,
            *("crash" if (e := row.rms_cm[n]) is None else f"{e:.3g}" for n in REFLOWN),
        ]
        cells.append(" / ".join(f"{row.effort_rad_s[name]:.2f}" for name in FLOORED))
        cells.append(" / ".join(f"{1e3 * row.delay_s[name]:.0f}" for name in FLOORED))
        cells.append("all" if row.keeps else "not all")
        lines.append(f"| {' | '.join(cells)} |")
    lines += [
        "",
        f"| peak, cm | {' | '.join(f'`{name}`' for name in PUSHED)} |",
        f"|---|{'---:|' * len(PUSHED)}",
    ]
    for row in rows:
        peaks = [row.peak_cm.get(name) for name in PUSHED]
        lines.append(
            f"| {row.law} | {' | '.join('lost' if p is None else f'{p:.3g}' for p in peaks)} |"
        )
    lines += ["", "| law | evaluations | gains |", "|---|---:|---|"]
    for row in rows:
        gains = (
            ", ".join(f"{name} {value:.3g}" for name, value in row.gains.items()) or "as they come"
        )
        lines.append(f"| {row.law} | {row.evaluations} | {gains} |")
    return "\n".join([*lines, "", "Effort and delay: `paper` / `adverse`."])


def describe_terms(trials: int, seeds: int) -> str:
    """Describe the search's terms, as a paragraph."""
    floors = ", ".join(f"{each.name} ({each.only})" if each.only else each.name for each in FLOORS)
    efforts = " / ".join(f"{value:g}" for value in EFFORT_RAD_S.values())
    return (
        f"Each law: {trials} evaluations with seed {SEARCH_SEED}, flights of {SEARCHED_S:g} s, "
        f"gains within {SPREAD:g} times their start either way; then medians of seeds 0 to "
        f"{seeds - 1}, in `paper`, `adverse` and `rotors_mqx_radio` flights of {DURATION_S:g} s. "
        f"Floors in the first two: {floors}; effort at most {efforts} rad/s; on rotors at "
        f"most {ROTORS_CM:g} cm and {100.0 * ROTORS_SATURATED:g} % of commands at a limit."
    )
