"""Flights that tuning judges, with gains from a searched space: whole ones, through wire bytes. And margins.

Not the arrays of :mod:`sim.batch.batch`: those fly one kind of controller only, and pay from some 25 equal flights on,
while a set of gains is tried on about ten. The world is a scenario's as it stands, or made to fit the configuration's
own vehicle.

A margin is how wrong the world may be before a configuration stops flying, one thing at a time, by bisection.

A flight fails when it crashes, or when its RMS error from 15 s on exceeds five times what it is with nothing wrong,
and 10 cm: below that a room still has its floor and its walls, and a few times a tenth of a millimetre is no failure.
"""

import math
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool  # noqa: TID251  # as above
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect as mi

from groundstation.config import ConfigError, load
from groundstation.core.control import ControllerConfig, Custom, Gains, bound_decrease
from groundstation.core.vehicle import Vehicle
from groundstation.pose.sources import ViconConfig
from groundstation.settings import Config, LinkConfig
from links.bridge import BridgeLinkConfig
from links.core import full_thrust_n
from links.mavlink import MavlinkLinkConfig
from sim.runs import Workers, fly
from sim.scenarios import SCENARIOS, Scenario, prepare, timing
from sim.world import World

SECTION = "controller."
KEYS: dict[str, tuple[str, ...]] = {
    "adaptive": ("k2", "k3", "kb", "kappa", "sigma_slope", "k_omega"),
    "uncompensated": ("k2", "k3", "kb", "sigma_slope"),
    "geometric": ("k_position", "k_velocity", "k_integral", "coupling", "k_attitude"),
    "l1": ("k_position", "k_velocity", "predictor_pole", "bandwidth_rad_s", "k_attitude"),
    "pid": ("p_position", "p_velocity", "i_velocity", "d_velocity", "p_attitude"),
    "indi": ("k_position", "k_velocity", "k_acceleration", "filter_s", "k_attitude"),
}
"""What is searched where ``--keys`` names nothing: the gains of the law, not bounds or facts. A controller of the
user's own has all its options searched that are positive numbers."""
AROUND = 4.0
"""Bounds are the default divided and multiplied by this."""
DIGITS = 4
"""Gains are tried as they are written down: with so many digits."""


class Key(msgspec.Struct, frozen=True):
    """One gain to search, on a logarithmic scale."""

    name: str
    """Within ``[controller]``."""
    low: float
    high: float
    start: float
    """What the configuration has."""

    def round(self, value: float) -> float:
        """``value`` with as many digits as are written down, within the bounds."""
        return min(max(round_gain(value), self.low), self.high)


Point = Mapping[str, float]


def space(controller: ControllerConfig, keys: Sequence[str]) -> list[Key]:
    """The gains of ``controller`` that ``keys`` (``controller.k2`` or ``k2=0.5:8``) name, or the usual ones.

    Bounds without ``=LOW:HIGH`` are a factor around the default, within what the key accepts, and hold the value in
    force. Where ``keys`` is empty, gains that are switched off (0) stay off.

    Raises:
        ConfigError: a key that is no gain of this controller, is switched off, or bounds that make no sense.
    """
    accepted = _numbers(controller)
    if keys:
        return [_find_key(controller, accepted, text) for text in keys]
    usual = KEYS.get(controller.kind, accepted if isinstance(controller, Custom) else ())
    found = [_find_key(controller, accepted, name) for name in usual if _value(controller, name) > 0.0]
    if not found:
        raise ConfigError("--keys", f"{controller.kind} has no usual gains to search, so name some")
    return found


def with_gains(controller: ControllerConfig, gains: Point) -> ControllerConfig:
    """``controller`` with other gains."""
    if not isinstance(controller, Custom):
        return msgspec.structs.replace(controller, **gains)
    own = {name: value for name, value in gains.items() if name in controller.options}
    rest = {name: value for name, value in gains.items() if name not in own}
    return msgspec.structs.replace(controller, options={**controller.options, **own}, **rest)


def round_gain(value: float) -> float:
    """``value`` with as many digits as are written down."""
    return float(f"{value:.{DIGITS}g}")


def loses_proof(controller: ControllerConfig) -> bool:
    """True where this form of adaptation has a proof, and these gains do not satisfy it (kb² κ < 4 k3)."""
    if not isinstance(controller, Gains) or controller.composite == "raw" or controller.kb == 0.0:
        return False
    return bound_decrease(controller).startswith("none")


def _numbers(controller: ControllerConfig) -> dict[str, tuple[mi.FloatType, float | None]]:
    """Every key of ``controller`` that holds any number, with its type and its default."""
    if isinstance(controller, Custom):
        options = {
            n: v for n, v in controller.options.items() if isinstance(v, int | float) and v is not True and v > 0
        }
        return {name: (mi.FloatType(), float(value)) for name, value in options.items()}
    info = mi.type_info(type(controller))
    assert isinstance(info, mi.StructType)
    kinds = ((field, field.type.type if isinstance(field.type, mi.Metadata) else field.type) for field in info.fields)
    return {
        field.name: (kind, field.default if isinstance(field.default, float) else None)
        for field, kind in kinds
        if isinstance(kind, mi.FloatType) and field.name != "gravity"
    }


def _value(controller: ControllerConfig, name: str) -> float:
    found: Any = controller.options[name] if isinstance(controller, Custom) else getattr(controller, name)
    return float(found)


def _find_key(controller: ControllerConfig, accepted: Mapping[str, Any], text: str) -> Key:
    name, equals, bounds = text.partition("=")
    name = name.strip().removeprefix(SECTION)
    dotted = SECTION + name
    if name not in accepted:
        raise ConfigError("--keys", f"expected some of {_list_names(accepted)}, got {dotted!r}")
    kind, default = accepted[name]
    start = _value(controller, name)
    if equals:
        low, high = _bounds(dotted, bounds)
        for bound in (low, high):
            if not _allows(kind, bound):
                raise ConfigError("--keys", f"{dotted} does not accept {bound:g}")
    elif start == 0.0:
        raise ConfigError("--keys", f"{dotted} is switched off (0): switch it on with --set, or leave it out")
    else:
        middle = default or start
        # What a key accepts may end within the range, as a share ends at 1.
        ceiling = min(bound for bound in (kind.le, kind.lt and 0.999 * kind.lt, math.inf) if bound is not None)
        low = min(round_gain(middle / AROUND), start)
        high = max(min(round_gain(middle * AROUND), ceiling), start)
        low = max(low, kind.ge if kind.ge is not None else low)
    return Key(name, low, high, start)


def _bounds(dotted: str, text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise ConfigError("--keys", f"expected {dotted}=LOW:HIGH, such as 0.5:8, got {text!r}") from None
    if not 0.0 < low < high < math.inf:
        raise ConfigError("--keys", f"expected 0 < LOW < HIGH for {dotted}, got {text!r}")
    return low, high


def _allows(kind: mi.FloatType, value: float) -> bool:
    return (
        (kind.gt is None or value > kind.gt)
        and (kind.ge is None or value >= kind.ge)
        and (kind.lt is None or value < kind.lt)
        and (kind.le is None or value <= kind.le)
    )


def _list_names(names: Iterable[str]) -> list[str]:
    return [SECTION + name for name in names]


_STATION = ("vehicle", "controller", "pose", "link", "status", "mqtt")
"""Sections that the configuration's file decides; the scenario decides the others."""
_VEHICLES = ("vehicle.preset", "vehicle.file")
"""Overrides that tell a whole vehicle: they need no configuration's file around them."""


class Staged(msgspec.Struct, frozen=True, kw_only=True):
    """One scenario, ready to be flown with any gains."""

    scenario: str
    world: World
    config: Config

    def with_gains(self, gains: Point) -> "Staged":
        """The same, flown with other gains."""
        controller = with_gains(self.config.controller, gains)
        return msgspec.structs.replace(self, config=msgspec.structs.replace(self.config, controller=controller))


def own(path: Path | None, overrides: Sequence[str]) -> Config | None:
    """The configuration of the user's own vehicle: in ``path``, or around the vehicle that an override names.

    None where neither tells a vehicle, so that the scenarios do. Overrides of the truth (``sim.…``) are left out.

    Raises:
        ConfigError: see :func:`groundstation.config.loader.load`; or the link's frames are not as told.
    """
    told = [text for text in overrides if not text.startswith("sim.")]
    if path is None and not any(_key(text) in _VEHICLES for text in told):
        return None
    config = load(path, Config, told)
    period_s = config.vehicle.frame_period_s
    link = config.link
    if path is None and isinstance(link, MavlinkLinkConfig) and not any(_key(t) == "link.period_s" for t in told):
        config = msgspec.structs.replace(config, link=msgspec.structs.replace(link, period_s=period_s))
    if _period_s(config) != period_s:
        raise ConfigError(
            "link.period_s",
            f"commands leave every {_period_s(config):g} s, but vehicle.frame_period_s = {period_s:g}: "
            "gains are tuned for one of them, so make both the same",
        )
    return config


def _period_s(config: Config) -> float:
    """Time between two commands [s]. An RF bridge tells it when it is there, and then it is the vehicle's."""
    return config.vehicle.frame_period_s if isinstance(config.link, BridgeLinkConfig) else config.link.period_s


def _pace_link(link: LinkConfig, period_s: float) -> MavlinkLinkConfig:
    """The link that the simulation has in the place of ``link``; a radio's frames follow no poses."""
    pace = link.pace if isinstance(link, MavlinkLinkConfig) else "period"
    return MavlinkLinkConfig(period_s=period_s, pace=pace, thrust_curve=link.thrust_curve)


def _key(override: str) -> str:
    return override.partition("=")[0].strip()


def stage_scenarios(names: Sequence[str], path: Path | None, overrides: Sequence[str]) -> list[Staged]:
    """The scenarios ``names`` for the user's :func:`own` vehicle, or without one each with what it tells itself.

    Raises:
        ConfigError: an unknown scenario, a bad configuration or override, or the two do not fit together.
    """
    for name in names:
        if name not in SCENARIOS:
            raise ConfigError("--scenarios", f"expected some of {sorted(SCENARIOS)}, got {name!r}")
    station = own(path, [text for text in overrides if _key(text).partition(".")[0] in _STATION])
    if station is None:
        return [_stage(SCENARIOS[name], list(overrides)) for name in names]
    rest = [text for text in overrides if _key(text).partition(".")[0] not in _STATION]
    return [_stage(fit_scenario(SCENARIOS[name], station), rest, station) for name in names]


def _stage(scenario: Scenario, overrides: list[str], station: Config | None = None) -> Staged:
    source = "odometry" if station is not None and station.pose.by_autopilot else "vicon"
    world, config = prepare(scenario, overrides, source=source)
    if station is not None:
        link = _pace_link(station.link, _period_s(config))
        config = msgspec.structs.replace(config, controller=station.controller, link=link)
    return Staged(scenario=scenario.name, world=world, config=config)


def fit_scenario(scenario: Scenario, station: Config) -> Scenario:
    """``scenario`` with the vehicle, the rates and the latency of ``station``.

    What is true keeps its ratio to what is told: a lag that is 13 % longer than told stays so. Wind, drag, noise,
    losses and the reference stay the scenario's.

    Raises:
        ConfigError: the poses are a recording, or the vehicle has lags where the scenario has none.
    """
    truth, told, vehicle, pose = scenario.world, scenario.told, station.vehicle, station.pose
    if pose.recorded:
        raise ConfigError("pose.kind", "a recording cannot be flown; expected a source that sees the vehicle")
    rate_hz, latency_s = timing(pose, truth.pose_rate_hz, scenario.told_latency_s)

    def lag(key: str) -> float:
        theirs, ours = getattr(told, key), getattr(vehicle, key)
        if theirs == 0.0 and ours > 0.0:
            raise ConfigError("--scenarios", f"{scenario.name} has no lags, but vehicle.{key} = {ours:g}")
        return float(getattr(truth, key) * (ours / theirs if theirs else 1.0))

    world = msgspec.structs.replace(
        truth,
        mass_kg=truth.mass_kg * (vehicle.mass_kg / told.mass_kg),
        thrust_max_n=truth.thrust_max_n * (station.full_thrust_n / _full_thrust_n(told, truth)),
        thrust_curve=station.thrust_curve,
        rate_limits_deg_s=vehicle.rate_limits_deg_s,
        thrust_lag_s=lag("thrust_lag_s"),
        rate_lag_s=lag("rate_lag_s"),
        command_delay_s=vehicle.command_delay_s,
        thrust_delay_s=max(0.0, truth.thrust_delay_s - told.thrust_delay_s + vehicle.thrust_delay_s),
        rate_delay_s=max(0.0, truth.rate_delay_s - told.rate_delay_s + vehicle.rate_delay_s),
        drag_per_s=max(0.0, truth.drag_per_s - told.drag_per_s + vehicle.drag_per_s),
        pose_latency_s=max(0.0, truth.pose_latency_s - scenario.told_latency_s + latency_s),
        pose_rate_hz=rate_hz,
        frame_period_s=_period_s(station),
    )
    return msgspec.structs.replace(scenario, world=world, told=vehicle, told_latency_s=latency_s)


def _full_thrust_n(told: Vehicle, truth: World) -> float:
    """Thrust of the full signal [N] as a scenario tells it."""
    if told.hover_thrust is None:
        return told.thrust_max_n
    return full_thrust_n(told.mass_kg * truth.gravity, told.hover_thrust, told.thrust_curve)


def station_of(stage: Staged) -> Config:
    """A configuration for a real room with what ``stage`` is told: for where no file was given."""
    scenario, world, ours = stage.config, stage.world, Config()
    rate_hz, latency_s = timing(scenario.pose, world.pose_rate_hz, world.pose_latency_s)
    return msgspec.structs.replace(
        ours,
        vehicle=scenario.vehicle,
        controller=scenario.controller,
        pose=ViconConfig(latency_s=latency_s, rate_hz=rate_hz),
        link=msgspec.structs.replace(_pace_link(scenario.link, _period_s(scenario)), thrust_curve=None),
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
    """What came of it."""

    rms_cm: float | None
    """From 15 s on; None where it did not get to its end."""
    why: str
    """How it ended, as a sentence."""
    effort_rad_s: float = 0.0
    """Of its commands, see :class:`sim.runs.referee.FlightVerdict`."""
    saturated: float = 0.0
    """Share of the commands after 5 s in which any of the four was clamped."""

    def describe(self) -> str:
        """How it flew, in words."""
        if self.rms_cm is None:
            return self.why
        return f"RMS {self.rms_cm:.2f} cm, {100.0 * self.saturated:.1f} % of the commands at a limit"

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
    return SortieOutcome(rms_cm, result.why, verdict.effort_rad_s or 0.0, verdict.saturated_fraction)


def sorties(stage: Staged, seeds: Sequence[int], duration_s: float) -> list[Sortie]:
    """One flight a seed, long enough to see the scenario's step of the wind if it has one."""
    if any(stage.world.wind_step):
        duration_s = max(duration_s, stage.world.wind_step_time_s + AFTER_STEP_S)
    return [Sortie(stage, seed, duration_s) for seed in seeds]


class Flyers:
    """Processes that fly. With one worker it is this process, and none is started."""

    def __init__(self, workers: int) -> None:
        """``workers`` >= 1."""
        self._workers = workers
        self._pool: Workers | None = None

    def __enter__(self) -> "Flyers":
        """Nothing starts before the first flight."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes; what they have not begun is left."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def fly(self, work: Sequence[Sortie]) -> list[SortieOutcome]:
        """Fly all, in the order of ``work``.

        Raises:
            ConfigError: a process was ended from outside.
        """
        if self._workers == 1:
            return [fly_sortie(sortie) for sortie in work]
        if self._pool is None:
            self._pool = Workers(self._workers)
        try:
            return list(self._pool.map(fly_sortie, work))
        except BrokenProcessPool:
            raise ConfigError("--workers", "a process was ended from outside; the same command goes on") from None


TIMES_NOMINAL = 5.0
FLOOR_CM = 10.0
SMALLEST, LARGEST = 0.125, 8.0
"""Factors tried go no further."""
LONGEST_S = 0.320
"""Delays tried go no further [s]."""


class MarginAxis(msgspec.Struct, frozen=True):
    """One thing that may be wrong, in one direction; how far it is wrong is x >= 0."""

    name: str
    label: str
    meaning: str
    """One line for people: what in the real world does this."""
    field: str
    """Of :class:`World`."""
    direction: int = 0
    """0: x [s] is added to the field; ±1: the field is multiplied by exp(±x)."""

    def value(self, x: float) -> float:
        """Seconds added, or the factor."""
        return math.exp(self.direction * x) if self.direction else x

    @property
    def neutral(self) -> float:
        """The value with which nothing is wrong."""
        return self.value(0.0)

    def wrong(self, stage: Staged, value: float) -> Staged:
        """``stage``, wrong by ``value``."""
        now = getattr(stage.world, self.field)
        changed = {self.field: now * value if self.direction else now + value}
        return msgspec.structs.replace(stage, world=msgspec.structs.replace(stage.world, **changed))

    def applies(self, world: World) -> bool:
        """False for a factor on what is zero."""
        return not self.direction or getattr(world, self.field) > 0.0

    def search(self) -> Generator[float, bool, tuple[float, float | None]]:
        """The :func:`boundary` in x, to 1 ms or 2 %."""
        if self.direction:
            return boundary(math.log(1.1), math.log(LARGEST), math.log(1.02))
        return boundary(0.005, LONGEST_S, 0.001)


DELAY = MarginAxis(
    "command_delay", "extra command delay", "the radio or the autopilot is slower than told", "command_delay_s"
)
LATENCY = MarginAxis(
    "pose_latency", "extra pose latency", "the cameras or the network are slower than told", "pose_latency_s"
)
GAIN_UP = MarginAxis(
    "thrust_gain_high", "thrust gain, up to", "it is lighter, or lifts more, than told", "thrust_gain", direction=1
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
    MarginAxis("thrust_lag_high", "thrust lag, up to", "the rotors are slower than told", "thrust_lag_s", direction=1),
    MarginAxis(
        "thrust_lag_low", "thrust lag, down to", "the rotors are quicker than told", "thrust_lag_s", direction=-1
    ),
    MarginAxis(
        "rate_lag_high", "rate lag, up to", "the autopilot turns it slower than told", "rate_lag_s", direction=1
    ),
    MarginAxis(
        "rate_lag_low", "rate lag, down to", "the autopilot turns it quicker than told", "rate_lag_s", direction=-1
    ),
    GAIN_UP,
    GAIN_DOWN,
)


class Margin(msgspec.Struct, frozen=True, kw_only=True):
    """How far one thing may be wrong: seconds added to what the scenario has, or a factor on it."""

    name: str
    unit: str
    """``s`` or ``ratio``."""
    holds: float
    """The furthest value that was flown well."""
    fails: float | None
    """The nearest value that was not; None where all that was tried flew well."""
    why: str | None
    """What happened there."""


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
    """Beyond which RMS error a flight has failed, given those with nothing wrong; None if one of these crashed."""
    errors = [outcome.rms_cm for outcome in nominal if outcome.rms_cm is not None]
    return max(TIMES_NOMINAL * median(errors), FLOOR_CM) if len(errors) == len(nominal) else None


def failure(outcomes: Sequence[SortieOutcome], limit: float) -> str | None:
    """What happened in the first of ``outcomes`` that failed; None if none did."""
    for outcome in outcomes:
        if outcome.rms_cm is None:
            return outcome.why
        if outcome.rms_cm > limit:
            return f"RMS {outcome.rms_cm:.1f} cm"
    return None


def boundary(step: float, limit: float, tolerance: float) -> Generator[float, bool, tuple[float, float | None]]:
    """Yields x to try, is sent whether that fails; returns the last that held and the first that failed.

    From 0, which holds, outwards in steps that double, so that the first failure is found and none beyond it;
    then by bisection. None: even ``limit`` holds.
    """
    holds, x = 0.0, step
    while not (yield x):
        holds = x
        if x >= limit:
            return holds, None
        x = min(2.0 * x, limit)
    fails = x
    while fails - holds > tolerance:
        middle = 0.5 * (holds + fails)
        if (yield middle):
            fails = middle
        else:
            holds = middle
    return holds, fails


def report(
    stage: Staged,
    flyers: Flyers,
    *,
    seeds: int,
    duration_s: float,
    axes: Sequence[MarginAxis] = AXES,
    on_found: Callable[[], None] = lambda: None,
) -> MarginReport:
    """Fly ``stage`` with each of ``axes`` wrong by ever more, until it fails; ``on_found`` hears of each margin."""
    nominal = flyers.fly(sorties(stage, range(seeds), duration_s))
    limit = limit_cm(nominal)
    found: dict[str, Margin] = {}
    if limit is not None:
        axes = [axis for axis in axes if axis.applies(stage.world)]
        searches = {axis: axis.search() for axis in axes}
        asked = {axis: next(search) for axis, search in searches.items()}
        reasons: dict[MarginAxis, str] = {}
        while asked:  # a round asks one question for every margin still searched, so that all processes fly
            questions = list(asked.items())
            work = [
                sortie
                for axis, x in questions
                for sortie in sorties(axis.wrong(stage, axis.value(x)), range(seeds), duration_s)
            ]
            outcomes = flyers.fly(work)
            for i, (axis, _) in enumerate(questions):
                why = failure(outcomes[i * seeds : (i + 1) * seeds], limit)
                reasons |= {axis: why} if why is not None else {}
                try:
                    asked[axis] = searches[axis].send(why is not None)
                except StopIteration as end:
                    del asked[axis]
                    holds, fails = end.value
                    found[axis.name] = _margin(axis, holds, fails, reasons.get(axis))
                    on_found()
    return MarginReport(
        scenario=stage.scenario,
        vehicle=stage.config.vehicle.name,
        controller=stage.config.controller.kind,
        nominal_rms_cm=None if limit is None else median(o.cost_cm for o in nominal),
        limit_cm=limit,
        seeds=seeds,
        duration_s=duration_s,
        margins=[found[axis.name] for axis in axes if axis.name in found],
    )


def _margin(axis: MarginAxis, holds: float, fails: float | None, why: str | None) -> Margin:
    return Margin(
        name=axis.name,
        unit="ratio" if axis.direction else "s",
        holds=axis.value(holds),
        fails=None if fails is None else axis.value(fails),
        why=why,
    )


def criterion(report: MarginReport) -> str:
    """What counts as a failure, as a sentence."""
    several = f"any of {report.seeds} flights" if report.seeds > 1 else "a flight"
    return (
        f"It fails where {several} of {report.duration_s:g} s crashes, or has an RMS error from 15 s on above "
        f"{TIMES_NOMINAL:g} times the one with nothing wrong and above {FLOOR_CM:g} cm."
    )


def text(report: MarginReport) -> str:
    """One line a margin."""
    head = f"{report.scenario}, vehicle {report.vehicle}, controller {report.controller}"
    if report.limit_cm is None:
        return f"{head}\nIt fails with nothing wrong: there are no margins."
    rows = [
        (axis.label, format_margin(margin), axis.meaning, margin.why or "") for axis, margin in _list_margins(report)
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    lines = [
        f"{label:<{widths[0]}}  {value:>{widths[1]}}  {meaning:<{widths[2]}}  {f'({why})' if why else ''}".rstrip()
        for label, value, meaning, why in rows
    ]
    return "\n".join(
        [
            f"{head}: RMS error {report.nominal_rms_cm:.2f} cm with nothing wrong",
            f"One thing wrong at a time, untold. {criterion(report)}",
            "",
            *lines,
        ]
    )


def markdown_table(reports: Sequence[MarginReport]) -> str:
    """One row a margin, one column a configuration."""
    columns = [f"{report.vehicle} in `{report.scenario}`" for report in reports]
    lines = [f"| fails at | {' | '.join(columns)} | what does this |", f"|---|{'---:|' * len(reports)}---|"]
    for axis in AXES:
        by_report = [{margin.name: margin for margin in report.margins}.get(axis.name) for report in reports]
        cells = ["-" if margin is None else format_margin(margin) for margin in by_report]
        lines.append(f"| {axis.label} | {' | '.join(cells)} | {axis.meaning} |")
    return "\n".join(lines)


def format_margin(margin: Margin) -> str:
    """``+38 ms`` or ``1.62x``; ``> +320 ms`` where nothing tried failed."""
    if margin.unit == "s":
        return f"> +{1e3 * LONGEST_S:.0f} ms" if margin.fails is None else f"+{1e3 * margin.fails:.0f} ms"
    if margin.fails is None:
        return f"{'>' if margin.holds > 1.0 else '<'} {margin.holds:.2f}x"
    return f"{margin.fails:.2f}x"


def _list_margins(report: MarginReport) -> list[tuple[MarginAxis, Margin]]:
    by_name = {axis.name: axis for axis in AXES}
    return [(by_name[margin.name], margin) for margin in report.margins]
