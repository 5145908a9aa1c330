"""Evidence, ``groundstation replay evidence FLIGHT…``: how well our estimator predicts a recorded flight.

At each pose of the part that flies, the estimator has seen the poses up to then and the commands that had been sent; it
says where the vehicle will be, and the pose that is measured then is the judge. Beside it stand p + v t (v over 50 ms)
and constant acceleration (over 100 ms). The filter's noise is that of the source, from differences of the positions.

An attitude set-point becomes body rates by the gain of the autopilot's attitude loop (mapping), about the measured
attitude. That loop is found from how the attitude followed: φ˙ = ω, τ ω˙ = P (u(t - δ) - φ) - ω, with one P, τ and δ
for roll and pitch. It is linear: every (P, τ) of a grid is simulated once, and a delay is a shift. What differs by a
constant is a trim. Intervals are by the jackknife over eight parts of the flight (B. Efron, 1982).
"""

import json
import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from groundstation.analysis.evidence.imports import (
    MEASURED,
    SETPOINT,
    STATE,
    Column,
    ImportedSetpoint,
    ImportedState,
    MappedVehicle,
    find_resolution,
)
from groundstation.analysis.evidence.shadow import (
    GAP,
    FlownPath,
    RecordedPose,
    RecordedVehicle,
    SentSetPoint,
    compare_commands,
    flying,
    hover_share,
    replay,
    thrust_shares,
)
from groundstation.analysis.identify import LEAST_S, WIDE, FlightStretch, StretchTooShort, find_stretch, identify
from groundstation.config import ConfigError, from_dict
from groundstation.core.estimation import (
    JITTER_SHOWS,
    PP,
    Densities,
    Estimation,
    ModelEstimator,
    initial_covariance,
    predict_covariance,
    update_covariance,
)
from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import Pose
from groundstation.core.vehicle import GRAVITY, ActuatorCommand
from groundstation.machine import replace_between_markers, split_at_markers
from groundstation.recording import MeasuredMessage, NoRecording, Recording, read_pose
from groundstation.runtime import Exit
from groundstation.settings import Config, read_flown_config
from links.core import signal

GAINS = np.geomspace(1.5, 30.0, 22)
"""Gains of an attitude loop that are tried [1/s]."""
LAGS_S = np.array([0.003, 0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1, 0.125, 0.15, 0.18, 0.22])
"""Lags of its rates that are tried [s]."""
LATEST_S = 0.25
"""Longest delay tried [s]."""
STEP_S = 0.01
"""Step between tried delays [s]."""
CLOSER = np.geomspace(0.65, 1.0 / 0.65, 9)
"""About the best of the grid, a finer one."""
PARTS = 8
"""Parts of a flight; the spread of fits without one of them gives the deviation."""
LOOP_SETTLES_S = 1.0
"""Time until the tried loop has forgotten its start [s]."""
EXPLAINED = 0.5
"""A loop that explains a smaller share of what the attitude did is none."""


class AttitudeLoop(NamedTuple):
    """The loop that fits best; each value with its 95 % interval."""

    gain: float
    """P [1/s]."""
    lag_s: float
    """τ, of the body rates [s]."""
    delay_s: float
    """δ [s]."""
    explained: float
    """Share of the attitude's variance [-]."""
    intervals: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    """95 % intervals of gain, lag and delay."""


def fit_attitude_loop(at_s: Column, attitude: Column, set_s: Column, wanted: Column) -> AttitudeLoop | None:
    """Fit ``attitude`` (N, 2) at ``at_s`` to the set-points ``wanted`` (M, 2) at ``set_s``, roll and pitch [rad].

    Returns None where too little of what the vehicle did is explained.
    """
    step = float(np.median(np.diff(at_s)))
    time = np.arange(at_s[0], at_s[-1], step)
    settle = round((LOOP_SETTLES_S + LATEST_S) / step)
    if len(time) < 4 * settle:
        return None
    seen = np.stack([np.interp(time, at_s, axis) for axis in attitude.T], axis=1)
    # A set-point holds until the next: the newest one counts.
    asked = wanted[np.clip(np.searchsorted(set_s, time + 1e-3 * step, "right") - 1, 0, None)]
    centred = seen - seen[settle:].mean(axis=0)
    delays = np.unique(np.round(np.arange(0.0, LATEST_S, STEP_S) / step).astype(int))
    parts = np.array_split(np.arange(len(time) - settle), PARTS)

    def leave(gains: Column, lags_s: Column) -> Column:
        """Squares that are left in each part of the flight, by delay and loop."""
        answer = respond(asked, step, gains, lags_s)
        left = np.empty((PARTS, len(delays), len(gains)))
        for k, delay in enumerate(delays.tolist()):
            late = answer[settle - delay : len(time) - delay]
            off = centred[settle:, :, None] - (late - late.mean(axis=0))
            left[:, k] = [(off[rows] ** 2).sum(axis=(0, 1)) for rows in parts]
        return left

    gains, lags, left = _search_loops(leave)

    def best(errors: Column) -> Column:
        k, one = np.unravel_index(int(errors.argmin()), errors.shape)
        return np.array([gains[one], lags[one], delays[k] * step])

    total = left.sum(axis=0)
    explained = 1.0 - float(total.min()) / max(float((centred[settle:] ** 2).sum()), 1e-12)
    if explained < EXPLAINED:
        return None
    values = best(total)
    without = np.array([best(total - left[part]) for part in range(PARTS)])
    spread = np.sqrt((PARTS - 1) / PARTS * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
    coarse = np.array([0.04 * values[0], 0.002 + 0.04 * values[1], 0.5 * max(STEP_S, step)])
    half = WIDE * np.hypot(spread, coarse)
    (p, t, d), (a, b, c) = values.tolist(), half.tolist()
    return AttitudeLoop(
        p, t, d, explained, ((max(p - a, 0.0), p + a), (max(t - b, 0.0), t + b), (max(d - c, 0.0), d + c))
    )


def _search_loops(leave: Callable[[Column, Column], Column]) -> tuple[Column, Column, Column]:
    """Gains and lags [s] closer and closer around the best, and what they ``leave``, by part, delay and loop."""
    gains, lags = (grid.ravel() for grid in np.meshgrid(GAINS, LAGS_S, indexing="ij"))
    left = leave(gains, lags)
    for closer in (CLOSER, CLOSER**0.3):
        # Delay, lag and gain make up for each other: each of the likelier delays goes on with a loop of its own.
        total = left.sum(axis=0)
        centres = {int(total[k].argmin()) for k in np.argsort(total.min(axis=1))[:5]}
        around = [np.meshgrid(gains[k] * closer, np.maximum(lags[k] * closer, 1e-3), indexing="ij") for k in centres]
        gains, lags = (np.concatenate([grid[k].ravel() for grid in around]) for k in (0, 1))
        left = leave(gains, lags)
    return gains, lags, left


def respond(asked: Column, step_s: float, gains: Column, lags_s: Column) -> Column:
    """Compute responses (N, 2, G) [rad] of loops with ``gains`` and ``lags_s`` (G,) to set-points (N, 2)."""
    angle = np.repeat(asked[0][:, None], len(gains), axis=1)
    rate = np.zeros_like(angle)
    keep, response = np.exp(-step_s / lags_s), np.empty((len(asked), *angle.shape))
    for k, wanted in enumerate(asked):
        response[k] = angle
        target = gains * (wanted[:, None] - angle)
        after = target + (rate - target) * keep
        angle, rate = angle + 0.5 * step_s * (rate + after), after
    return response


HORIZONS_MS = (20, 40, 60, 100)
"""Times ahead at which predictions are judged [ms]."""
AT_MS = 60
"""At this one tables tell of it, and the filter that is told nothing is judged."""
NEAR = 0.25
"""The pose that judges a prediction lies within this share of its horizon."""
BASE_S = 0.05
"""v of p + v t is over this time [s]; constant acceleration takes twice as long."""
SETTLING_S = 0.5
"""Settling time before the filter is judged [s]."""
LIFTED_M = 0.2
"""A vehicle that begins, or ends, on the floor flies while it is this far above it [m]."""
STANDS_S = 0.5
"""Time within which a standing vehicle keeps its height [s]."""
STANDS_M = 0.003
"""Largest range of its height in that time [m]."""
MOVES_M_S = 0.3
"""Least speed at which noise along the motion is measured [m/s]."""
LEAST_MOVING = 50
"""Least number of such differences [-]."""
LEAST_UPRIGHT = 0.5
"""Nobody leans further than 60° without falling: cosine of the angle from upright [-]."""
BREAK_S = 0.5
"""After so long without a pose the filter begins anew [s]."""
LOOKED_AT_S = 180.0
"""Length of a flight used for identification [s]: its fits take longer than all judging."""
LEAST_FLOWN_S = 3.0
"""A shorter hop tells nothing: the filter has hardly found what is not told of the thrust [s]."""
LEAST_POSES = 50
"""Fewer poses tell nothing."""
STILL_M = 0.001
"""Motion of the mean over half a second below which a vehicle never flew [m]."""


@dataclass(frozen=True)
class EvidenceFlight:
    """A flight as its recording has it, and what was known of its vehicle."""

    path: Path
    source: str
    poses: list[Pose]
    may_fly: list[bool]
    sent: list[ImportedSetpoint]
    hover: float | None
    """Thrust signal that hovers, where the source told."""
    told: MappedVehicle
    config: Config | None
    """Configuration of our own controller; None for flights of others."""
    left_out: dict[str, int]
    """Number of entries changed or left out at the import, by reason."""

    @property
    def commands_attitude(self) -> bool:
        """Whether attitudes were commanded, and not body rates."""
        return bool(self.sent) and self.sent[0].attitude is not msgspec.UNSET


def load_flight(path: Path) -> EvidenceFlight:
    """The flight in the recording ``path``, ours or imported.

    Raises:
        ConfigError: it is none, or holds too few poses.
    """
    poses: list[Pose] = []
    flags: list[bool] = []
    sent: list[ImportedSetpoint] = []
    try:
        recording = Recording(path)
        ours = "imported" not in recording.about
        may_fly, config = not ours, None
        if ours:
            config = read_flown_config(recording.about, recording.path).config
        for entry in recording.entries((MEASURED, SETPOINT, STATE, "/command", "/idle")):
            if entry.topic == MEASURED:
                poses.append(read_pose(msgspec.json.decode(entry.data, type=MeasuredMessage)))
                flags.append(may_fly)
            elif entry.topic == SETPOINT:
                sent.append(msgspec.json.decode(entry.data, type=ImportedSetpoint))
            elif entry.topic == STATE:
                may_fly = msgspec.json.decode(entry.data, type=ImportedState).may_fly
            else:
                may_fly, value = entry.topic == "/command", entry.value()
                assert config is not None, "only we record commands of ours"
                share = value["thrust_n"] / config.full_thrust_n
                rates = msgspec.convert(
                    value["rates_rad_s"], ImportedSetpoint.__annotations__["rates_rad_s"].__args__[0]
                )
                sent.append(ImportedSetpoint(value["time_s"], signal(share, config.thrust_curve), rates))
    except NoRecording as error:
        raise ConfigError("FLIGHT", str(error)) from None
    except ValueError as error:
        raise ConfigError("FLIGHT", str(error), str(path)) from None
    except OSError as error:
        raise ConfigError("FLIGHT", f"cannot read it: {error.strerror}", str(path)) from None
    if len(poses) < LEAST_POSES:
        says = f"holds {len(poses)} poses, which tell nothing: {LEAST_POSES} are the least"
        raise ConfigError("FLIGHT", says, str(path))
    about = recording.about
    hover = float(about["hover"]) if about.get("hover") else None
    told = msgspec.json.decode(about["vehicle_told"], type=MappedVehicle) if not ours else _told_by(config)
    source = about.get("source", "simulation" if about.get("scenario") else "our own")
    left_out = msgspec.json.decode(about.get("notes", "{}"), type=dict[str, int])
    return EvidenceFlight(path, source, poses, flags, sent, hover, told, config, left_out)


def _told_by(config: Config | None) -> MappedVehicle:
    assert config is not None, "a flight of ours has its configuration"
    v = config.vehicle
    return MappedVehicle(
        mass_kg=v.mass_kg,
        thrust_lag_s=max(v.thrust_lag_s, 1e-4),
        rate_lag_s=max(v.rate_lag_s, 1e-4),
        thrust_curve=config.thrust_curve,
    )


class PoseNoise(NamedTuple):
    """Noise of the poses that move, from what no smooth motion leaves of five in a row.

    It is no less than what rounding leaves of their numbers: where hardly anything moves, neighbours are the same.
    """

    along_m: float
    across_m: float
    """Per axis."""
    jitter_s: float
    """Jitter of the stamps, 1σ [s]: the excess of noise along the motion over noise across, over the speed."""


def take_differences(at_s: Column, place: Column, stride: int = 1) -> tuple[Column, Column, Column, Column]:
    """Divided differences of five positions ``stride`` apart: smooth motion leaves nothing of them.

    Divided differences of fourth order leave nothing of any cubic, however the stamps lie; of noise they have the
    deviation. Positions are (N, 3) [m], at ``at_s`` (N,) [s].

    Returns:
        Differences (M, 3) [m]; the share that each of the five has in their square (5, M) [-]; how long the five take
        (M,) [s]; the way from the first to the last (M, 3) [m].
    """
    times, points = (_take_fives(of, stride) for of in (at_s, place))
    apart = times[:, None] - times[None] + np.eye(5)[:, :, None]
    weights = 1.0 / apart.prod(axis=1)
    squares = weights**2
    left = (weights[:, :, None] * points).sum(axis=0) / np.sqrt(squares.sum(axis=0))[:, None]
    return left, squares / squares.sum(axis=0), times[4] - times[0], points[4] - points[0]


def _take_fives(of: Column, stride: int) -> Column:
    """Five rows of ``of`` each ``stride`` after the one before, (5, M, ...)."""
    return np.stack([of[k * stride : len(of) - (4 - k) * stride] for k in range(5)])


class SortedDifferences(NamedTuple):
    """Differences of five positions each, by direction.

    The last is along their motion; the first is where stamps that are off show least, as five that turn have a plane
    of motion and not only a direction.
    """

    squares: Column
    """Along each direction (M, 3) [m²]."""
    by_stamps: Column
    """Addition by stamps that are off by a second (M, 3) [m²]."""
    moves: Column
    """Which of them are fast enough to show jitter of stamps (M,)."""
    apart_s: Column
    """Mean spacing of the five (M,) [s]."""

    def find_stamps(self) -> tuple[float, float]:
        """Estimate the variance of the stamps [s²], and of the positions in the plane of motion without it [m²].

        Both are what the motion's two own directions have in common and where they differ.
        """
        (_, turned, along), (_, least, most) = (of[self.moves].mean(axis=0) for of in (self.squares, self.by_stamps))
        jitter2 = max(0.0, float((along - turned) / (most - least)))
        return jitter2, max(0.0, float(turned - jitter2 * least))

    def find_across(self, jitter2: float, noise2: float) -> float:
        """Mean variance of the three axes, of stamps that are off (``jitter2`` [s²]) as little as may be [m²].

        If they are, the plane of motion stands in for its own direction where they add less than ``noise2`` [m²], and
        elsewhere what is out of that plane for both.
        """
        whole = self.squares.mean(axis=1)
        if jitter2 == 0.0:
            return float(whole.mean())
        out, turned, _ = self.squares.T
        _, by_turn, by_way = jitter2 * self.by_stamps.T
        slow = np.logical_not(self.moves) & (by_way <= noise2)
        beside = np.where(by_turn <= noise2, (out + 2.0 * (turned - by_turn)) / 3.0, out)
        return max(0.0, float(np.where(slow, whole, beside).mean()))


def sort_differences(at_s: Column, place: Column, stride: int = 1, known: Column | float = 0.0) -> SortedDifferences:
    """Sort the differences of fives without a gap, less the motion ``known``; see :func:`take_differences`."""
    left, shares, span, way = take_differences(at_s, place, stride)
    left = left - take_differences(at_s, known, stride)[0] if isinstance(known, np.ndarray) else left
    whole = span < 1.5 * np.median(span)
    reach = max(1, round(0.5 * BASE_S / float(np.median(np.diff(at_s)))))
    row = np.arange(len(at_s))
    after, before = np.minimum(row + reach, len(row) - 1), np.maximum(row - reach, 0)
    velocity = (place[after] - place[before]) / (at_s[after] - at_s[before])[:, None]
    five = _take_fives(velocity, stride)[:, whole]
    by_stamps, directions = np.linalg.eigh(np.einsum("km,kmi,kmj->mij", shares[:, whole], five, five))
    moves = np.linalg.norm(way[whole], axis=1) > MOVES_M_S * span[whole]
    squares = np.einsum("mi,mij->mj", left[whole], directions) ** 2
    return SortedDifferences(squares, by_stamps, moves, 0.25 * span[whole])


LASTS = 1.7
"""Growth of noise along the motion over twice the spacing, from which it is the source's own error [-]: jitter of
stamps adds the same over any spacing."""
OFTEN = 600
"""Least number of moving differences for that test [-]."""


def measure_pose_noise(at_s: Column, place: Column) -> PoseNoise:
    """Measure the noise of positions (N, 3) [m] at ``at_s`` (N,) [s]; all zero for too few."""
    if len(at_s) < 10:
        return PoseNoise(0.0, 0.0, 0.0)
    found, steps = sort_differences(at_s, place), find_resolution(place)
    rounded = float((np.where(np.isfinite(steps), steps, 0.0) ** 2).mean()) / 12.0
    if np.count_nonzero(found.moves) < LEAST_MOVING:
        still = math.sqrt(max(float(found.squares.mean()), rounded))
        return PoseNoise(still, still, 0.0)
    along, (jitter2, in_plane) = float(found.squares[found.moves, 2].mean()), found.find_stamps()
    later = sort_differences(at_s, place, 2)
    if np.count_nonzero(later.moves) >= OFTEN and later.find_stamps()[0] > LASTS * jitter2:
        jitter2 = 0.0
    across = max(found.find_across(jitter2, in_plane), rounded)
    return PoseNoise(math.sqrt(along), math.sqrt(across), math.sqrt(jitter2))


LEAST_NOISE_M = 1e-6
"""No source is better [m]."""
WANDER_S = 0.06
"""Largest spacing of poses at which the source's wander is measured [s]."""
SPACINGS = 6
"""Number of spacings up to it [-]."""
ROAMED = 20.0 / 70.0
"""Variance that a position of density 1, a random walk, leaves of such a difference, over the spacing: third
differences of its steps, which are white, have 1 + 9 + 9 + 1, over 70 as above."""
WANDERED = (6.0 * 2.0 / 3.0 - 8.0 / 6.0) / 70.0
"""Coefficient of a velocity's random walk over the spacing's cube [-]: second differences of its integral have 2/3
and, between neighbours, 1/6; fourth ones 6 · 2/3 - 8 · 1/6."""
CHANCE = 3.0
"""Without a wander of the position the others miss what differences show by 1/√N (1σ), of N poses: so many times that
is no chance [-]."""


class Wander(NamedTuple):
    """Errors of a source beside the white noise of its positions."""

    position: float
    """Its own random walk: errors that last longer than from pose to pose [m/√s]."""
    velocity: float
    """Random walk of the velocity, as GPS or an autopilot's own filter makes it [m/s² per √Hz]."""


def measure_wander(at_s: Column, place: Column, known: Column | float = 0.0) -> Wander:
    """Measure the wander of the source; with a ``known`` motion (N, 3) [m], also the wander of that.

    White noise is the same over any spacing h of the poses; a random walk of the position grows with h, one of the
    velocity with h³. The three that fit best, none below 0, make up what differences show over several spacings.
    """
    longest = max(2, round(WANDER_S / float(np.median(np.diff(at_s)))))
    if len(at_s) < 60 * longest:
        return Wander(0.0, 0.0)
    noise = measure_pose_noise(at_s, place)
    strides = np.unique(np.linspace(1.0, longest, SPACINGS).round().astype(int)).tolist()
    seen = [sort_differences(at_s, place, stride, known) for stride in strides]
    shown = np.array([one.find_across(noise.jitter_s**2, noise.across_m**2) for one in seen])
    variances = np.maximum(shown, LEAST_NOISE_M**2)
    apart_s = np.array([float(one.apart_s.mean()) for one in seen])
    grows = np.stack([np.ones(len(seen)), ROAMED * apart_s, WANDERED * apart_s**3], axis=1) / variances[:, None]
    weights = np.sqrt(variances)
    (_, moves), left = _fit_from_zero(grows[:, [0, 2]], weights)
    if left * len(at_s) <= CHANCE**2 * variances[0]:
        return Wander(0.0, math.sqrt(moves))
    (_, roams, moves), _ = _fit_from_zero(grows, weights)
    return Wander(math.sqrt(roams), math.sqrt(moves))


def _fit_from_zero(columns: Column, weights: Column) -> tuple[list[float], float]:
    """Factors, none below 0, by which ``columns`` (N, P) add up to 1 in each row as well as may be; what is left."""
    n, best, least = columns.shape[1], [0.0] * columns.shape[1], math.inf
    for some in product((False, True), repeat=n):
        chosen = columns[:, some]
        factors = np.linalg.lstsq(chosen * weights[:, None], weights, rcond=None)[0]
        left = float(((weights * (chosen @ factors - 1.0)) ** 2).sum())
        if (factors >= 0.0).all() and left < least:
            rest, least = iter(factors.tolist()), left
            best = [next(rest) if one else 0.0 for one in some]
    return best, least


DRIFT_S = 0.2
"""Over this spacing of poses it shows how an acceleration that is not told wanders [s]."""
DRIFTED = 2.0 * (11.0 / 20.0 - 13.0 / 60.0) / 70.0
"""Variance that an acceleration of density 1, a random walk, leaves of such a difference, over the fifth power of the
spacing: third differences of its double integral have 11/20 and, between neighbours, 13/60; fourth ones as above."""
BURSTS = 2.0
"""An acceleration that nobody tells may jump in bursts, which make most of the error: at most so many times the mean
counts [-]."""
LEAST_DENSITY = 1e-3
"""Density assumed for a noise that does not show [m/s² or m/s³ per √Hz]: the filter's noise is never nought."""
RATE_DENSITY = 0.2
"""Density of the rate of such an acceleration, which never shows beside it [m/s⁴ per √Hz]."""
RATE_SHARE = 5.0
"""Largest ratio of that density to the acceleration's own [1/s]."""


class Drift(NamedTuple):
    """Random walk of the acceleration that moves the positions."""

    mean: float
    """Over all of them; what chance may hide where none is seen [m/s³ per √Hz]."""
    bursts: float
    """Where most of it is, over the mean: 1 for Gaussian noise, which is the same at all times [-]."""


def measure_drift(at_s: Column, place: Column, wander: Wander) -> Drift:
    """Measure the random walk of the acceleration, beside the ``wander`` of the source."""
    stride = max(2, round(DRIFT_S / float(np.median(np.diff(at_s)))))
    if len(at_s) < 8 * stride:
        return Drift(0.0, 1.0)
    (squares, far), (near_squares, near) = (
        (one.squares.mean(axis=1), one.apart_s) for one in (sort_differences(at_s, place, some) for some in (stride, 1))
    )
    seen, white = float(squares.mean()), float(near_squares.mean())
    longer, longer3, longer5 = (float((far**power).mean() - (near**power).mean()) for power in (1, 3, 5))
    grown = seen - white - ROAMED * wander.position**2 * longer - WANDERED * wander.velocity**2 * longer3
    hidden = seen / math.sqrt(len(squares))
    bursts = (float((squares**2).mean()) / (5.0 / 3.0 * seen**2)) ** 0.25 if seen else 1.0
    return Drift(math.sqrt(max(hidden, grown) / (DRIFTED * longer5)), min(max(bursts, 1.0), BURSTS))


def find_airborne(at_s: Column, place: Column, may_fly: Sequence[bool]) -> slice:
    """The poses from the first to the last that fly: not those that stand on the floor before and after."""
    first, end = 0, len(at_s)
    if any(may_fly):
        first, end = may_fly.index(True), len(may_fly) - list(may_fly)[::-1].index(True)
    up = -place[:, 2]
    window = max(5, int(STANDS_S / max(float(np.median(np.diff(at_s))), 1e-3)))

    def count_standing(heights: Column) -> int:
        """Count the ``heights`` before it leaves the floor; 0 where it did not stand."""
        stand = heights[:window]
        off = np.flatnonzero(heights > float(np.median(stand)) + LIFTED_M)
        return int(off[0]) if float(np.ptp(stand)) < STANDS_M and len(off) else 0

    before, after = count_standing(up[first:end]), count_standing(up[first:end][::-1])
    return slice(first + before, end - after)


def stands(at_s: Column, place: Column) -> bool:
    """Whether it never moves at all: of nothing that flies can that be said."""
    window = max(1, int(STANDS_S / float(np.median(np.diff(at_s)))))
    whole = place[: len(place) // window * window].reshape(-1, window, 3).mean(axis=1)
    return len(whole) > 1 and float(np.ptp(whole, axis=0).max()) < STILL_M


def why_not_judged(flight: EvidenceFlight, at_s: Column, place: Column) -> str:
    """Why nothing can be said of the part that flies; empty where it can."""
    if not any(flight.may_fly):
        return "its autopilot says that it is on the ground all the time: nothing flies in it"
    if stands(at_s, place):
        return "it stands all the time: nothing flies in it"
    flown_s = float(at_s[-1] - at_s[0])
    return f"it flies for {flown_s:.1f} s: {LEAST_FLOWN_S:g} s are the least" if flown_s < LEAST_FLOWN_S else ""


def choose_part(at_s: Column, air: slice) -> slice:
    """The longest part of ``air`` without a break, and at most :data:`LOOKED_AT_S` of it."""
    breaks = np.flatnonzero(np.diff(at_s[air]) > BREAK_S) + air.start + 1
    edges = [air.start, *breaks.tolist(), air.stop]
    first, end = max(pairwise(edges), key=lambda part: float(at_s[part[1] - 1] - at_s[part[0]]))
    return slice(first, min(end, int(np.searchsorted(at_s, at_s[first] + LOOKED_AT_S))))


def cut_to(recorded: RecordedVehicle, at_s: Column, air: slice) -> RecordedVehicle:
    """``recorded`` around that part of it; as it is where that part is all that flies."""
    part = choose_part(at_s, air)
    if part == air:
        return recorded
    begun, ended = float(at_s[part.start]), float(at_s[part.stop - 1])
    return recorded._replace(
        poses=recorded.poses[part], sent=[one for one in recorded.sent if begun <= one.time_s <= ended]
    )


@dataclass(frozen=True)
class DrivenFlight:
    """A flight with its commands as thrust and body rates, at the instants they left."""

    flight: EvidenceFlight
    air: slice
    at_s: Column
    place: Column
    recorded: RecordedVehicle
    shares: list[float]
    """Thrust of each command as a share of the full one."""
    hover: float | None
    """Share of full thrust that carries it."""
    config: Config
    """Configuration of the filter."""
    loop: AttitudeLoop | None
    """The autopilot's, where attitudes were commanded and were followed."""

    def list_commands(self) -> list[tuple[float, ActuatorCommand]]:
        """When each left [s], and its thrust [N] and rates [rad/s]."""
        full_n = self.config.full_thrust_n
        return [
            (sent.time_s, ActuatorCommand(full_n * share, sent.rates))
            for sent, share in zip(self.recorded.sent, self.shares, strict=True)
        ]


def join_origins(at_s: Column, place: Column, resets: Sequence[int]) -> Column:
    """Positions (N, 3) [m] as they would have been, had their origin never moved: where it did, velocity goes on."""
    step, joined = np.diff(place, axis=0), np.zeros_like(place)
    for k in (np.flatnonzero(np.diff(resets)) + 1).tolist():
        before = step[k - 2] / (at_s[k - 1] - at_s[k - 2]) if k > 1 else 0.0
        joined[k:] += before * (at_s[k] - at_s[k - 1]) - step[k - 1]
    return place + joined


def drive_flight(flight: EvidenceFlight) -> DrivenFlight:
    """Find the part that flies, and what drives it there.

    Raises:
        ConfigError: hardly anything of it flies.
    """
    at_s = np.array([pose.time_s for pose in flight.poses])
    place = np.array([pose.position_ned for pose in flight.poses])
    place = join_origins(at_s, place, [pose.reset_count for pose in flight.poses])
    air = find_airborne(at_s, place, flight.may_fly)
    if air.stop - air.start < LEAST_POSES:
        says = f"holds {air.stop - air.start} poses of a flight, which tell nothing: {LEAST_POSES} are the least"
        raise ConfigError("FLIGHT", says, str(flight.path))
    sent, loop = _as_rates(flight, at_s, air)
    inside = [air.start <= k < air.stop for k in range(len(at_s))]
    poses = [RecordedPose(pose, may) for pose, may in zip(flight.poses, inside, strict=True)]
    recorded = RecordedVehicle("", flight.source, poses, sent, {})
    curve, hover, config = flight.told.thrust_curve, None, flight.config
    shares = thrust_shares(sent, curve)
    if sent and config is None:
        if flight.hover is not None:
            hover = thrust_shares([SentSetPoint(0.0, flight.hover, (0.0, 0.0, 0.0))], curve)[0]
        else:
            path, part = FlownPath(flight.poses, BASE_S * 5.0), cut_to(recorded, at_s, air)
            hover = hover_share(part, thrust_shares(part.sent, curve), path, GRAVITY)
            hover = hover if hover and hover > 0.0 else _balance(flight, at_s, air, sent, shares)
            flags = flying(recorded, shares, hover)
            airborne = np.flatnonzero(flags)
            if len(airborne) > len(flags) // 4:
                air = slice(int(airborne[0]), int(airborne[-1]) + 1)
    if config is None:
        config = _config(flight.told, hover, sent)
    return DrivenFlight(flight, air, at_s, place, recorded, shares, hover, config, loop)


def _config(told: MappedVehicle, hover: float | None, sent: Sequence[SentSetPoint], **more: float) -> Config:
    period = float(np.median(np.diff([one.time_s for one in sent]))) if len(sent) > 1 else 0.01
    vehicle: dict[str, Any] = {
        "name": "recorded",
        "mass_kg": told.mass_kg,
        "thrust_max_n": told.mass_kg * GRAVITY / (hover or 0.5),
        "thrust_min_n": 1e-3 * told.mass_kg,
        "thrust_lag_s": told.thrust_lag_s,
        "thrust_delay_s": told.thrust_delay_s,
        "rate_lag_s": told.rate_lag_s,
        "thrust_curve": told.thrust_curve,
        "frame_period_s": min(max(period, 0.001), 0.2),
        **more,
    }
    return from_dict({"vehicle": vehicle}, Config)


def _balance(
    flight: EvidenceFlight, at_s: Column, air: slice, sent: Sequence[SentSetPoint], shares: Sequence[float]
) -> float | None:
    """The share that carries it on average, where it is never level and slow for long."""
    upright = [so3.third_column(pose.attitude)[2] for pose in flight.poses]
    times = np.array([one.time_s for one in sent])
    inside = (times > at_s[air][0]) & (times < at_s[air][-1])
    if not inside.any():
        return None
    share = float((np.array(shares)[inside] * np.interp(times[inside], at_s, upright)).mean())
    return share if share > 0.0 else None


def _as_rates(flight: EvidenceFlight, at_s: Column, air: slice) -> tuple[list[SentSetPoint], AttitudeLoop | None]:
    """Return the commands as thrust and body rates, and the attitude loop where attitudes were commanded."""
    sent = flight.sent
    if not sent:
        return [], None
    if all(one.rates_rad_s is not msgspec.UNSET for one in sent):
        return [SentSetPoint(one.time_s, one.thrust, _rates(one)) for one in sent], None
    times = np.array([one.time_s for one in sent])
    signals = np.array([one.thrust for one in sent])
    attitudes = [pose.attitude for pose in flight.poses]
    spans = np.diff(at_s)
    turned = np.array([so3.turn_between(a, b) for a, b in zip(attitudes, attitudes[1:], strict=False)]) / spans[:, None]
    wanted = [(a.w, a.x, a.y, a.z) for one in sent if (a := one.attitude) is not msgspec.UNSET]

    def ask(shift_s: float) -> Column:
        """Body rates at each pose, (N, 3)."""
        if len(wanted) < len(sent):  # thrust alone: it turns as it turned last
            return np.concatenate([turned[:1], turned])
        newest = np.clip(np.searchsorted(times, at_s - shift_s, "right") - 1, 0, None)
        return flight.told.attitude_p * np.array(
            [so3.turn_between(q, wanted[k]) for q, k in zip(attitudes, newest, strict=True)]
        )

    loop = None
    if len(wanted) == len(sent):
        part = choose_part(at_s, air)
        roll_pitch = [np.array([so3.euler_zyx(q)[:2] for q in some]) for some in (attitudes[part], wanted)]
        loop = fit_attitude_loop(at_s[part], roll_pitch[0], times, roll_pitch[1])
    shift_s = loop.delay_s if loop else 0.0
    asked = ask(shift_s)
    newest = np.clip(np.searchsorted(times, at_s - shift_s, "right") - 1, 0, None)
    return [
        SentSetPoint(at, float(signals[k]), (x, y, z))
        for at, k, (x, y, z) in zip(at_s.tolist(), newest.tolist(), asked.tolist(), strict=True)
    ], loop


def _rates(sent: ImportedSetpoint) -> Vec3:
    w = sent.rates_rad_s
    assert w is not msgspec.UNSET, "asked for before"
    return w.x, w.y, w.z


def identify_vehicle(driven: DrivenFlight) -> dict[str, Any]:
    """Identify the vehicle by parameter: value and 95 % interval, or the reason for having none."""
    recorded = driven.recorded
    commands = np.array([(one.time_s, *one.rates) for one in recorded.sent])
    full = driven.config.full_thrust_n
    thrust = full * np.array(driven.shares)
    poses = np.array([(p.time_s, p.reset_count, 0.0, *p.position_ned, *p.attitude) for p in driven.flight.poses])
    poses[choose_part(driven.at_s, driven.air), 2] = 1.0
    path = driven.flight.path
    try:
        chosen = poses[find_stretch(commands[:, 0], poses)]
        parts = (commands[:, 0], thrust, commands[:, 1:4], chosen[:, 0], chosen[:, 3:6], chosen[:, 6:10])
        if not len(chosen) or chosen[-1, 0] - chosen[0, 0] < LEAST_S:
            raise StretchTooShort(f"less than {LEAST_S:g} s of unbroken flight")
        found = identify(FlightStretch(path, Recording(path), driven.config, *parts))
    except (StretchTooShort, np.linalg.LinAlgError, ValueError, ZeroDivisionError) as error:
        return {"note": f"not identifiable: {error}"}
    result: dict[str, Any] = {}
    for one in found.parameters.values():
        result[one.name] = {"value": one.value, "interval": one.interval, "unit": one.unit, "note": one.note}
    if driven.flight.commands_attitude:
        # The rates are ours, made of the set-points: what follows them is told by the attitude loop instead.
        for name in [name for name in result if "rate_" in name]:
            del result[name]
        loop = driven.loop
        named = (("attitude_gain", "1/s"), ("rate_lag", "s"), ("rate_delay", "s"))
        for k, (name, unit) in enumerate(named):
            note = (
                f"explains {loop.explained:.0%} of roll and pitch"
                if loop
                else "attitude does not follow its set-points"
            )
            value, interval = (loop[:3][k], loop.intervals[k]) if loop else (None, None)
            result[name] = {"value": value, "interval": interval, "unit": unit, "note": note}
    return result


class Judged(NamedTuple):
    """Consistency and prediction errors of the filter in one flight."""

    nis3: float | None
    prediction: dict[str, dict[str, float] | None]


SETTLED = 200
"""Number of poses after which a filter's gain is stationary [-]."""
HALVINGS = 20
"""Number of steps of the search for the configured noise [-]."""
LEAST_SHARE = 0.05
"""Least share of a position's configured wander [-]."""


def match_wander(wander: Wander, noise_m: float, period_s: float, told: Estimation, least: float) -> Estimation:
    """``told``, and of a source that wanders what makes the filter as sure as it is good.

    The filter counts what an interval adds to the velocity, and not what it adds to the position by its end; and it
    takes for noise what the wander leaves of the differences of poses. Both make it less sure than it is good, by up
    to half. So the variance of its innovations, as its gain makes them of such a source, is worked out beside the one
    that it claims: no flight is needed for either. First for the velocity alone, and then for the position.
    ``acceleration_noise`` is ``least`` at least.
    """
    roams2, wander2 = wander.position**2, wander.velocity**2
    without = msgspec.structs.replace(told, pose_wander=0.0)

    def claims_more(told: Estimation, roams2: float) -> bool:
        left = noise_m**2 - ROAMED * roams2 * period_s - WANDERED * wander2 * period_s**3
        claimed, made = _settle(told, roams2, wander2, max(0.0, left), noise_m**2, period_s)
        return claimed > made

    def match(key: str, low: float, high: float, roams2: float) -> Estimation:
        for _ in range(HALVINGS):
            middle = math.sqrt(low * high)
            more = claims_more(msgspec.structs.replace(without, **{key: middle}), roams2)
            low, high = (low, middle) if more else (middle, high)
        return msgspec.structs.replace(without, **{key: high})

    without = match("acceleration_noise", LEAST_DENSITY, max(wander.velocity, LEAST_DENSITY), 0.0)
    without = msgspec.structs.replace(without, acceleration_noise=max(least, without.acceleration_noise))
    if not roams2 or claims_more(without, roams2):
        return without
    return match("pose_wander", LEAST_SHARE * wander.position, wander.position, roams2)


def _settle(
    told: Estimation, roams2: float, wander2: float, white2: float, noise2: float, period_s: float
) -> tuple[float, float]:
    """Variance of its innovations as a filter claims it that is ``told`` this, and as they are [m²].

    Of a source of such densities, whose white noise is ``white2``; the filter takes all of ``noise2`` for it [m²].
    """
    winds = (told.wind_noise**2, told.wind_rate_noise**2)
    chain = np.array([[period_s ** max(k - i, 0) / math.factorial(max(k - i, 0)) for k in range(4)] for i in range(4)])
    chain = np.triu(chain)
    added = np.diag([roams2, wander2, *winds]) * period_s
    added[:2, :2] += wander2 * np.array([[period_s**3 / 3.0, period_s**2 / 2.0], [period_s**2 / 2.0, 0.0]])
    claimed, rates = initial_covariance(noise2), Densities(told.pose_wander**2, told.acceleration_noise**2, *winds)
    error = np.diag([white2, 1.0, 1.0, 0.01])
    for _ in range(SETTLED):
        gain, claimed = update_covariance(claimed, noise2)
        column = np.array(gain)[:, None]
        kept = np.eye(4) - column * np.array([1.0, 0.0, 0.0, 0.0])
        error = chain @ (kept @ error @ kept.T + white2 * column @ column.T) @ chain.T + added
        claimed = predict_covariance(claimed, period_s, rates)
    return float(claimed[PP]) + noise2, float(error[0, 0]) + white2


TOLD = (
    "pose_noise_m",
    "pose_jitter_s",
    "pose_wander",
    "acceleration_noise",
    "wind_noise",
    "wind_rate_noise",
)
"""Noise keys of ``[controller]`` for the filter."""


def tell_noise(driven: DrivenFlight, noise: PoseNoise) -> Estimation:
    """Configure the filter's noise by that of the source, from differences of its positions.

    They tell how what moves the vehicle wanders, too, beside what carries its weight as it leans. Where no command
    tells of it, that counts, and the filter's own figures, which are for a wind beside commands, do not. Where commands
    do, it bounds them: in still air they would take noise for wind.
    """
    at_s, place, told = driven.at_s[driven.air], driven.place[driven.air], driven.config.controller
    across_m, period_s = max(noise.across_m, LEAST_NOISE_M), float(np.mean(np.diff(at_s)))
    jitter_s = noise.jitter_s if noise.along_m**2 > JITTER_SHOWS * noise.across_m**2 else 0.0
    leant = _integrate_lean(driven)
    wander = measure_wander(at_s, place, leant)
    drift = measure_drift(at_s, place - leant, wander)
    wind, least = max(drift.bursts * drift.mean, LEAST_DENSITY), LEAST_DENSITY
    rate = min(RATE_DENSITY, RATE_SHARE * drift.mean + LEAST_DENSITY)
    if driven.recorded.sent:
        wander, share = measure_wander(at_s, place), min(1.0, wind / told.wind_noise)
        wind, rate, least = (share * of for of in (told.wind_noise, told.wind_rate_noise, told.acceleration_noise))
    else:
        jitter_s /= drift.bursts  # a leap lasts: waiting until it is sure of one, the filter would fall behind p + v t
    of_source = msgspec.structs.replace(
        told, pose_noise_m=across_m, pose_jitter_s=jitter_s, wind_noise=wind, wind_rate_noise=rate
    )
    found = match_wander(wander, across_m, period_s, of_source, least)
    # As it is printed, so that a configuration with these lines flies the very filter that is judged.
    return msgspec.structs.replace(found, **{key: float(f"{getattr(found, key):.3g}") for key in TOLD})


def _bear_weight(attitude: Quat) -> float:
    """Thrust over weight that carries the vehicle as it leans [-]."""
    return 1.0 / max(so3.third_column(attitude)[2], LEAST_UPRIGHT)


def _integrate_lean(driven: DrivenFlight) -> Column:
    """Integrate the motion from rest under the thrust that carries it, with each pose's lean held to the next pose.

    That is what the filter knows; how the lean changed meanwhile, and stamps of it that are off, are left to be found.
    """
    leans = [pose.attitude for pose in driven.flight.poses[driven.air]]
    push = np.array([[_bear_weight(attitude) * x for x in so3.third_column(attitude)] for attitude in leans[:-1]])
    push = driven.config.controller.gravity * (np.array([0.0, 0.0, 1.0]) - push)
    h = np.diff(driven.at_s[driven.air])[:, None]
    speed = np.cumsum(h * push, axis=0) - h * push
    return np.concatenate([np.zeros((1, 3)), np.cumsum(h * speed + 0.5 * h * h * push, axis=0)])


LEANS_S = 0.1
"""Time over which an acceleration must show in the lean [s]."""
LEANS_M_S2 = 0.5
"""Least such acceleration to a side [m/s²]."""
LEANS = (0.2, 5.0)
"""On at least one axis the acceleration is between these shares of what the tilt gives, wind and
drag included [-]."""
AGAINST = -0.4
"""On no axis is that share below this, wind and drag included [-]."""


def doubt_attitude(driven: DrivenFlight) -> str:
    """Why its attitudes can't be those of its positions; empty where they can, or where hardly anything moves."""
    at_s, place = driven.at_s[driven.air], driven.place[driven.air]
    k = max(1, round(LEANS_S / float(np.median(np.diff(at_s)))))
    if len(at_s) < 4 * k:
        return ""
    later, sooner = (at_s[2 * k :] - at_s[k:-k])[:, None], (at_s[k:-k] - at_s[: -2 * k])[:, None]
    whole = (np.maximum(later, sooner) < 1.5 * np.median(later))[:, 0]
    went, leant = (
        (2.0 * ((of[2 * k :] - of[k:-k]) / later - (of[k:-k] - of[: -2 * k]) / sooner) / (later + sooner))[whole]
        for of in (place, _integrate_lean(driven))
    )
    shares = []
    for axis in (0, 1):
        seen, given = (of[:, axis] - of[:, axis].mean() for of in (went, leant))
        if float(seen.std()) > LEANS_M_S2:
            shares.append(float((seen * given).sum() / max((given**2).sum(), 1e-12 * (seen**2).sum())))
    if not shares or (any(LEANS[0] < share < LEANS[1] for share in shares) and min(shares) > AGAINST):
        return ""
    told = " and ".join(f"{share:.2g}" for share in shares)
    return (
        f"it accelerates to its sides, but not as its attitude leans ({told} times what that gives): are units and "
        "axes of positions, order and axes of attitudes as the mapping says?"
    )


def imagine_command(before: Pose, pose: Pose, elapsed_s: float, weight_n: float) -> ActuatorCommand:
    """The command that turns the vehicle as it turned, and carries its weight [N] however it leans."""
    x, y, z = (angle / elapsed_s for angle in so3.turn_between(before.attitude, pose.attitude))
    return ActuatorCommand(weight_n * _bear_weight(pose.attitude), (x, y, z))


class MeasuredMotion(NamedTuple):
    """Motion by three poses, without a model: what a filter has to be better than."""

    place: Column
    """Position of the newest [m]."""
    velocity: Column
    """Mean velocity between the two newest [m/s]."""
    tangent: Column
    """Velocity at the newest, by the mean acceleration [m/s]."""
    acceleration: Column
    """Mean acceleration [m/s²]."""

    @classmethod
    def from_poses(
        cls, older: tuple[float, Column], past: tuple[float, Column], newest: tuple[float, Column]
    ) -> "MeasuredMotion":
        """Time [s] and position [m] of each."""
        (older_s, at_first), (past_s, at_second), (now_s, place) = older, past, newest
        velocity = (place - at_second) / (now_s - past_s)
        before = (at_second - at_first) / (past_s - older_s)
        acceleration = (velocity - before) / (0.5 * (now_s - older_s))
        return cls(place, velocity, velocity + 0.5 * (now_s - past_s) * acceleration, acceleration)

    def extrapolate(self, ahead_s: float) -> tuple[Column, Column, Column]:
        """Positions [m] on a straight line and on a parabola ``ahead_s`` [s] later, and the velocity there [m/s]."""
        straight = self.place + self.velocity * ahead_s
        curved = self.place + self.tangent * ahead_s + 0.5 * self.acceleration * ahead_s**2
        return straight, curved, self.tangent + self.acceleration * ahead_s


def judge_filter(driven: DrivenFlight, gains: Estimation, horizons_ms: Sequence[int] = HORIZONS_MS) -> Judged:
    """Fly the filter over the part that flies, and hold what it predicts against the poses measured then."""
    flight, air, at_s, place = driven.flight, driven.air, driven.at_s, driven.place
    config = driven.config
    estimator, newest = ModelEstimator(config.vehicle, gains), -math.inf
    delay = config.vehicle.command_delay_s
    drives = driven.list_commands()
    weight_n = config.vehicle.mass_kg * gains.gravity
    errors: dict[int, array[float]] = {h: array("d") for h in horizons_ms}  # a flight may have a million poses
    consistency: list[float] = []
    resets = [pose.reset_count for pose in flight.poses]
    usual, k, begun = float(np.median(np.diff(at_s[air]))), 0, -math.inf
    base = max(BASE_S, usual)  # of poses that come more slowly, from one to the next
    targets = {h: np.searchsorted(at_s, at_s + 1e-3 * h - 0.5 * usual) for h in horizons_ms}
    for i in range(air.start, air.stop):
        # Without a velocity that may not be that of its positions: positions are what it is judged by.
        pose, now = msgspec.structs.replace(flight.poses[i], velocity_ned=None), float(at_s[i])
        if now - newest > BREAK_S:
            estimator, begun, k = ModelEstimator(config.vehicle, gains), now, max(k - 1, 0)
        newest = now
        while k < len(drives) and drives[k][0] <= now:
            estimator.add_command(drives[k][0] + delay, drives[k][1])
            k += 1
        if not drives and i > air.start:
            estimator.add_command(now, imagine_command(flight.poses[i - 1], pose, now - float(at_s[i - 1]), weight_n))
        same = i > air.start and resets[i] == resets[i - 1]
        nis = estimator.consistency(pose) if estimator.ready and same else None
        estimator.update(pose)
        if now < begun + SETTLING_S:
            continue
        if nis is not None:
            consistency.append(nis)
        past, older = (int(np.searchsorted(at_s, now - n * base + 0.5 * usual, "right")) - 1 for n in (1, 2))
        if older < air.start or resets[older] != resets[i] or not older < past < i:
            continue
        if now - at_s[older] > 2.0 * base + GAP * usual:
            continue
        measured = MeasuredMotion.from_poses(*((float(at_s[one]), place[one]) for one in (older, past, i)))
        for h, target in targets.items():
            j = int(target[i])
            if j >= air.stop or resets[j] != resets[i] or abs(at_s[j] - now - 1e-3 * h) > NEAR * 1e-3 * h:
                continue
            predicted = np.array(estimator.predict(float(at_s[j])).motion.position) + place[i] - pose.position_ned
            straight, curved, velocity = measured.extrapolate(float(at_s[j]) - now)
            off = (predicted - place[j], straight - place[j], curved - place[j], velocity)
            errors[h].frombytes(np.concatenate(off).tobytes())
    return Judged(
        float(np.mean(consistency)) / 3.0 if consistency else None,
        {str(h): _measure_errors(np.array(some).reshape(-1, 4, 3)) for h, some in errors.items()},
    )


def _measure_errors(some: Column) -> dict[str, float] | None:
    """RMS [mm] over all predictions (N, 4, 3); None where too few poses judge them."""
    if len(some) < 20:
        return None
    ours, straight, curved, motion = some.transpose(1, 0, 2)
    ahead = motion / np.maximum(np.linalg.norm(motion, axis=1, keepdims=True), 1e-9)
    along = (ours * ahead).sum(axis=1)

    def rms(squares: Column) -> float:
        return round(1e3 * math.sqrt(float(squares.mean())), 3)

    squares = (ours**2).sum(axis=1)
    return {
        "along_mm": rms(along**2),
        "across_mm": rms(np.maximum(squares - along**2, 0.0)),
        "rms_mm": rms(squares),
        "pvt_rms_mm": rms((straight**2).sum(axis=1)),
        "ca_rms_mm": rms((curved**2).sum(axis=1)),
    }


def examine_flight(path: Path) -> dict[str, Any]:
    """All that one recorded flight tells, as ``--json`` prints it.

    Raises:
        ConfigError: see :func:`load_flight`.
    """
    driven = drive_flight(load_flight(path))
    flight, air = driven.flight, driven.air
    at_s, place = driven.at_s[air], driven.place[air]
    spans = np.diff(at_s)
    whole = spans[spans <= BREAK_S] if (spans <= BREAK_S).any() else spans
    noise = measure_pose_noise(at_s, place)
    why = "" if flight.config is not None else why_not_judged(flight, at_s, place)
    flew = not why
    judged, untold = Judged(None, {str(h): None for h in HORIZONS_MS}), Judged(None, {str(AT_MS): None})
    told: dict[str, float] = {}
    if flew:
        gains = tell_noise(driven, noise)
        told = {key: getattr(gains, key) for key in TOLD}
        judged = judge_filter(driven, gains)
        untold = judge_filter(driven, driven.config.controller, (AT_MS,))
    facts: dict[str, Any] = {
        "name": flight.path.stem,
        "source": flight.source,
        "flown_s": round(float(whole.sum()), 2),
        "pose_hz": round(len(whole) / float(whole.sum()), 2),
        "gap_max_ms": round(1e3 * float(spans.max()), 2),
        "jitter_ms": round(1e3 * noise.jitter_s, 3),
        "noise_across_mm": round(1e3 * noise.across_m, 4),
        "noise_along_mm": round(1e3 * noise.along_m, 4),
        "told": told,
        "nis3": judged.nis3,
        "prediction": judged.prediction,
        "untold": untold._asdict(),
    }
    if flight.left_out:
        facts["left_out"] = flight.left_out
    if not flew:
        facts["note"] = why
    elif doubt := doubt_attitude(driven):
        facts["doubt"] = doubt
    if flight.sent and flew:
        facts["identified"] = identify_vehicle(driven)
        part = cut_to(driven.recorded, driven.at_s, air)
        shadow = replay(part, driven.config, FlownPath(flight.poses, 0.25), driven.hover)
        facts["shadow"] = msgspec.to_builtins(compare_commands(shadow.compared))
    elif flight.sent:
        facts["identified"] = {"note": f"not identifiable: {why}"}
    return facts


def evidence_command(paths: Sequence[Path], write: Path | None, part: str, *, as_json: bool) -> Exit:
    """Print what the recordings at ``paths`` tell, or put it between the markers ``part`` of a page; returns 0.

    Raises:
        ConfigError: one of them is no recording of a flight, or the page can't be written.
    """
    if write is not None:
        split_at_markers(write, part)  # before minutes go by
    flights = [examine_flight(path) for path in paths]
    if write is not None:
        replace_between_markers(write, "\n".join(tabulate_flights(flights)), part)
        print(f"{write} written")
        return Exit.DONE
    print(json.dumps({"flights": flights}) if as_json else "\n\n".join(map(describe_flight, flights)))
    return Exit.DONE


def describe_flight(facts: dict[str, Any]) -> str:
    """Describe the figures as lines."""
    lines = [
        f"{facts['name']} ({facts['source']}): {facts['flown_s']:.1f} s in the air, "
        f"{facts['pose_hz']:.1f} poses/s, longest gap {facts['gap_max_ms']:.0f} ms",
        f"  noise {facts['noise_across_mm']:.3f} mm across the motion, {facts['noise_along_mm']:.3f} mm along it; "
        f"stamps off by {facts['jitter_ms']:.2f} ms; NIS/3 {_text(facts['nis3'])}",
        f"  {'prediction, RMS mm':22}{'along':>9}{'across':>9}{'all':>9}{'p + v t':>9}{'const. a':>9}",
    ]
    if "doubt" in facts:
        lines.insert(1, f"  {facts['doubt']}")
    keys = ("along_mm", "across_mm", "rms_mm", "pvt_rms_mm", "ca_rms_mm")
    if "note" in facts:
        lines[-1] = f"  {facts['note']}"
    for horizon, row in facts["prediction"].items() if "note" not in facts else ():
        cells = "".join(f"{row[key]:>9.2f}" for key in keys) if row else "  too few poses"
        lines.append(f"  {horizon + ' ms':22}{cells}")
    if "note" not in facts:
        row, nis = facts["untold"]["prediction"][str(AT_MS)], _text(facts["untold"]["nis3"])
        cells = "".join(f"{row[key]:>9.2f}" for key in keys[:3]) if row else "  too few poses"
        lines.append(f"  {f'{AT_MS} ms, told nothing':22}{cells}   NIS/3 {nis}")
        told = ", ".join(f"{key} = {value:g}" for key, value in facts["told"].items())
        lines.append(f"  told in [controller]: {told}")
    for name, one in facts.get("identified", {}).items():
        if name == "note":
            lines.append(f"  {one}")
        elif one["value"] is not None:
            low, high = one["interval"]
            lines.append(f"  {name:22}{one['value']:>9.4g}  {low:.4g} to {high:.4g} {one['unit']}".rstrip())
    lines += [f"  not used as it stands, {reason}: {count}" for reason, count in facts.get("left_out", {}).items()]
    if facts.get("shadow"):
        for name in ("thrust_n", "roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"):
            pair = facts["shadow"][name]
            lines.append(
                f"  shadow {name:18}sent {pair['sent_mean']:.3f} ± {pair['sent_std']:.3f}, "
                f"ours {pair['shadow_mean']:.3f} ± {pair['shadow_std']:.3f}, apart {pair['difference_rms']:.3f}, "
                f"correlation {_text(pair['correlation'])}"
            )
    return "\n".join(lines)


def tabulate_flights(flights: Sequence[dict[str, Any]]) -> list[str]:
    """Make two tables of a page: prediction, and identified parameters."""
    lines = [
        f"| flight | poses/s | noise across, along, mm | stamps off, ms | NIS/3 | at {AT_MS} ms, RMS mm: along "
        "| across | all | p + v t | constant a | told nothing: all | NIS/3 |",
        "|---" * 12 + "|",
    ]
    for one in flights:
        row, untold = one["prediction"][str(AT_MS)], one["untold"]["prediction"][str(AT_MS)]
        keys = ("along_mm", "across_mm", "rms_mm", "pvt_rms_mm", "ca_rms_mm")
        cells = [f"{row[key]:.2f}" for key in keys] if row else ["-"] * 5
        noise = f"{one['noise_across_mm']:.3f}, {one['noise_along_mm']:.3f}"
        head = [f"{one['name']} ({one['source']})", f"{one['pose_hz']:.1f}", noise, f"{one['jitter_ms']:.2f}"]
        cells += [_text(untold and untold["rms_mm"]), _text(one["untold"]["nis3"])]
        lines.append("| " + " | ".join([*head, _text(one["nis3"]), *cells]) + " |")
    names = ("rate_lag", "rate_delay", "attitude_gain", "thrust_lag", "thrust_scale", "drag")
    lines += ["", "| identified (95 %) | " + " | ".join(name.replace("_", " ") for name in names) + " |"]
    lines.append("|---" * (len(names) + 1) + "|")
    for one in flights:
        found = one.get("identified", {})
        lines.append("| " + " | ".join([one["name"], *(_interval(found.get(name)) for name in names)]) + " |")
    return lines


def _interval(found: dict[str, Any] | None) -> str:
    if found is None or found["value"] is None:
        return "-"
    low, high = found["interval"]
    return f"{found['value']:.3g} ({low:.3g} to {high:.3g}) {found['unit']}".rstrip()


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
