"""Has it left the floor? What thrust must do to a vehicle of this weight, held against what the poses show. Sans-IO.

One hypothesis says that it stands, the others that it rises as the thrust told so far makes a vehicle rise which hovers
at 0.5, 0.55, ... 1.6 of the told weight: p¨ = g (T / (s W) - 1), never below the floor, T behind what was told by its
lag. Under each, what is left of the measured height is a random walk (as much as was measured before arming) and white
noise, and a filter of one state gives its likelihood. So thrust near the weight, height above its own wander and an
acceleration that fits are one number: the logarithm of the odds that it flies. The hypotheses together also tell what
thrust hovers and how fast it climbs, before any law needs to know.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from groundstation.core.messages import Pose

SHARES = tuple(0.5 + 0.05 * k for k in range(23))
"""Hover thrust of the hypotheses, as shares of the told weight [-]."""
SPREAD = 0.2
"""How well a told weight, and the thrust that lifts it, are known, 1σ [-]."""
STEP_S = 0.01
"""Longest step of the hypotheses [s]."""
MOVES, FLIES = 3.0, 9.2
"""Logarithms of the odds, 20 and 10,000 to 1, with which it is said to move, and to fly."""
HEIGHT_M, WANDERING_M = 0.015, 0.35
"""Height that it must have for that [m]. The second is of poses that come with a velocity: such a source is an
autopilot that integrates its accelerometers, which feel a lift that the floor has not let go of."""
CLIMBING = 1.1
"""Thrust until then, as a share of what seems to hover [-]."""
LEAST_NOISE_M = 0.0003
"""No pose is believed to less [m]: legs and floor give way as thrust relieves them."""
LEAST_M2_S, LEAST_FELT_M2_S = 1e-6, 2.5e-5
"""No height is believed to wander less: 1 mm in 1 s, and 5 mm where poses come with a velocity [m²/s]."""
SPEED_NOISE_M_S, LEAST_M2_S3 = 0.05, 1e-4
"""The same of speeds: noise, and least wander [m²/s³]."""
FITS_M = 0.02
"""Nothing flies whose newest height is farther than this, beside noise, from where the thrust would have it [m]."""
JUMP_M, JUMPS = 0.1, 2
"""So many poses farther than this from every hypothesis [m] are no motion of a vehicle on its floor."""


class Wander(NamedTuple):
    """How what is measured of a vehicle that stands wanders, as the variance of random walks."""

    aside_m2_s: float
    """Of its place sideways, on the worse axis [m²/s]."""
    height_m2_s: float
    """Of its height [m²/s]."""
    climb_m2_s3: float
    """Of its speed upwards [m²/s³]."""


class _Walks:
    """A measurement less what each hypothesis says, as a random walk and white noise: what is the walk?"""

    def __init__(self, count: int, walk: float, noise: float) -> None:
        """Variance of the ``walk`` per second, and of the ``noise``."""
        self._walk, self._noise = walk, noise
        self._variance = noise
        self._values = [0.0] * count

    def seen(self, elapsed_s: float, off: list[float]) -> tuple[list[float], float]:
        """Take one more, ``elapsed_s`` after the last [s]; returns steps from what was expected, and their variance."""
        variance = self._variance + self._walk * elapsed_s
        total = variance + self._noise
        gain = variance / total
        self._variance = (1.0 - gain) * variance
        steps = [one - value for one, value in zip(off, self._values, strict=True)]
        self._values = [value + gain * step for value, step in zip(self._values, steps, strict=True)]
        return steps, total

    def begin(self, off: list[float]) -> None:
        """The measurement has moved its zero."""
        self._values = off


class LiftOff:
    """One take-off. Times are on the event loop's clock [s], heights are above where it stood [m]."""

    def __init__(
        self,
        stands: Pose,
        down_m: float,
        weight_n: float,
        lag_s: float,
        gravity: float,
        wander: Wander,
        noise_m: float,
    ) -> None:
        """Begin with a vehicle that ``stands``, at ``down_m`` [m, NED] on the mean; thrust lags by ``lag_s`` [s].

        ``noise_m`` is the poses' white noise [m].
        """
        self._floor, self._weight, self._lag, self._gravity = down_m, weight_n, lag_s, gravity
        felt = stands.velocity_ned is not None
        self._climb: float | None = None
        self._least_m = WANDERING_M if felt else HEIGHT_M
        self._resets = stands.reset_count
        self._at = stands.time_s
        self._thrust: float | None = None
        self._told: deque[tuple[float, float]] = deque()
        n = len(SHARES)
        self._paths, self._speeds = [0.0] * n, [0.0] * n
        # The last hypothesis is that it stands.
        least_m2_s = LEAST_FELT_M2_S if felt else LEAST_M2_S
        self._height = _Walks(n + 1, max(wander.height_m2_s, least_m2_s), max(noise_m, LEAST_NOISE_M) ** 2)
        self._speed = _Walks(n + 1, max(wander.climb_m2_s3, LEAST_M2_S3), SPEED_NOISE_M_S**2)
        self._stood_m_s = 0.0 if stands.velocity_ned is None else -stands.velocity_ned[2]
        prior = [math.exp(-0.5 * ((s - 1.0) / SPREAD) ** 2) for s in SHARES]
        self._logs = [math.log(p / sum(prior)) for p in prior] + [0.0]
        self._fits = False
        self._jumps = 0

    def sent(self, acting_s: float, thrust_n: float) -> None:
        """``thrust_n`` [N] is told from ``acting_s`` on."""
        self._told.append((acting_s, thrust_n))

    def pose(self, pose: Pose) -> None:
        """Take one more pose."""
        elapsed = pose.time_s - self._at
        if elapsed <= 0.0:
            return
        self._advance(pose.time_s)
        height = self._floor - pose.position_ned[2]
        off = [height - path for path in (*self._paths, 0.0)]
        if pose.reset_count != self._resets:  # the source has moved its origin, not the vehicle
            self._resets = pose.reset_count
            self._height.begin(off)
            return
        steps, variance = self._height.seen(elapsed, off)
        self._weigh(steps, variance)
        spread = 4.0 * math.sqrt(variance)
        self._fits = abs(self._mean(steps[:-1])) < FITS_M + spread
        self._jumps = self._jumps + 1 if min(map(abs, steps)) > JUMP_M + spread else 0
        if pose.velocity_ned is not None:
            self._climb = -pose.velocity_ned[2]
            gained = self._climb - self._stood_m_s
            self._weigh(*self._speed.seen(elapsed, [gained - speed for speed in (*self._speeds, 0.0)]))

    def _weigh(self, steps: list[float], variance: float) -> None:
        self._logs = [log - 0.5 * step * step / variance for log, step in zip(self._logs, steps, strict=True)]

    @property
    def jumps(self) -> bool:
        """Whether its height does what no thrust explains."""
        return self._jumps >= JUMPS

    @property
    def moves(self) -> bool:
        """Whether something answers to the thrust."""
        return self._odds > MOVES

    @property
    def flies(self) -> bool:
        """Whether it has left the floor."""
        return self._odds > FLIES and self._fits and self._mean(self._paths) > self._least_m

    @property
    def patience_s(self) -> float:
        """How long after it began to move it must fly [s]."""
        return 0.25 + 2.0 * math.sqrt(2.0 * self._least_m / (0.25 * self._gravity))

    @property
    def hover_share(self) -> float:
        """The thrust that seems to hover, as a share of the weight [-]."""
        return self._mean(SHARES)

    @property
    def climbing_share(self) -> float:
        """The thrust that it is to climb with until it is known to fly, as a share of the weight [-]."""
        return CLIMBING * self.hover_share

    @property
    def climb_m_s(self) -> float:
        """How fast it climbs at the newest pose, as that says or else as the hypotheses have it [m/s]."""
        return self._mean(self._speeds) if self._climb is None else self._climb

    @property
    def thrust_n(self) -> float:
        """What the rotors gave at the newest pose, by their lag [N]."""
        return self._thrust or 0.0

    @property
    def _odds(self) -> float:
        best = max(self._logs[:-1])
        return best + math.log(sum(math.exp(log - best) for log in self._logs[:-1])) - self._logs[-1]

    def _mean(self, values: Sequence[float]) -> float:
        """Over the hypotheses that it rises."""
        best = max(self._logs[:-1])
        weights = [math.exp(log - best) for log in self._logs[:-1]]
        return sum(w * value for w, value in zip(weights, values, strict=True)) / sum(weights)

    def _advance(self, until_s: float) -> None:
        """Let every hypothesis rise until then."""
        told, g = self._told, self._gravity
        while self._at < until_s - 1e-9:
            while len(told) > 1 and told[1][0] <= self._at + 1e-9:
                told.popleft()
            h = min(until_s - self._at, STEP_S)
            if len(told) > 1:
                h = min(h, max(told[1][0] - self._at, 1e-6))
            target = told[0][1] if told and told[0][0] <= self._at + 1e-9 else 0.0
            before = target if self._thrust is None else self._thrust
            keep = math.exp(-h / self._lag) if self._lag > 0.0 else 0.0
            self._thrust = target + (before - target) * keep
            lift = 0.5 * (before + self._thrust) / self._weight
            for k, share in enumerate(SHARES):
                a, v = g * (lift / share - 1.0), self._speeds[k]
                height = self._paths[k] + h * (v + 0.5 * h * a)
                rests = height <= 0.0
                self._paths[k], self._speeds[k] = (0.0, 0.0) if rests else (height, v + h * a)
            self._at += h
