"""Margins: how wrong the world may be before a configuration stops flying, one thing at a time, by bisection.

A flight fails when it crashes, or when its RMS error from 15 s on exceeds five times what it is with nothing wrong,
and 10 cm: below that a room still has its floor and its walls, and a few times a tenth of a millimetre is no failure.
"""

import math
from collections.abc import Callable, Generator, Sequence
from statistics import median

import msgspec

from sim.studies.tune.flights import Flyers, SortieOutcome, Staged, sorties
from sim.world import World

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
