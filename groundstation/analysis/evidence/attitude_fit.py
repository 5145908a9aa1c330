"""Attitude loop: delay, gain and lag of an autopilot that was commanded attitudes, from how the attitude followed them.

Roll and pitch each follow their set-point u by φ˙ = ω, τ ω˙ = P (u(t - δ) - φ) - ω, with one P, τ and δ for both.
The loop is linear: every (P, τ) of a grid is simulated once, and a delay is a shift of what comes of it. What differs
by a constant is a trim. Intervals are by the jackknife over eight parts of the flight (B. Efron, 1982), and no narrower
than the grid.
"""

from typing import NamedTuple

import numpy as np

from groundstation.analysis.evidence.mapping import Column

GAINS = np.geomspace(1.5, 30.0, 22)
LAGS_S = np.array([0.003, 0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1, 0.125, 0.15, 0.18, 0.22])
LATEST_S, STEP_S = 0.25, 0.01
"""Delays are tried up to so many seconds, one every so many."""
CLOSER = np.geomspace(0.65, 1.0 / 0.65, 9)
"""About the best of the grid, a finer one."""
PARTS = 8
SETTLING_S = 1.0
EXPLAINED = 0.5
"""A loop that explains a smaller share of what the attitude did is none."""
WIDE = 1.96


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
    """Of gain, lag and delay."""


def fit_attitude_loop(at_s: Column, attitude: Column, set_s: Column, wanted: Column) -> AttitudeLoop | None:
    """Fit ``attitude`` (N, 2) at ``at_s`` to the set-points ``wanted`` (M, 2) at ``set_s``, roll and pitch [rad].

    Returns None where too little of what the vehicle did is explained.
    """
    step = float(np.median(np.diff(at_s)))
    time = np.arange(at_s[0], at_s[-1], step)
    settle = round((SETTLING_S + LATEST_S) / step)
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

    def best(errors: Column) -> Column:
        k, one = np.unravel_index(int(errors.argmin()), errors.shape)
        return np.array([gains[one], lags[one], delays[k] * step])

    gains, lags = (grid.ravel() for grid in np.meshgrid(GAINS, LAGS_S, indexing="ij"))
    left = leave(gains, lags)
    for closer in (CLOSER, CLOSER**0.3):
        # Delay, lag and gain make up for each other: each of the likelier delays goes on with a loop of its own.
        total = left.sum(axis=0)
        centres = {int(total[k].argmin()) for k in np.argsort(total.min(axis=1))[:5]}
        around = [np.meshgrid(gains[k] * closer, np.maximum(lags[k] * closer, 1e-3), indexing="ij") for k in centres]
        gains, lags = (np.concatenate([grid[k].ravel() for grid in around]) for k in (0, 1))
        left = leave(gains, lags)
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


def respond(asked: Column, step_s: float, gains: Column, lags_s: Column) -> Column:
    """What loops of these ``gains`` and ``lags_s`` (G,) make of set-points (N, 2) at even steps, (N, 2, G) [rad]."""
    angle = np.repeat(asked[0][:, None], len(gains), axis=1)
    rate = np.zeros_like(angle)
    keep, response = np.exp(-step_s / lags_s), np.empty((len(asked), *angle.shape))
    for k, wanted in enumerate(asked):
        response[k] = angle
        target = gains * (wanted[:, None] - angle)
        after = target + (rate - target) * keep
        angle, rate = angle + 0.5 * step_s * (rate + after), after
    return response
