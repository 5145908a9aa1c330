"""Image test: do positions move as the commands push, or as a mirrored or turned image of that? Sans-IO.

What the commands push and what the poses show go through one filter each, node by node; what is left is what moved
within some tenths of a second. The evidence for each image of the commands is a log likelihood ratio against a vehicle
that obeys and a picture that stands, summed with fading memory and never below zero.
"""

import math
from collections.abc import Sequence

from groundstation.core.geometry import Vec3

CAP = 6.5
"""Most that one node may say for an image: no single outlier convicts."""
TRACE = 0.02
"""Less evidence is none: noise leaves it, and it would fade for seconds [-]."""
EXPLAINS = 2.0
"""A node that no image explains well counts by so much less [-]."""
WIND_M, WIND_RISES, WIND_FALLS = 0.02, 0.2, 0.03
"""What wind leaves in the position's filter at least, 1σ [m]; how fast more and less of it are learnt from a node."""
WIND_M2 = WIND_M * WIND_M
THETA = 0.6
"""Memory of the filter: what it knows fades by this factor from node to node [-]."""
ALPHA, BETA, GAMMA = 1.0 - THETA**3, 1.5 * (1.0 - THETA**2) * (1.0 - THETA), (1.0 - THETA) ** 3
EXPANDS = 8
"""For so many nodes after the first the filter's memory expands."""
SETTLES = 4
"""So many nodes the filter takes to know velocity and acceleration."""
OPPOSED = 3
"""So many images, the first, oppose the command on an axis or two [-]."""
EXACT_M, SMALLEST_M = 0.005, 0.015
"""So well does an image agree that is one [m], and smaller ones are not told from noise [m]."""


class ImageFilter:
    """Fading-memory filters of second order for what is seen and what was commanded: place, speed and acceleration.

    They begin with the gains of the expanding memory (a parabola through all so far), until those are the smaller ones.
    """

    __slots__ = ("_n", "_seen", "_told")

    def __init__(self, seen: Vec3, told: Vec3) -> None:
        """Nothing is known yet but a first place, seen and commanded [m]."""
        self._n = 0
        self._seen = (*seen, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._told = (*told, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def innovations(self, seen: Vec3, told: Vec3, h: float) -> tuple[Vec3, Vec3]:
        """How far both are from where they were heading ``h`` [s] ago [m]; the state moves on."""
        alpha, beta, gamma = ALPHA, BETA, GAMMA
        if self._n < EXPANDS:
            self._n += 1
            alpha, beta, gamma = _expanding(self._n)
        half, beta, gamma = 0.5 * h, beta / h, gamma / (h * h)
        # Twice the same, written out, as a call and a tuple for each axis take longer than all else.
        x, y, z, u, v, w, a, b, c = self._seen
        x, y, z = x + h * (u + half * a), y + h * (v + half * b), z + h * (w + half * c)  # where it was heading
        i, j, k = seen[0] - x, seen[1] - y, seen[2] - z
        self._seen = (
            x + alpha * i, y + alpha * j, z + alpha * k,
            u + h * a + beta * i, v + h * b + beta * j, w + h * c + beta * k,
            a + gamma * i, b + gamma * j, c + gamma * k,
        )  # fmt: skip
        x, y, z, u, v, w, a, b, c = self._told
        x, y, z = x + h * (u + half * a), y + h * (v + half * b), z + h * (w + half * c)
        p, q, r = told[0] - x, told[1] - y, told[2] - z
        self._told = (
            x + alpha * p, y + alpha * q, z + alpha * r,
            u + h * a + beta * p, v + h * b + beta * q, w + h * c + beta * r,
            a + gamma * p, b + gamma * q, c + gamma * r,
        )  # fmt: skip
        return (i, j, k), (p, q, r)


def _expanding(n: int) -> tuple[float, float, float]:
    """Gains for the ``n``-th point after the first, of the least-squares parabola, but at least the fading ones."""
    if n == 1:
        return 1.0, 1.0, 0.0
    d = (n + 1.0) * (n + 2.0) * (n + 3.0)
    alpha, beta, gamma = 3.0 * (3.0 * n * n + 3.0 * n + 2.0) / d, 18.0 * (2.0 * n + 1.0) / d, 60.0 / d
    return max(alpha, ALPHA), max(beta, BETA), max(gamma, GAMMA)


class Images:
    """The filters, and what they say of each image."""

    def __init__(self, wind: Sequence[float] = (WIND_M2, WIND_M2)) -> None:
        """Nothing seen; ``wind`` is what is known of it [m²]."""
        self.wind = list(wind)
        """Variance of what wind leaves in the filter, across and down [m²]."""
        self.wander = 0.0
        """Variance of what an estimate that wanders adds to that, on each axis [m²]."""
        self.restart()

    def restart(self) -> None:
        """What was seen before counts no more."""
        self.across = self.down = 0.0
        """Evidence for the likeliest image of the two horizontal axes, and for the vertical one mirrored."""
        self._maps = [0.0] * 7
        self.nodes = 0
        """So many the filter knows."""

    def begin(self, time_s: float, position: Vec3, pushed: Vec3) -> None:
        """Filter anew from one instant [s] on; evidence stays.

        Args:
            time_s: of the pose.
            position: as seen [m, NED].
            pushed: where the commands would have taken it, from any point that it was at with any velocity [m, NED].
        """
        self.time_s = time_s
        self._filter = ImageFilter(position, pushed)
        self.nodes = 0

    def node(self, time_s: float, position: Vec3, pushed: Vec3, fade: float, longest_s: float) -> tuple[Vec3, Vec3]:
        """Take one node; returns how far both left their way [m, NED], what is seen and what was commanded.

        Args:
            time_s: of the pose.
            position: as seen [m, NED].
            pushed: where the commands would have taken it, as for :meth:`begin` [m, NED].
            fade: what is left of the evidence so far [-].
            longest_s: a node that takes longer counts less, as what the filter does not know grows with time² [s].
        """
        h = time_s - self.time_s
        self.time_s = time_s
        self.nodes += 1
        seen, told = self._filter.innovations(position, pushed, h)
        if h > longest_s:
            k = (longest_s / h) ** 2
            seen, told = (k * seen[0], k * seen[1], k * seen[2]), (k * told[0], k * told[1], k * told[2])
        if self.nodes > SETTLES:
            self._across(seen[0], seen[1], told[0], told[1], fade)
            self._down(seen[2], told[2], fade)
        return seen, told

    def _across(self, x: float, y: float, cx: float, cy: float, fade: float) -> None:
        """What one node says of the two horizontal axes."""
        xx, yy, xy, yx = x * cx, y * cy, x * cy, y * cx
        told, seen = cx * cx + cy * cy, x * x + y * y
        wind, both = self.wind[0] + self.wander, seen + told
        rest = both - 2.0 * (xx + yy)
        rest = rest if rest < seen else seen
        best = both - 2.0 * max(-xx - yy, abs(xx - yy), abs(xy + yx), abs(xy - yx))
        best = best if best < rest else rest
        if best < rest or self.across > 0.0:  # else it says nothing, as nearly always
            exact = EXACT_M * EXACT_M + self.wander
            images = (-xx - yy, yy - xx, xx - yy, xy + yx, -xy - yx, yx - xy, xy - yx)
            maps = self._maps
            for i, image in enumerate(images):
                off = both - 2.0 * image
                if off < rest or maps[i] > 0.0:
                    opposed = exact if i < OPPOSED else None
                    maps[i] = _sum_evidence(maps[i], fade, rest - off, max(wind, off / EXPLAINS), off, opposed)
            self.across = max(maps)
        self._learn(0, 0.5 * best)

    def _down(self, z: float, c: float, fade: float) -> None:
        """What one node says of the vertical axis."""
        against, along = z + c, z - c
        off, rest, stands = against * against, along * along, z * z
        rest = rest if rest < stands else stands
        if off < rest or self.down > 0.0:
            wind, exact = self.wind[1] + self.wander, EXACT_M * EXACT_M + self.wander
            self.down = _sum_evidence(self.down, fade, rest - off, max(wind, off / EXPLAINS), off, exact)
        self._learn(1, rest if rest < off else off)

    def _learn(self, which: int, best: float) -> None:
        """Learn the variance that wind leaves from a node that the best rival explains but for ``best`` [m²]."""
        wind = self.wind[which]
        if best > wind:
            self.wind[which] = wind + WIND_RISES * (min(best, 9.0 * wind) - wind)
        elif wind > WIND_M2:
            self.wind[which] = max(wind + WIND_FALLS * (best - wind), WIND_M2)


def _sum_evidence(evidence: float, fade: float, gain: float, variance: float, off: float, exact: float | None) -> float:
    """The evidence after a node in which a rival explains all but ``off`` [m²], and ``gain`` [m²] more than the others.

    What is opposed to a command, and answers it as exactly as ``exact`` [m²], is no wind: the wind comes first, and
    commands oppose it. None for what is not opposed.
    """
    says = gain / (2.0 * variance)
    if exact is not None and gain > SMALLEST_M * SMALLEST_M:
        says = max(says, math.log((gain + off + exact) / (off + exact)))
    evidence = evidence * fade + max(-CAP, min(says, CAP))
    return evidence if evidence > TRACE else 0.0
