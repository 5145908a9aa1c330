"""Identified vehicle: what a recording tells of it, each parameter with its interval, or why it tells nothing.

The noise of poses is found by fourth differences of what the model leaves of them: all that is smooth cancels.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from groundstation.analysis.identify.stretch import Column, FlightStretch, components
from groundstation.analysis.identify.thrust_fit import DRAG, DRAGS, NAMES, ThrustFit, fit_thrust, hover_signal
from groundstation.analysis.identify.turn_fit import NAMES as TURNS
from groundstation.analysis.identify.turn_fit import TurnFit, fit_turns
from groundstation.core.geometry import so3
from groundstation.core.trajectory import ExcitationConfig
from links.core import signal

WIDE = 1.96
"""Deviations to either side of a 95 % interval."""
FLY = "not identifiable from this flight: fly trajectory.kind = 'excitation'"
AGAIN = (
    "not identifiable from this flight: fly it for longer (trajectory.laps), or harder (trajectory.acceleration_m_s2)"
)


class IdentifiedParameter(msgspec.Struct, frozen=True, kw_only=True):
    """One figure of a vehicle: its value and interval, or why the flight does not tell."""

    name: str
    title: str
    unit: str
    value: float | None
    """None where the flight does not tell."""
    interval: tuple[float, float] | None
    """95 %."""
    told: float | None
    """What the controller was told; None where it is told nothing of this."""
    note: str = ""

    @property
    def identified(self) -> bool:
        """Whether the flight tells."""
        return self.value is not None


def judge_parameter(
    name: str,
    title: str,
    unit: str,
    value: float,
    deviation: float,
    enough: float,
    *,
    moved: bool = True,
    told: float | None = None,
    least: float = -math.inf,
    most: float = math.inf,
    note: str = "",
) -> IdentifiedParameter:
    """The parameter; without a value where half its interval is more than ``enough``, or where nothing ``moved``."""
    half = WIDE * deviation
    if not (moved and half <= enough):
        return IdentifiedParameter(name=name, title=title, unit=unit, value=None, interval=None, told=told, note=FLY)
    low, high = (float(min(max(edge, least), most)) for edge in (value - half, value + half))
    value, told = float(min(max(value, least), most)), None if told is None else float(told)
    return IdentifiedParameter(
        name=name, title=title, unit=unit, value=value, interval=(low, high), told=told, note=note
    )


BLOCK = 50
"""Variances of so many samples in a row count as one: neighbours hang together."""
UNEVEN = 0.1
"""Poses whose intervals differ by more than this share are left out."""


class NoiseLevel(NamedTuple):
    """Standard deviation per axis, and one deviation of that figure."""

    value: float
    deviation: float


def measure_noise(at_s: Column, left: Column) -> NoiseLevel:
    """Of the noise in ``left`` (N, k), sampled at ``at_s`` (N,) [s]; infinite deviation where there is too little."""
    spans = np.diff(at_s)
    usual = float(np.median(spans))
    even = np.abs(spans - usual) < UNEVEN * usual
    runs = even[:-3] & even[1:-2] & even[2:-1] & even[3:]
    # Independent noise has 1 + 16 + 36 + 16 + 1 times its variance in these; see estimation/observer.py.
    squares = (np.diff(left, 4, axis=0)[runs] ** 2).mean(axis=1) / 70.0
    blocks = len(squares) // BLOCK
    if blocks < 3:
        return NoiseLevel(0.0, np.inf)
    means = squares[: blocks * BLOCK].reshape(blocks, BLOCK).mean(axis=1)
    value = float(np.sqrt(means.mean()))
    deviation = float(means.std(ddof=1) / np.sqrt(blocks)) / max(2.0 * value, 1e-12)
    return NoiseLevel(value, deviation)


class StampJitter(NamedTuple):
    """Variances, and one deviation of each."""

    across: float
    """Of position noise per axis [m²]."""
    along: float
    """Of the stamps [s²]: what an unbiased guess has, so below 0 where there is none."""
    deviation: float
    """Of ``along``; infinite where there is too little, or the vehicle moves too slowly."""
    across_deviation: float = math.inf
    """Of ``across``."""


def measure_jitter(at_s: Column, left: Column, position: Column) -> StampJitter:
    """Of stamps that are early or late by chance: noise along the velocity, of ``position`` (N, 3) [m].

    Noise squared is r + s² v² on each axis: by least squares over ``left``, see :func:`measure_noise`, which is weighed
    by what each of its squares scatters by itself.
    """
    spans = np.diff(at_s)
    usual = float(np.median(spans))
    # A stamp that is off by more than this is taken for a pose that is missing.
    even = np.abs(spans - usual) < 0.5 * usual
    runs = even[:-3] & even[1:-2] & even[2:-1] & even[3:]
    squares = (np.diff(left, 4, axis=0)[runs] ** 2) / 70.0
    speeds = ((position[4:] - position[:-4])[runs] / (4.0 * usual)) ** 2
    blocks = len(squares) // BLOCK
    if blocks < 10:
        return StampJitter(0.0, 0.0, np.inf)
    y, x = squares[: blocks * BLOCK], speeds[: blocks * BLOCK]
    level, slope, parts, matrix = float(np.mean(y)), 0.0, list[Column](), np.eye(2)
    for _ in range(5):
        weights = 1.0 / np.maximum(level + max(slope, 0.0) * x, 1e-12) ** 2
        # Sums over each block, (blocks,): neighbours hang together.
        parts = [(weights * part).reshape(blocks, -1).sum(axis=1) for part in (np.ones_like(x), x, x * x, y, x * y)]
        one, xs, xx, ys, xy = (float(part.sum()) for part in parts)
        matrix = np.array([[one, xs], [xs, xx]])
        level, slope = np.linalg.solve(matrix, [ys, xy]).tolist()
        level = max(level, 1e-12)
    scores = np.stack([parts[3] - level * parts[0] - slope * parts[1], parts[4] - level * parts[1] - slope * parts[2]])
    inverse = np.linalg.inv(matrix)
    cover = inverse @ (scores @ scores.T) @ inverse * blocks / (blocks - 2)
    return StampJitter(level, slope, math.sqrt(float(cover[1, 1])), math.sqrt(float(cover[0, 0])))


UNSEEN_FRAMES = 0.02
"""The recording does not know which frames were lost: so many would make every command this share of a period late."""
MODEL = 0.005
"""No lag is quite of first order, no scale quite constant: nothing is known better than this share."""
THRUST_SPREAD = 1.5
"""Lag and delay of thrust stand for one another, and gusts are no random walk: counted over 200 flights in gusts, their
deviations are so many times those of the fit."""
DRAG_MODEL = 0.01
"""The same of drag, which acts along the attitude that was measured."""
WHITE = 0.01
"""The same of noise, which is never quite white."""
DELAY = "from a command's leaving until it is followed; what pose.latency_s is wrong by is part of it"
JITTER_NOTE = "early or late by chance: noise along the velocity"
DRAG_NOTE = "deceleration per speed; the controller is told one for all axes"
TURNED_RAD_S = 0.05
"""Body rates of less than this (RMS about each axis) tell of nothing but noise, whatever the statistics say."""
PUSHED_M_S2 = 0.2
"""The same of acceleration by thrust, and by tilt."""


class MotionExcitation(NamedTuple):
    """What the flight moved enough to tell of it."""

    turned: tuple[bool, bool, bool]
    """About roll, pitch and yaw."""
    thrust: bool
    pushed: bool
    """Any acceleration."""


@dataclass(frozen=True)
class IdentifiedVehicle:
    """All of it, and what it rests on."""

    seen: FlightStretch
    turned: TurnFit
    pushed: ThrustFit
    parameters: dict[str, IdentifiedParameter]
    """By name."""


def accelerations(found: IdentifiedVehicle) -> tuple[Column, Column, Column]:
    """Times [s], and second differences over 0.2 s of the measured positions and of the model's path, (n, 3) [m/s²].

    Both are NaN where two poses in a row are missing within that time.
    """
    at, place = found.seen.at_s, found.seen.position_ned
    path, h = place - found.pushed.left, 0.1
    spans = np.diff(at)
    holes = np.flatnonzero(spans > 2.5 * np.median(spans))
    whole = (at > at[0] + h) & (at < at[-1] - h)
    for hole in holes:
        whole &= (at < at[hole] - h) | (at > at[hole + 1] + h)

    def second(values: Column) -> Column:
        parts = [np.stack([np.interp(at + k * h, at, axis) for axis in values.T], axis=1) for k in (-1, 0, 1)]
        difference: Column = (parts[0] - 2.0 * parts[1] + parts[2]) / h**2
        difference[~whole] = np.nan
        return difference

    return at, second(place), second(path)


def identify(seen: FlightStretch) -> IdentifiedVehicle:
    """Find everything that ``seen`` tells."""
    turned = fit_turns(seen)
    pushed = fit_thrust(seen, turned)
    moved = judge_excitation(seen, turned)
    parameters = [
        *_thrust(seen, pushed, moved),
        *_lags(seen, turned, pushed, moved),
        *_rest(seen, turned, pushed, moved),
    ]
    if isinstance(seen.config.trajectory, ExcitationConfig):
        parameters = [msgspec.structs.replace(one, note=AGAIN) if one.note == FLY else one for one in parameters]
    return IdentifiedVehicle(seen, turned, pushed, {one.name: one for one in parameters})


def judge_excitation(seen: FlightStretch, turned: TurnFit) -> MotionExcitation:
    """Judge the stretch that was ``seen`` by how it moved."""
    rates = turned.modelled / np.diff(seen.at_s)[:, None]
    roll, pitch, yaw = (bool(rms > TURNED_RAD_S) for rms in np.sqrt((rates**2).mean(axis=0)).tolist())
    flown = (seen.sent_s >= seen.at_s[0]) & (seen.sent_s <= seen.at_s[-1])
    thrust = float(seen.thrust_n[flown].std()) / seen.config.vehicle.mass_kg
    down = np.stack(so3.third_column(components(seen.attitude)), axis=1)
    tilt = seen.config.controller.gravity * float(np.sqrt(down[:, :2].var(axis=0).max()))
    return MotionExcitation((roll, pitch, yaw), thrust > PUSHED_M_S2, max(thrust, tilt) > PUSHED_M_S2)


def _thrust(seen: FlightStretch, pushed: ThrustFit, moved: MotionExcitation) -> list[IdentifiedParameter]:
    config, vehicle = seen.config, seen.config.vehicle
    values, deviations = pushed.fit.values, pushed.fit.deviations
    scale, sag, curve = (NAMES.index(name) for name in ("scale", "sag", "curve"))

    def hover(values: Column) -> float:
        return hover_signal(config, pushed.about, float(values[scale]), float(values[curve]))

    told_hover = signal(config.weight_n / config.full_thrust_n, config.thrust_curve)
    mass = vehicle.mass_kg
    of = f"of thrust over mass: if it weighs m and not {mass:g} kg, thrust is this times m/{mass:g}"
    spread = math.hypot(deviations[scale], MODEL * values[scale])
    hover_spread = math.hypot(_spread(hover, pushed), MODEL * told_hover)
    return [
        judge_parameter(
            "thrust_scale",
            "thrust over what was told",
            "",
            values[scale],
            spread,
            0.05,
            moved=moved.pushed,
            told=1.0,
            note=of,
        ),
        judge_parameter(
            "hover_thrust",
            "signal that carries it",
            "",
            hover(values),
            hover_spread,
            math.inf if WIDE * spread <= 0.05 else 0.0,
            moved=moved.pushed,
            told=told_hover,
            note="in the middle of the flight, in still air",
        ),
        judge_parameter(
            "thrust_curve",
            "thrust curve f",
            "",
            values[curve],
            math.hypot(deviations[curve], MODEL),
            0.25,
            moved=moved.thrust,
            told=config.thrust_curve,
            least=0.0,
            most=1.0,
            note="" if config.link.thrust_curve is None else "link.thrust_curve stands in its place",
        ),
        judge_parameter(
            "thrust_sag", "thrust lost to the battery", "1/min", values[sag], deviations[sag], 0.08, moved=moved.pushed
        ),
    ]


def _spread(figure: Callable[[Column], float], pushed: ThrustFit) -> float:
    """One deviation of a ``figure`` that follows from the parameters."""
    values, steps = pushed.fit.values, 1e-4
    slope = np.array([(figure(values + move) - figure(values)) / steps for move in steps * np.eye(len(values))])
    return math.sqrt(max(float(slope @ pushed.fit.covariance @ slope), 0.0))


def _lags(
    seen: FlightStretch, turned: TurnFit, pushed: ThrustFit, moved: MotionExcitation
) -> list[IdentifiedParameter]:
    vehicle = seen.config.vehicle
    delay, roll, pitch, yaw_delay, yaw = turned.fit.values.tolist()
    thrust_delay, lag = pushed.fit.values[:2].tolist()

    def lag_of(
        name: str, title: str, value: float, deviation: float, told: float, seen: bool, note: str = ""
    ) -> IdentifiedParameter:
        enough = max(0.01, 0.25 * value)
        spread = math.hypot(deviation, MODEL * value)
        return judge_parameter(name, title, "s", value, spread, enough, moved=seen, told=told, least=0.0, note=note)

    both, both_spread = _combine(turned.fit.values[1:3], turned.fit.covariance[1:3, 1:3])
    spreads = dict(zip(TURNS, turned.fit.deviations.tolist(), strict=True))
    thrust_spread, lag_spread = (THRUST_SPREAD * pushed.fit.deviations[:2]).tolist()
    frames = UNSEEN_FRAMES * vehicle.frame_period_s
    told, (rolled, pitched, yawed) = vehicle.rate_lag_s, moved.turned
    rates_told, thrust_told = (
        vehicle.command_delay_s + late for late in (vehicle.rate_delay_s, vehicle.thrust_delay_s)
    )
    turned_at_all, one = rolled or pitched, "the controller is told one for all three"

    def delay_of(
        name: str, title: str, value: float, deviation: float, told: float, seen: bool, note: str = ""
    ) -> IdentifiedParameter:
        spread = math.hypot(deviation, frames)
        if value + WIDE * spread < 0.0:
            note = (
                f"it seems to obey before commands leave: poses are stamped {-1e3 * value:.0f} ms early or more, so "
                "pose.latency_s is too large by as much"
            )
        return judge_parameter(name, title, "s", value, spread, 0.015, moved=seen, told=told, note=note)

    return [
        lag_of("thrust_lag", "thrust lag", lag, lag_spread, vehicle.thrust_lag_s, moved.thrust),
        delay_of("thrust_delay", "thrust delay", thrust_delay, thrust_spread, thrust_told, moved.thrust, DELAY),
        lag_of("rate_lag", "rate lag, roll and pitch", both, both_spread, told, turned_at_all),
        delay_of("rate_delay", "rate delay, roll and pitch", delay, spreads["delay"], rates_told, turned_at_all, DELAY),
        lag_of("roll_rate_lag", "roll rate lag", roll, spreads["roll_lag"], told, rolled),
        lag_of("pitch_rate_lag", "pitch rate lag", pitch, spreads["pitch_lag"], told, pitched),
        lag_of("yaw_rate_lag", "yaw rate lag", yaw, spreads["yaw_lag"], told, yawed, one),
        delay_of("yaw_rate_delay", "yaw rate delay", yaw_delay, spreads["yaw_delay"], rates_told, yawed, one),
    ]


def _combine(values: Column, cover: Column) -> tuple[float, float]:
    """One figure that was found several times, each by its information, and its deviation; correlations count."""
    weights = np.linalg.solve(cover, np.ones(len(values)))
    weights = np.clip(weights / weights.sum(), 0.0, 1.0)
    weights /= weights.sum()
    return float(weights @ values), math.sqrt(float(weights @ cover @ weights))


LOOP_S = 0.002
"""An autopilot tells the attitude of its last loop, which is older than its stamp by about so much, one deviation."""


def _latency(seen: FlightStretch) -> IdentifiedParameter:
    told = getattr(seen.config.pose, "latency_s", 0.0)
    name, title, note = "pose_latency", "latency of poses", "no key of a vehicle, but pose.latency_s"
    if seen.late_s is None:
        note = "the vehicle told no attitude of its own"
        return IdentifiedParameter(name=name, title=title, unit="s", value=None, interval=None, told=told, note=note)
    late, spread = seen.late_s
    return judge_parameter(name, title, "s", told + late, math.hypot(spread, LOOP_S), 0.015, told=told, note=note)


JITTER_SPREAD = 1.5
"""What the model leaves of the motion is noise along it, too: the same of the jitter, counted over 30 flights."""
ENOUGH_JITTER_S = 0.002
"""Where more than this could be, the flight tells nothing of it [s]."""


def jitter_of(jitter: StampJitter) -> IdentifiedParameter:
    """The jitter of stamps as a parameter: its square is what has a symmetric interval."""
    half = WIDE * JITTER_SPREAD * jitter.deviation
    title = "jitter of stamps"
    if not math.sqrt(max(jitter.along, 0.0) + half) - math.sqrt(max(jitter.along, 0.0)) <= ENOUGH_JITTER_S:
        return IdentifiedParameter(
            name="stamp_jitter", title=title, unit="s", value=None, interval=None, told=None, note=FLY
        )
    value, low, high = (math.sqrt(max(jitter.along + part, 0.0)) for part in (0.0, -half, half))
    return IdentifiedParameter(
        name="stamp_jitter", title=title, unit="s", value=value, interval=(low, high), told=None, note=JITTER_NOTE
    )


def _rest(
    seen: FlightStretch, turned: TurnFit, pushed: ThrustFit, moved: MotionExcitation
) -> list[IdentifiedParameter]:
    drags = slice(DRAG, DRAG + len(DRAGS))
    drag, drag_spread = _combine(pushed.fit.values[drags], pushed.fit.covariance[drags, drags])

    def of_drag(value: float, deviation: float) -> float:
        return math.hypot(deviation, DRAG_MODEL * value)

    place, turn = measure_noise(seen.at_s, pushed.left), measure_noise(seen.at_s, turned.left)
    jitter = measure_jitter(seen.at_s, pushed.left, seen.position_ned)
    if jitter.along > WIDE * JITTER_SPREAD * jitter.deviation:  # of the two, what does not come of the stamps
        level = math.sqrt(jitter.across)
        place = NoiseLevel(level, 0.5 * jitter.across_deviation / level)

    def noise_of(name: str, title: str, unit: str, level: NoiseLevel) -> IdentifiedParameter:
        spread = math.hypot(level.deviation, WHITE * level.value)
        return judge_parameter(name, title, unit, level.value, spread, 0.5 * level.value, least=0.0)

    return [
        judge_parameter(
            "drag",
            "linear drag",
            "1/s",
            drag,
            of_drag(drag, drag_spread),
            0.2,
            moved=moved.pushed,
            told=seen.config.vehicle.drag_per_s,
            note=DRAG_NOTE,
        ),
        *(
            judge_parameter(name, title, "1/s", value, of_drag(value, spread), 0.2, moved=moved.pushed)
            for name, title, value, spread in zip(
                DRAGS,
                ("the same forwards", "the same sideways", "the same upwards"),
                pushed.fit.values[drags].tolist(),
                pushed.fit.deviations[drags].tolist(),
                strict=True,
            )
        ),
        _latency(seen),
        jitter_of(jitter),
        noise_of("position_noise", "position noise per axis", "m", place),
        noise_of("attitude_noise", "attitude noise per axis", "rad", turn),
    ]
