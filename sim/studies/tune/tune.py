"""Search for gains: optuna's sampler proposes, whole flights judge, what breaks a constraint never
wins.

A set of gains costs the geometric mean of the RMS errors of its flights. Hard constraints: the
law's proof holds (where the form that flies has one), no flight crashes, and it still flies with
what the floors have wrong and a tenth more. The sampler is seeded anew for each trial, so a search
that was interrupted goes on as if it had not been. Flights go through wire bytes: the arrays of
:mod:`sim.batch.batch` fly one kind of controller only, and pay from some 25 on.

What a search finds is judged once more on seeds that it has not seen.

A margin is how wrong the world may be before a configuration stops flying, one thing at a time, by
bisection. A flight fails when it crashes, or when its RMS error from 15 s on exceeds five times
what it is with nothing wrong, and 10 cm.
"""

import importlib.metadata
import json
import math
import platform
import textwrap
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial, reduce
from itertools import chain
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import msgspec
from msgspec import inspect as mi

from groundstation.config import (
    ConfigError,
    dump,
    is_within_bounds,
    load,
    parse_number,
    round_digits,
    strip_metadata,
)
from groundstation.core.control import (
    ControllerConfig,
    Custom,
    DecreaseProof,
    Gains,
    bound_decrease,
)
from groundstation.pose.sources import ViconConfig
from groundstation.runtime import __version__
from groundstation.settings import Config
from sim.runs import DURATION_S, Flyers, fly
from sim.scenarios import find_scenario, find_timing, prepare, prepare_own, split_overrides
from sim.studies.campaign import program_sha256
from sim.text import notice
from sim.world import World

if TYPE_CHECKING:
    import optuna


SECTION = "controller."
KEYS: dict[str, tuple[str, ...]] = {
    "adaptive": ("k2", "k3", "kb", "kappa", "sigma_slope", "k_omega"),
    "uncompensated": ("k2", "k3", "kb", "sigma_slope"),
    "geometric": ("k_position", "k_velocity", "k_integral", "coupling", "k_attitude"),
    "l1": ("k_position", "k_velocity", "predictor_pole", "bandwidth_rad_s", "k_attitude"),
    "pid": ("p_position", "p_velocity", "i_velocity", "d_velocity", "p_attitude"),
    "indi": ("k_position", "k_velocity", "k_acceleration", "filter_s", "k_attitude"),
}
"""Searched keys where ``--keys`` names none: the gains of the law, not bounds or facts. A
controller of the user's own has all its options searched that are positive numbers."""
AROUND = 4.0
"""Bounds are the default divided and multiplied by this."""


class Key(msgspec.Struct, frozen=True):
    """One gain to search, on a logarithmic scale."""

    name: str
    """Within ``[controller]``."""
    low: float
    high: float
    start: float
    """Value in the configuration."""

    def round(self, value: float) -> float:
        """``value`` with as many digits as are written down, within the bounds."""
        return min(max(round_digits(value), self.low), self.high)


Point = Mapping[str, float]


def space(controller: ControllerConfig, keys: Sequence[str]) -> list[Key]:
    """The gains of ``controller`` that ``keys`` (``controller.k2`` or ``k2=0.5:8``) name, or the
    usual ones.

    Bounds without ``=LOW:HIGH`` are a factor around the default, within what the key accepts, and
    hold the value in force. Where ``keys`` is empty, gains that are switched off (0) stay off.

    Raises:
        ConfigError: a key that is no gain of this controller, is switched off, or bounds that make
            no sense.
    """
    accepted = _numbers(controller)
    if keys:
        return [_find_key(controller, accepted, text) for text in keys]
    usual = KEYS.get(controller.kind, accepted if isinstance(controller, Custom) else ())
    found = [
        _find_key(controller, accepted, name) for name in usual if _value(controller, name) > 0.0
    ]
    if not found:
        raise ConfigError("--keys", notice("tune.no_usual_keys", kind=controller.kind))
    return found


def with_gains(controller: ControllerConfig, gains: Point) -> ControllerConfig:
    """``controller`` with other gains."""
    if not isinstance(controller, Custom):
        return msgspec.structs.replace(controller, **gains)
    own = {name: value for name, value in gains.items() if name in controller.options}
    rest = {name: value for name, value in gains.items() if name not in own}
    return msgspec.structs.replace(controller, options={**controller.options, **own}, **rest)


def loses_proof(controller: ControllerConfig) -> bool:
    """True where this form of adaptation has a proof, and these gains do not satisfy it (kb² κ < 4
    k3).
    """
    if not isinstance(controller, Gains) or controller.composite == "raw" or controller.kb == 0.0:
        return False
    return bound_decrease(controller).proof is DecreaseProof.NONE


def _numbers(controller: ControllerConfig) -> dict[str, tuple[mi.FloatType, float | None]]:
    """Every key of ``controller`` that holds any number, with its type and its default."""
    if isinstance(controller, Custom):
        options = {
            n: v
            for n, v in controller.options.items()
            if isinstance(v, int | float) and v is not True and v > 0
        }
        return {name: (mi.FloatType(), float(value)) for name, value in options.items()}
    info = mi.type_info(type(controller))
    assert isinstance(info, mi.StructType)
    kinds = ((field, strip_metadata(field.type)) for field in info.fields)
    return {
        field.name: (kind, field.default if isinstance(field.default, float) else None)
        for field, kind in kinds
        if isinstance(kind, mi.FloatType) and field.name != "gravity"
    }


def _value(controller: ControllerConfig, name: str) -> float:
    found: Any = (
        controller.options[name] if isinstance(controller, Custom) else getattr(controller, name)
    )
    return float(found)


def _find_key(controller: ControllerConfig, accepted: Mapping[str, Any], text: str) -> Key:
    name, equals, bounds = text.partition("=")
    name = name.strip().removeprefix(SECTION)
    dotted = SECTION + name
    if name not in accepted:
        choices = [SECTION + key for key in accepted]
        raise ConfigError("--keys", notice("value.choices", choices=choices, found=dotted))
    kind, default = accepted[name]
    start = _value(controller, name)
    if equals:
        low, high = _bounds(dotted, bounds)
        for bound in (low, high):
            if not is_within_bounds(kind, bound):
                raise ConfigError("--keys", notice("tune.refused", key=dotted, found=bound))
    elif start == 0.0:
        raise ConfigError("--keys", notice("tune.switched_off", key=dotted))
    else:
        middle = default or start
        # What a key accepts may end within the range, as a share ends at 1.
        ceiling = min(
            bound for bound in (kind.le, kind.lt and 0.999 * kind.lt, math.inf) if bound is not None
        )
        low = min(round_digits(middle / AROUND), start)
        high = max(min(round_digits(middle * AROUND), ceiling), start)
        low = max(low, kind.ge if kind.ge is not None else low)
    return Key(name, low, high, start)


def _bounds(dotted: str, text: str) -> tuple[float, float]:
    try:
        low, high = map(parse_number, text.split(":"))
    except ValueError:
        raise ConfigError("--keys", notice("tune.bounds", key=dotted, found=text)) from None
    if not 0.0 < low < high < math.inf:
        raise ConfigError("--keys", notice("tune.order", key=dotted, found=text))
    return low, high


_VEHICLES = ("vehicle.preset", "vehicle.file")
"""Overrides that tell a whole vehicle: they need no configuration's file around them."""


class Staged(msgspec.Struct, frozen=True, kw_only=True):
    """One scenario, ready to be flown with any gains."""

    scenario: str
    world: World
    config: Config

    def with_gains(self, gains: Point) -> "Staged":
        """Return this stage with other gains."""
        controller = with_gains(self.config.controller, gains)
        return msgspec.structs.replace(
            self, config=msgspec.structs.replace(self.config, controller=controller)
        )


def has_own_vehicle(path: Path | None, overrides: Sequence[str]) -> bool:
    """Whether the user tells the vehicle, by a configuration's file or by an override, and not the
    scenario.
    """
    return path is not None or any(
        text.partition("=")[0].strip() in _VEHICLES for text in overrides
    )


def stage_scenarios(
    names: Sequence[str], path: Path | None, overrides: Sequence[str]
) -> list[Staged]:
    """The scenarios ``names`` with the user's own vehicle, as ``fly --config`` flies it, or with
    what each tells.

    Raises:
        ConfigError: an unknown scenario, a bad configuration or override.
    """
    stages = []
    for name in names:
        if has_own_vehicle(path, overrides):
            world, config, _ = prepare_own(find_scenario(name), path, list(overrides))
        else:
            world, config = prepare(find_scenario(name), list(overrides))
        stages.append(Staged(scenario=name, world=world, config=config))
    return stages


def make_station(path: Path | None, overrides: Sequence[str], stage: Staged) -> Config:
    """The configuration that gets the tuned gains: the user's own, or one for a real room with what
    ``stage`` tells.
    """
    if has_own_vehicle(path, overrides):
        return load(path, Config, split_overrides(list(overrides), None)[1])
    told = stage.config
    rate_hz, latency_s = find_timing(
        told.pose, stage.world.pose_rate_hz, stage.world.pose_latency_s
    )
    pose = ViconConfig(latency_s=latency_s, rate_hz=rate_hz)
    return msgspec.structs.replace(
        Config(), vehicle=told.vehicle, controller=told.controller, pose=pose, link=told.link
    )


CRASH_CM = 200.0
"""A flight that ends early counts so much, and none counts more [cm]."""
AFTER_STEP_S = 10.0
"""Where the wind steps, flights last so much longer than that [s]."""


class Sortie(msgspec.Struct, frozen=True):
    """One flight to fly."""

    stage: Staged
    seed: int
    duration_s: float


class SortieOutcome(NamedTuple):
    """Outcome of one flight."""

    rms_cm: float | None
    """RMS error from 15 s on [cm]; None where the flight did not reach its end."""
    why: str
    """Reason for its end, as a sentence."""
    effort_rad_s: float = 0.0
    """Control effort, see :class:`sim.runs.referee.FlightVerdict`."""
    saturated: float = 0.0
    """Share of the commands after 5 s in which any of the four was clamped."""
    peak_cm: float | None = None
    """Largest error after the wind's step or push, if any [cm]."""

    def describe(self) -> str:
        """Describe the flight in words."""
        if self.rms_cm is None:
            return self.why
        return (
            f"RMS {self.rms_cm:.2f} cm, {100.0 * self.saturated:.1f} % of the commands at a limit"
        )

    @property
    def cost_cm(self) -> float:
        """The RMS error, or what stands for a crash [cm]."""
        return CRASH_CM if self.rms_cm is None else min(self.rms_cm, CRASH_CM)


def fly_sortie(sortie: Sortie) -> SortieOutcome:
    """Fly it."""
    world, config = sortie.stage.world, sortie.stage.config
    result = fly(world, config, seed=sortie.seed, duration_s=sortie.duration_s)
    verdict = result.verdict
    rms_cm = verdict.rms_cm if result.completed else None
    return SortieOutcome(
        rms_cm,
        result.why,
        verdict.effort_rad_s or 0.0,
        verdict.saturated_fraction,
        verdict.gust_peak_cm,
    )


def sorties(stage: Staged, seeds: Sequence[int], duration_s: float) -> list[Sortie]:
    """One flight a seed, long enough to see the scenario's step of the wind if it has one."""
    if any(stage.world.wind_step):
        duration_s = max(duration_s, stage.world.wind_step_time_s + AFTER_STEP_S)
    return [Sortie(stage, seed, duration_s) for seed in seeds]


TIMES_NOMINAL = 5.0
"""A flight with a larger multiple of the nominal error has failed [-]."""
FLOOR_CM = 10.0
"""Smaller errors never count as a failure [cm]."""
DELAYS = (0.005, 0.320, 0.001)
"""First step of a search for a delay, its last one, and how near it is told [s]."""
FACTORS = (math.log(1.1), math.log(8.0), math.log(1.02))
"""First step of a search for a factor, its last one, and how near it is told, as logarithms [-]."""


class MarginAxis(msgspec.Struct, frozen=True):
    """One thing that may be wrong, in one direction; how far it is wrong is x >= 0."""

    name: str
    label: str
    meaning: str
    """One line for people: what in the real world does this."""
    field: str
    """Field of :class:`World`."""
    direction: int = 0
    """0: x [s] is added to the field; ±1: the field is multiplied by exp(±x)."""

    def value(self, x: float) -> float:
        """Seconds added, or the factor."""
        return math.exp(self.direction * x) if self.direction else x

    @property
    def unit(self) -> str:
        """``s`` or ``ratio``."""
        return "ratio" if self.direction else "s"

    def wrong(self, stage: Staged, value: float) -> Staged:
        """``stage``, wrong by ``value``."""
        now = getattr(stage.world, self.field)
        changed = {self.field: now * value if self.direction else now + value}
        return msgspec.structs.replace(stage, world=msgspec.structs.replace(stage.world, **changed))

    def applies(self, world: World) -> bool:
        """False for a factor on what is zero."""
        return not self.direction or getattr(world, self.field) > 0.0


DELAY = MarginAxis(
    "command_delay",
    "extra command delay",
    "the radio or the autopilot is slower than told",
    "command_delay_s",
)
LATENCY = MarginAxis(
    "pose_latency",
    "extra pose latency",
    "the cameras or the network are slower than told",
    "pose_latency_s",
)
GAIN_UP = MarginAxis(
    "thrust_gain_high",
    "thrust gain, up to",
    "it is lighter, or lifts more, than told",
    "thrust_gain",
    direction=1,
)
GAIN_DOWN = MarginAxis(
    "thrust_gain_low",
    "thrust gain, down to",
    "it is heavier than told, or the battery is empty",
    "thrust_gain",
    direction=-1,
)
AXES = (
    DELAY,
    LATENCY,
    MarginAxis(
        "thrust_lag_high",
        "thrust lag, up to",
        "the rotors are slower than told",
        "thrust_lag_s",
        direction=1,
    ),
    MarginAxis(
        "thrust_lag_low",
        "thrust lag, down to",
        "the rotors are quicker than told",
        "thrust_lag_s",
        direction=-1,
    ),
    MarginAxis(
        "rate_lag_high",
        "rate lag, up to",
        "the autopilot turns it slower than told",
        "rate_lag_s",
        direction=1,
    ),
    MarginAxis(
        "rate_lag_low",
        "rate lag, down to",
        "the autopilot turns it quicker than told",
        "rate_lag_s",
        direction=-1,
    ),
    GAIN_UP,
    GAIN_DOWN,
)


class Margin(msgspec.Struct, frozen=True, kw_only=True):
    """Tolerance of one quantity: seconds added to the scenario's value, or a factor on it."""

    name: str
    unit: str
    """``s`` or ``ratio``."""
    holds: float
    """The furthest value that was flown well."""
    fails: float | None
    """The nearest value that was not; None where all that was tried flew well."""
    why: str | None
    """Failure at the limit."""


class MarginReport(msgspec.Struct, frozen=True, kw_only=True):
    """The margins of one configuration in one scenario."""

    scenario: str
    vehicle: str
    controller: str
    nominal_rms_cm: float | None
    """Median over the seeds with nothing wrong; None where one of these flights crashed."""
    limit_cm: float | None
    """RMS error beyond which a flight has failed."""
    seeds: int
    """Flights each, with seeds from 0 on; one that fails is enough."""
    duration_s: float
    margins: list[Margin]
    """Empty where it fails with nothing wrong."""


def limit_cm(nominal: Sequence[SortieOutcome]) -> float | None:
    """Beyond which RMS error a flight has failed, given those with nothing wrong.

    None if one of these crashed.
    """
    errors = [outcome.rms_cm for outcome in nominal if outcome.rms_cm is not None]
    return max(TIMES_NOMINAL * median(errors), FLOOR_CM) if len(errors) == len(nominal) else None


def failure(outcomes: Iterable[SortieOutcome], limit: float) -> str | None:
    """Describe the first failure in ``outcomes``; None without one."""
    for outcome in outcomes:
        if outcome.rms_cm is None:
            return outcome.why
        if outcome.rms_cm > limit:
            return f"RMS {outcome.rms_cm:.1f} cm"
    return None


def find_margin(
    stage: Staged, limit_cm: float, seeds: int, duration_s: float, axis: MarginAxis
) -> Margin:
    """Fly ``stage`` with ``axis`` wrong by ever more until it fails, then bisect, to 1 ms or 2
    %.
    """
    step, most, tolerance = DELAYS if not axis.direction else FACTORS
    why: str | None = None

    def fails(x: float) -> bool:
        nonlocal why
        work = sorties(axis.wrong(stage, axis.value(x)), range(seeds), duration_s)
        found = failure(map(fly_sortie, work), limit_cm)
        why = why if found is None else found
        return found is not None

    holds, x = 0.0, step
    while not fails(x):
        holds = x
        if x >= most:
            return Margin(
                name=axis.name, unit=axis.unit, holds=axis.value(holds), fails=None, why=None
            )
        x = min(2.0 * x, most)
    beyond = x
    while beyond - holds > tolerance:
        middle = 0.5 * (holds + beyond)
        holds, beyond = (holds, middle) if fails(middle) else (middle, beyond)
    return Margin(
        name=axis.name, unit=axis.unit, holds=axis.value(holds), fails=axis.value(beyond), why=why
    )


def report(
    stage: Staged,
    flyers: Flyers,
    *,
    seeds: int,
    duration_s: float,
    axes: Sequence[MarginAxis] = AXES,
    on_done: Callable[[int], None] = lambda done: None,
) -> MarginReport:
    """The margins of ``stage`` on each of ``axes``, one a process.

    ``on_done`` hears how many are found.
    """
    nominal = flyers.each(fly_sortie, sorties(stage, range(seeds), duration_s))
    limit = limit_cm(nominal)
    margins: list[Margin] = []
    if limit is not None:
        axes = [axis for axis in axes if axis.applies(stage.world)]
        margins = flyers.each(partial(find_margin, stage, limit, seeds, duration_s), axes, on_done)
    return MarginReport(
        scenario=stage.scenario,
        vehicle=stage.config.vehicle.name,
        controller=stage.config.controller.kind,
        nominal_rms_cm=None if limit is None else median(o.cost_cm for o in nominal),
        limit_cm=limit,
        seeds=seeds,
        duration_s=duration_s,
        margins=margins,
    )


def criterion(report: MarginReport) -> str:
    """Describe what counts as a failure, as a sentence."""
    several = f"any of {report.seeds} flights" if report.seeds > 1 else "a flight"
    return (
        f"It fails where {several} of {report.duration_s:g} s crashes, or has an RMS error from 15 "
        f"s on above {TIMES_NOMINAL:g} times the one with nothing wrong and above {FLOOR_CM:g} cm."
    )


def markdown_table(reports: Sequence[MarginReport]) -> str:
    """One row a margin, one column a configuration."""
    columns = [f"{report.vehicle} in `{report.scenario}`" for report in reports]
    lines = [
        f"| fails at | {' | '.join(columns)} | what does this |",
        f"|---|{'---:|' * len(reports)}---|",
    ]
    nominal = [one.nominal_rms_cm for one in reports]
    shown = [
        "fails with nothing wrong" if rms_cm is None else f"{rms_cm:.2f} cm" for rms_cm in nominal
    ]
    lines.append(f"| nothing: RMS error | {' | '.join(shown)} | the world is as configured |")
    for axis in AXES:
        by_report = [
            {margin.name: margin for margin in report.margins}.get(axis.name) for report in reports
        ]
        cells = ["-" if margin is None else format_margin(margin) for margin in by_report]
        lines.append(f"| {axis.label} | {' | '.join(cells)} | {axis.meaning} |")
    return "\n".join(lines)


def format_margin(margin: Margin) -> str:
    """``+38 ms`` or ``1.62x``; ``> +320 ms`` where nothing tried failed."""
    if margin.unit == "s":
        return (
            f"> +{1e3 * margin.holds:.0f} ms"
            if margin.fails is None
            else f"+{1e3 * margin.fails:.0f} ms"
        )
    if margin.fails is None:
        return f"{'>' if margin.holds > 1.0 else '<'} {margin.holds:.2f}x"
    return f"{margin.fails:.2f}x"


SEARCH_SEED = 100
"""The first seed of the flights that a search sees. Figures are verified on seeds from 0 to 99."""
IN_HAND = 1.1
"""Factor on floors and limits in a search [-], so that they also hold in flights that it has not
seen."""
PROBE_SEEDS = 2
"""Seeds that fly with something wrong, of those that fly with nothing wrong."""
PROPOSALS = 1000
"""Proposals for one trial; those that lose the proof are thrown away."""


class Floors(msgspec.Struct, frozen=True, kw_only=True):
    """Margins that tuned gains must have, in the first scenario."""

    delay_s: float
    """Command delay beyond what is told [s]; 0 asks for none."""
    gain: float
    """Share by which the thrust may be wrong, either way, 0 to below 1; 0 asks for none."""

    def wrongs(self, factor: float = 1.0) -> list[tuple[MarginAxis, float]]:
        """Return each axis with the value that must still fly, the floors multiplied by
        ``factor``.
        """
        delay = [(DELAY, self.delay_s * factor)] if self.delay_s else []
        share = min(self.gain * factor, 0.99)
        return [*delay, (GAIN_DOWN, 1.0 - share), (GAIN_UP, 1.0 + share)] if share else delay


class Search(msgspec.Struct, frozen=True, kw_only=True):
    """Searched keys, flights and criteria of one search."""

    stages: list[Staged]
    keys: list[Key]
    seeds: int
    duration_s: float
    floors: Floors
    sampler_seed: int = 0
    first_seed: int = SEARCH_SEED
    """First seed of its flights."""
    in_hand: float = IN_HAND
    """Factor on the floors [-]."""

    @property
    def flight_seeds(self) -> list[int]:
        """The seeds of its flights."""
        return list(range(self.first_seed, self.first_seed + self.seeds))

    def settings(self) -> dict[str, Any]:
        """Return the settings that two comparable trials share."""
        found: dict[str, Any] = json.loads(msgspec.json.encode(self))
        return {**found, "program_sha256": program_sha256()}


class Figure(msgspec.Struct, frozen=True, kw_only=True):
    """One scenario with one set of gains, over the seeds."""

    scenario: str
    rms_cm: float | None
    """Median of the RMS errors; None, as the next, where a flight crashed."""
    worst_cm: float | None
    crashed: int


class TuningTrial(msgspec.Struct, frozen=True, kw_only=True):
    """One set of gains, tried."""

    number: int
    """Number of the trial; 0 is the configuration as given."""
    gains: dict[str, float]
    rms_cm: float
    """Geometric mean of the RMS errors of its flights with nothing wrong; a crash counts 2 m."""
    broken: list[str]
    """The constraints it breaks, as sentences; empty for one that may fly."""
    cost: float
    """Cost for the sampler: ``rms_cm``, or more than any of those for a broken constraint."""
    figures: list[Figure] = []
    """Those of each scenario with nothing wrong."""

    def beats(self, other: "TuningTrial") -> bool:
        """Return whether this trial breaks nothing and costs less."""
        return not self.broken and self.cost < other.cost


def try_gains(search: Search, gains: dict[str, float], flyers: Flyers, number: int) -> TuningTrial:
    """Fly one set of gains: each scenario as it is, and the first one with what the floors have
    wrong.
    """
    stages = [stage.with_gains(gains) for stage in search.stages]
    first, seeds = stages[0], search.flight_seeds
    plain = [sorties(stage, seeds, search.duration_s) for stage in stages]
    probes = {
        words(axis, value): sorties(
            axis.wrong(first, value), seeds[:PROBE_SEEDS], search.duration_s
        )
        for axis, value in search.floors.wrongs(search.in_hand)
    }
    outcomes = iter(flyers.each(fly_sortie, list(chain(*plain, *probes.values()))))
    flown = {
        stage.scenario: [next(outcomes) for _ in work]
        for stage, work in zip(stages, plain, strict=True)
    }
    probed = {what: [next(outcomes) for _ in work] for what, work in probes.items()}
    rms_cm = geometric_mean([outcome.cost_cm for some in flown.values() for outcome in some])
    broken = (
        ["the proof does not hold for these gains"] if loses_proof(first.config.controller) else []
    )
    excess = 10.0 * len(broken)
    for scenario, some in flown.items():
        crashes = [outcome.why for outcome in some if outcome.rms_cm is None]
        broken += [f"{scenario}: {crashes[0]}"] if crashes else []
        excess += 10.0 * len(crashes)
    limit = limit_cm(flown[first.scenario])
    for what, some in probed.items():
        why = failure(some, limit) if limit is not None else None
        if why is not None and limit is not None:
            broken.append(f"{what}: {why}")
            excess += math.log(max(max(outcome.cost_cm for outcome in some) / limit, 1.0))
    cost = CRASH_CM + excess if broken else rms_cm
    figures = [_figure(scenario, some) for scenario, some in flown.items()]
    return TuningTrial(
        number=number, gains=gains, rms_cm=rms_cm, broken=broken, cost=cost, figures=figures
    )


def _figure(scenario: str, flown: Sequence[SortieOutcome]) -> Figure:
    errors = [outcome.rms_cm for outcome in flown if outcome.rms_cm is not None]
    whole, crashed = len(errors) == len(flown), len(flown) - len(errors)
    return Figure(
        scenario=scenario,
        rms_cm=median(errors) if whole else None,
        worst_cm=max(errors) if whole else None,
        crashed=crashed,
    )


def broken_cost(excess: float) -> float:
    """Compute the cost of breaking a constraint by ``excess``: more than any flight's that breaks
    none.
    """
    return CRASH_CM + math.log(max(excess, 1.0))


def words(axis: MarginAxis, value: float) -> str:
    """``extra command delay 22 ms``, ``thrust gain 0.75``."""
    name = axis.label.partition(",")[0]
    return f"{name} {value:.2f}" if axis.direction else f"{name} {1e3 * value:.0f} ms"


def geometric_mean(values: Sequence[float]) -> float:
    """Compute the geometric mean of positive numbers."""
    return math.exp(sum(map(math.log, values)) / len(values))


def find_best(trials: Sequence[TuningTrial]) -> TuningTrial | None:
    """The best of ``trials``, where it beats the first one: the configuration as it came."""
    best = reduce(lambda best, trial: trial if trial.beats(best) else best, trials)
    return None if best is trials[0] else best


Judge: TypeAlias = Callable[[Search, dict[str, float], Flyers, int], TuningTrial]
"""Flies one set of gains, the how-manieth of its search, and says what it is worth."""


def run(
    search: Search,
    flyers: Flyers,
    *,
    trials: int,
    journal: Path | None = None,
    judge: Judge | None = None,
    on_trial: Callable[[TuningTrial], None] = lambda trial: None,
) -> list[TuningTrial]:
    """Try until there are ``trials`` sets of gains; returns them as they were tried.

    With ``journal`` every trial is kept there as soon as it is done, and those that are there are
    not flown again. ``judge`` flies each set of gains and says what it is worth: :func:`try_gains`,
    or as it. ``on_trial`` hears each.

    Raises:
        ConfigError: the journal can't be used, or holds another search.
    """
    study = _study(search, journal)
    done: list[TuningTrial] = []

    def take(trial: TuningTrial) -> None:
        done.append(trial)
        on_trial(trial)

    for kept in study.get_trials(deepcopy=False):
        if "trial" in kept.user_attrs:
            take(msgspec.convert(kept.user_attrs["trial"], TuningTrial))
    while len(done) < trials:
        take(_next(search, study, flyers, len(done), judge or try_gains))
    return done


def _next(
    search: Search, study: "optuna.Study", flyers: Flyers, number: int, judge: Judge
) -> TuningTrial:
    from optuna.distributions import FloatDistribution
    from optuna.trial import TrialState, create_trial

    ranges: Any = {key.name: FloatDistribution(key.low, key.high, log=True) for key in search.keys}
    if number == 0:
        trial = judge(search, {key.name: key.start for key in search.keys}, flyers, number)
        inside = {key.name: min(max(key.start, key.low), key.high) for key in search.keys}
        kept = {"trial": msgspec.to_builtins(trial)}
        study.add_trial(
            create_trial(params=inside, distributions=ranges, value=trial.cost, user_attrs=kept)
        )
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
    raise ConfigError("--keys", notice("tune.no_proof", count=PROPOSALS))


def _sampler(seed: int) -> "optuna.samplers.BaseSampler":
    from optuna.samplers import TPESampler

    with warnings.catch_warnings():
        # Gains depend on each other, and it warns that looking at that is new.
        warnings.simplefilter("ignore")
        return TPESampler(seed=seed, multivariate=True)


def _study(search: Search, journal: Path | None) -> "optuna.Study":
    import optuna
    from optuna.storages import InMemoryStorage, JournalStorage
    from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    now = search.settings()
    try:
        storage = (
            InMemoryStorage()
            if journal is None
            else JournalStorage(JournalFileBackend(str(journal)))
        )
        study = optuna.create_study(storage=storage, study_name="tune", load_if_exists=True)
        before = study.user_attrs.get("settings")
    except OSError as error:
        raise ConfigError(
            "--out", notice("file.unusable", path=journal, why=error.strerror)
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError, AssertionError):
        raise ConfigError("--out", notice("tune.no_journal", path=journal)) from None
    if before is None:
        study.set_user_attr("settings", now)
    elif before != now:
        changed = sorted(key for key in now if before.get(key) != now[key])
        raise ConfigError(
            "--out", notice("tune.other_search", path=journal, changed=", ".join(changed))
        )
    return study


class Evidence(msgspec.Struct, frozen=True, kw_only=True):
    """Before and after."""

    seeds: int
    """Flights a scenario, with seeds from 0 on: none that the search has flown."""
    before: TuningTrial
    after: TuningTrial
    complaints: list[str]
    """Why the gains after are not to be used; empty where they are."""


def verify(
    search: Search, start: TuningTrial, best: TuningTrial, flyers: Flyers, seeds: int
) -> Evidence:
    """Try the gains that it began with and the ``best`` ones in whole flights, with seeds 0 to
    ``seeds`` - 1.

    What is demanded is the floors themselves; seeds from ``SEARCH_SEED`` on are the search's own.
    """
    unseen = msgspec.structs.replace(
        search, seeds=seeds, first_seed=0, duration_s=DURATION_S, in_hand=1.0
    )
    before, after = (try_gains(unseen, one.gains, flyers, one.number) for one in (start, best))
    complaints = list(after.broken)
    if after.rms_cm >= before.rms_cm and not start.broken:
        complaints.append(
            f"the mean error is {after.rms_cm:.3g} cm, and was {before.rms_cm:.3g} cm"
        )
    return Evidence(seeds=seeds, before=before, after=after, complaints=complaints)


def toml(
    config: Config, search: Search, trials: list[TuningTrial], evidence: Evidence, command: str
) -> str:
    """The tuned configuration, with where it comes from and what it is worth as comments."""
    first, last = search.flight_seeds[0], search.flight_seeds[-1]
    scenarios, floors = ", ".join(stage.scenario for stage in search.stages), search.floors
    comments = [
        f"Tuned by: {command}",
        f"{len(trials)} trials, sampler seed {search.sampler_seed}. {versions()}.",
        "Searched: the geometric mean of the RMS errors, from 15 s on, of flights of "
        f"{search.duration_s:g} s through {scenarios} with seeds {first} to {last}. Constraints: "
        f"the law's proof, where there is one; no crash; and in {search.stages[0].scenario} it "
        f"still flies with {1e3 * floors.delay_s:g} ms of delay or {100.0 * floors.gain:g} % of "
        "thrust that nobody told it (searched with a tenth more).",
        "",
        *describe_evidence(search, evidence),
    ]
    return "\n".join(
        [*(line for comment in comments for line in _comment(comment)), "", dump(config)]
    )


def describe_evidence(search: Search, evidence: Evidence) -> list[str]:
    """The gains, and the errors on the seeds that verify: before and after."""
    lines = [f"{'controller.':<24} {'before':>16} {'after':>16}"]
    for key in search.keys:
        after = evidence.after.gains[key.name]
        lines.append(f"{key.name:<24} {_number(key.start):>16} {_number(after):>16}")
    lines += [
        "",
        f"RMS error, median and worst of {evidence.seeds} flights that no search has seen, cm:",
    ]
    lines.append(f"{'':<24} {'before':>16} {'after':>16}")
    for old, new in zip(evidence.before.figures, evidence.after.figures, strict=True):
        lines.append(f"{old.scenario:<24} {_errors(old):>16} {_errors(new):>16}")
    lines.append(
        f"{'geometric mean':<24} {evidence.before.rms_cm:>16.3g} {evidence.after.rms_cm:>16.3g}"
    )
    return lines


def versions() -> str:
    """Describe the versions of the programs that ran the search."""
    others = (f"{name} {importlib.metadata.version(name)}" for name in ("optuna", "numpy"))
    return ", ".join(
        [f"groundstation {__version__}", *others, f"Python {platform.python_version()}"]
    )


def _errors(figure: Figure) -> str:
    if figure.rms_cm is None:
        return f"{figure.crashed} crashed"
    return f"{figure.rms_cm:.2f}, {figure.worst_cm:.2f}"


def _number(value: float) -> str:
    return f"{value:.4g}"


def _comment(text: str) -> list[str]:
    # A path that is broken at a hyphen can't be copied.
    wrapper = textwrap.TextWrapper(
        initial_indent="# ",
        subsequent_indent="# ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return wrapper.wrap(text) or ["#"]
