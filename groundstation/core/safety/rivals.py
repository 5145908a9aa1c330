"""Rivals of a vehicle that obeys: pictures that show a part of it, none, or a mirrored or turned image. Sans-IO.

*Rivals*, along each axis: does the position answer the push, or show a part of it? Second differences of the positions
from node to node are accelerations, a, known to some 0.1 m/s²; those of where the commands alone would have taken the
vehicle are u. What pushes it beside, d = a - u, is wind, or thrust told wrong. While the truth is seen, the wind moves
the picture first, and the law follows: so a new d is believed at once where a has gone with it, and slowly where it has
not.

A coordinate that is not the vehicle's leaves d = -u, whatever the law makes of that. The rivals are pictures that show
no acceleration, a tenth or three tenths of it, or all of it smoothed. Evidence is a log likelihood ratio between them
and a vehicle that obeys in some wind, summed with fading memory and never below zero. And a picture that begins to lie
shows from one pose to the next a rival's share of the speed, where nothing stops or brakes a vehicle like that.

*Answers*. Where the law holds a place, a coordinate that stands is betrayed by nothing: it sees no error. So there the
vehicle is asked by small tones in rates and thrust. By the lean as seen each moves it by a millimetre or two, which no
wind does at just these frequencies, and for long; along the direction that shows least seen is held against told.

*Images*, mirrored or turned, of all axes. What the commands push and what the poses show go through one filter each,
node by node; what is left is what moved within some tenths of a second. The evidence for each image of the commands is
a log likelihood ratio against a vehicle that obeys and a picture that stands, summed with fading memory and never below
zero.
"""

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

from groundstation.core.control import ASK_THRUST_RAD_S, ASK_TONES_RAD_S
from groundstation.core.geometry import Vec3

SHARES = (0.0, 0.1, 0.3)
"""What rivals show of the acceleration [-]."""
SMOOTHED_S = 1.0
"""Time constant of the rival that smooths it [s]."""
KINDS = len(SHARES) + 1
ENDS = 5.0
"""Evidence that ends a flight, of what must have a rival's shape within a fifth."""
EXACT = 0.2
"""A rival explains what is off by this share of what it leaves of a vehicle that obeys [-]."""
EXACT2 = EXACT * EXACT
GUSTS2 = 1.0
"""A wind that goes on as it was leaves so much of what it changed since the node before, squared [-]."""
RIVAL_CAP, RIVAL_FADE_S = 2.0, 2.0
"""Most that one node may say, and how long evidence lasts [s]."""
TRACE = 0.02
"""Less evidence is none: noise leaves it, and it would fade for seconds [-]."""
GALE_M_S2, BREEZE_M_S2, USUAL, USUAL_S = 3.5, 2.5, 6.0, 5.0
"""No wind to fly in pushes across by so much more than was known, for two nodes, and the picture does not go with it
[m/s²]; in a calm, where so many times [-] what it was mostly off by in the last time [s] is less than the second, none
pushes by that."""
TURNS_M_S2, TURNS_DOWN_M_S2, TURNS_S = 5.5, 6.0, 3.0
"""Nor does any wind change across, or down, by so much [m/s²] from its mean of the last time [s], for two nodes, even
if the picture goes with it: who follows a lie that grows goes with it, too. A cable comes to 5.5 down."""
PRESS_M_S2 = 3.0
"""Nothing in the air presses it down, or lifts it, by so much more than was known, for two nodes [m/s²]: a floor does,
a hand, or rotors that give little more than half of what they gave."""
BEARS_M_S2, BEARS_DOWN_M_S2, BEARS_USUAL, BEARS_SHOWS = 1.5, 2.0, 6.0, 0.35
"""A wind moves the picture first, and what pushes against it is learnt then. So none pushes across, or down, by so much
more than was known [m/s²], and by so many times what it was mostly off by [-], for two nodes in which the picture shows
less than this share of what the commands make of it [-]: it stands, though pushed."""
CALM_KNOWN_S = 2.5
"""Whether it is calm is known after so long [s]; a storm's gusts look like a rival's in calm air now and then."""
SAYS = 1.2
"""Where a vehicle that obeys is off by so little more than the noise, squared, no rival is looked at [-]."""
NOISE_M_S2, WIND_M_S2 = 0.06, 0.3
"""Noise of an acceleration at least, and what wind leaves that a law has just answered, 1σ [m/s²]."""
WIND2 = WIND_M_S2 * WIND_M_S2
NOISES = math.sqrt(6.0)
"""A second difference has so many times the noise of one position [-]."""
LEARNS_S, LEARNS_AT_ONCE, RIVAL_MOVES = 2.0, 0.6, 0.35
"""A push is learnt with this time constant [s]; by the second share at once, where what is seen has gone with it by the
third [-]."""
STAYS_S = 0.6
"""So long after a leap nothing is learnt, and speeds are held against those of before [s]."""
STOPS_M_S, STOPS_AT, STOPS, GOES_ON, STOPS_NOISES, CLIMB_NOISES = 0.12, 0.05, 4.0, 1.0, 18.0, 9.0
"""A coordinate that moved so fast [m/s], and from one pose to the next has the speed of a rival but for this share of
that [-], says so much, and then so much with each node. Less than so many times its noise [-] is no speed, the second
while it climbs off the floor: there it is slow, and falls no way."""
ASTRAY_M_S, ASTRAY_NOISES, ASTRAY_M_S2 = 0.1, 3.0, 0.5
"""A speed after a leap that is so much off [m/s], so many times its noise [-], and by what wind makes of it [m/s²], for
two nodes, has changed from one pose to the next: something has hit the vehicle, or the picture is another's."""
LEAPS_AS = 0.9 * STOPS / ENDS
"""So large a share has what has leapt, and goes on as a rival [-]."""
BEGINS, CLIMB_BEGINS = 5, 2
"""So many nodes are averaged to begin with, and so many less along the vertical: what lifts it off is known."""


class Rivals:
    """One flight's."""

    def __init__(self, known: int = 0) -> None:
        """Along the vertical so many nodes need no average: what lifts it off is known."""
        self._known = known
        self._axes: tuple[_RivalAxis, ...] = ()
        self._gale = self._press = self._bears = self._looked_s = 0.0
        self._usual, self._usual_down, self._astray, self._pulls = WIND2, WIND2, 0, False

    def begin(self, position: Vec3, pushed: Vec3) -> None:
        """Look anew from one instant on; what is known of the push stays, and evidence.

        Args:
            position: as seen [m, NED].
            pushed: where the commands would have taken it, from any point that it was at with any velocity [m, NED].
        """
        if not self._axes:
            self._axes = _RivalAxis(), _RivalAxis(), _RivalAxis(self._known)
        for axis, x, told in zip(self._axes, position, pushed, strict=True):
            axis.begin(x, told)

    def node(
        self, position: Vec3, pushed: Vec3, h: float, noise_m: float, leapt: bool, *,
        climbs: bool = False, turns: bool = True,
    ) -> float:  # fmt: skip
        """What speaks for a rival along any axis, as a share of what ends a flight [-].

        Args:
            position: as seen [m, NED].
            pushed: as for :meth:`begin` [m, NED].
            h: time since the node before [s], shorter than ``SMOOTHED_S``.
            noise_m: of a second difference of the positions, 1σ [m].
            leapt: whether a pose since then was where nothing pushes a vehicle.
            climbs: whether it has just left the floor.
            turns: whether it turns as told: who does not is not asked whether a wind pulls it down.
        """
        (x, y, z), (a, b, c), (p, q, r) = self._axes, position, pushed
        speed_noise = noise_m / h
        sigma = NOISE_M_S2 + speed_noise / h
        variance = sigma * sigma
        x.node(a, p, h, variance, speed_noise, leapt)
        y.node(b, q, h, variance, speed_noise, leapt)
        z.noises = CLIMB_NOISES if climbs else STOPS_NOISES
        z.node(c, r, h, variance, speed_noise, leapt)
        squared, usual = x.off * x.off + y.off * y.off, self._usual
        most = USUAL * math.sqrt(usual)
        calm = most <= BREEZE_M_S2
        most = (BREEZE_M_S2 if calm else min(most, GALE_M_S2)) + 3.0 * sigma
        bore, self._bears = self._bears, self._stands_though_pushed(sigma)
        self._usual += h / USUAL_S * (min(squared, 4.0 * usual) - usual)
        self._usual_down += h / USUAL_S * (min(z.off * z.off, 4.0 * self._usual_down) - self._usual_down)
        turned = math.hypot(x.turned, y.turned) / (TURNS_M_S2 + 3.0 * sigma)
        before, self._gale = self._gale, max(math.sqrt(squared) / most, turned)
        pressed, self._press = self._press, abs(z.off) / (PRESS_M_S2 + 3.0 * sigma)
        pulled, self._pulls = self._pulls, turns and abs(z.turned) > TURNS_DOWN_M_S2 + 3.0 * sigma
        across = down = 0.0
        if x.speaks or y.speaks:  # who shows too small a part of one axis mostly does so of the other, too
            across = max(map(sum, zip(x.evidence, y.evidence, strict=True)))
        if z.speaks:
            down = max(z.evidence)
        if leapt:
            self._astray = 0
        elif x.since_s < STAYS_S:
            far = math.sqrt(x.astray**2 + y.astray**2 + z.astray**2)
            self._astray += far > ASTRAY_M_S + ASTRAY_NOISES * speed_noise + ASTRAY_M_S2 * x.since_s
            if self._astray >= 2:
                return 1.0
        self._looked_s += h
        known = self._looked_s > CALM_KNOWN_S
        gale = min(before, self._gale) + (across / ENDS if calm and known else 0.0)
        # A trim is no help in a gale or on a tether: these end a flight, or are nothing.
        held = max(gale, down / ENDS, min(pressed, self._press), float(pulled and self._pulls))
        if known:
            held = max(held, min(bore, self._bears))
        return max(across / ENDS, held if held >= 1.0 or (climbs and z.since_s <= STAYS_S) else 0.5 * held)

    def _stands_though_pushed(self, sigma: float) -> float:
        """How far a push is one that no wind makes of a standing picture [-]; ``sigma`` is an acceleration's [m/s²]."""
        x, y, z = self._axes
        found, off = 0.0, math.hypot(x.off, y.off)
        if math.hypot(x.seen, y.seen) < BEARS_SHOWS * math.hypot(x.seen - x.off, y.seen - y.off):
            found = off / (max(BEARS_M_S2, BEARS_USUAL * math.sqrt(self._usual)) + 3.0 * sigma)
        if abs(z.seen) < BEARS_SHOWS * abs(z.seen - z.off):
            most = max(BEARS_DOWN_M_S2, BEARS_USUAL * math.sqrt(self._usual_down)) + 3.0 * sigma
            found = max(found, abs(z.off) / most)
        return found


class _RivalAxis:
    """One axis."""

    __slots__ = (
        "_before", "_h", "_known", "_mean", "_moved", "_off_before", "_place", "_push", "_smooth", "_speed", "_told",
        "astray", "evidence", "noises", "off", "seen", "since_s", "speaks", "turned",
    )  # fmt: skip

    def __init__(self, known: int = 0) -> None:
        """``known`` nodes need no average."""
        self._known = known
        self._push = self._mean = self._smooth = self._before = self._off_before = 0.0
        self.noises = STOPS_NOISES
        """Less than so many times its noise is no speed [-]."""
        self.since_s = math.inf
        """How long ago it leapt, to the node after [s]."""
        self.astray = 0.0
        """How much faster it is since than it was going [m/s]."""
        self.evidence = [0.0] * KINDS
        """For each rival."""
        self.speaks = False
        """Whether there is any."""
        self.off = 0.0
        """What pushes it beside the commands, less what is known of that [m/s²]."""
        self.seen = 0.0
        """What is seen of it all [m/s²]."""
        self.turned = 0.0
        """What pushes it beside the commands, less its mean of the last seconds [m/s²]."""

    def begin(self, place: float, told: float) -> None:
        """It is at ``place``, by the commands alone at ``told`` [m]."""
        self._place, self._told, self._h, self.off = place, told, 0.0, 0.0

    def node(self, place: float, told: float, h: float, variance: float, speed_noise: float, leapt: bool) -> None:
        """Take one node; ``variance`` is an acceleration's, by noise [m²/s⁴], ``speed_noise`` a speed's noise [m/s]."""
        speed, moved, last = (place - self._place) / h, (told - self._told) / h, self._h
        self._place, self._told, self._h = place, told, h
        if last == 0.0:
            self._speed, self._moved = speed, moved
            return
        before, then, both = self._speed, self._moved, h + last
        self._speed, self._moved = speed, moved
        a, u = 2.0 * (speed - before) / both, 2.0 * (moved - then) / both
        self.seen, self.off = a, (off := a - u - self._push)
        if self._known < BEGINS:
            self._known += 1
            self._push += off / self._known
            self._mean = self._push
            self.off = 0.0
            return
        self.turned = turned = a - u - self._mean
        self._mean += h / TURNS_S * turned
        if self.since_s <= STAYS_S:
            self.since_s += h
            self._compare(speed, self._before + moved + self.since_s * self._push, speed_noise)
            if self.since_s < 1.5 * h:  # what leaps has no acceleration
                self.off = 0.0
                return
        elif leapt:
            self.since_s, self._before, self.off = 0.0, before - then, 0.0
            return
        obeys = a - off
        self._smooth += h / SMOOTHED_S * (obeys - self._smooth)
        variance += WIND2
        since, self._off_before = off - self._off_before, off
        wrong = min(EXACT2 * off * off, GUSTS2 * since * since) + variance
        if self.speaks or wrong >= SAYS * variance:  # else it says nothing, as nearly always
            self._weigh(a, obeys, wrong, h, variance)
        if self.since_s > STAYS_S:
            at_once = a * off > RIVAL_MOVES * off * off
            self._push += (LEARNS_AT_ONCE if at_once else h / LEARNS_S) * off

    def _compare(self, speed: float, goes: float, sigma: float) -> None:
        """What the speed after a leap says, where it ``goes`` so fast by what it was told since, ± ``sigma`` [m/s]."""
        self.astray = speed - goes
        if abs(goes) < max(STOPS_M_S, self.noises * sigma):
            return
        says = STOPS if self.since_s < 1.5 * self._h else GOES_ON
        for i, share in enumerate(SHARES):
            if abs(speed - share * goes) < STOPS_AT * abs(goes) + 3.0 * sigma:
                self.evidence[i] += says
            else:
                self.evidence[i] = max(0.0, self.evidence[i] - RIVAL_CAP)
        self.speaks = any(self.evidence)

    def _weigh(self, a: float, obeys: float, wrong: float, h: float, variance: float) -> None:
        """What ``a`` says [m/s²], where one that ``obeys`` accelerates so much, and is ``wrong`` by that, squared."""
        fade, evidence = 1.0 - h / RIVAL_FADE_S, self.evidence
        p, q, r = SHARES
        for i, one in enumerate((a - p * obeys, a - q * obeys, a - r * obeys, a - self._smooth)):
            square, found = one * one + variance, evidence[i]
            if square < wrong or found > 0.0:
                says = 0.5 * math.log(wrong / square)
                found = found * fade + (says if -RIVAL_CAP < says < RIVAL_CAP else math.copysign(RIVAL_CAP, says))
                evidence[i] = found if found > TRACE else 0.0
        self.speaks = any(evidence)


IMAGE_CAP = 6.5
"""Most that one node may say for an image: no single outlier convicts."""
EXPLAINS = 2.0
"""A node that no image explains well counts by so much less [-]."""
WIND_M, WIND_RISES, WIND_FALLS = 0.02, 0.2, 0.03
"""What wind leaves in the position's filter at least, 1σ [m]; how fast more and less of it are learnt from a node."""
WIND_M2 = WIND_M * WIND_M
THETA = 0.6
"""Memory of the filter: what it knows fades by this factor from node to node [-]."""
ALPHA, BETA, GAMMA = 1.0 - THETA**3, 1.5 * (1.0 - THETA**2) * (1.0 - THETA), (1.0 - THETA) ** 3
GOES_ON_AS = 4.0
"""By so much [-] does a wind that goes on as it was explain a node worse than a vehicle that obeys."""
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
        self._beside: Vec3 | None = None
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
        self._beside = None
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
            (x, y, z), (a, b, c) = seen, told
            u, v, w = self._beside or (0.0, 0.0, 0.0)
            self._beside = p, q, r = x - a, y - b, z - c
            self._across(x, y, a, b, GOES_ON_AS * ((p - u) ** 2 + (q - v) ** 2), fade)
            self._down(z, c, GOES_ON_AS * (r - w) ** 2, fade)
        return seen, told

    def _across(self, x: float, y: float, cx: float, cy: float, wind: float, fade: float) -> None:
        """What one node says of the two horizontal axes, where a wind that goes on as it was leaves ``wind`` [m²]."""
        xx, yy, xy, yx = x * cx, y * cy, x * cy, y * cx
        told, seen = cx * cx + cy * cy, x * x + y * y
        both = seen + told
        rest = min(both - 2.0 * (xx + yy), seen, wind)
        best = both - 2.0 * max(-xx - yy, abs(xx - yy), abs(xy + yx), abs(xy - yx))
        best = best if best < rest else rest
        if best < rest or self.across > 0.0:  # else it says nothing, as nearly always
            exact, variance = EXACT_M * EXACT_M + self.wander, self.wind[0] + self.wander
            images = (-xx - yy, yy - xx, xx - yy, xy + yx, -xy - yx, yx - xy, xy - yx)
            maps = self._maps
            for i, image in enumerate(images):
                off = both - 2.0 * image
                if off < rest or maps[i] > 0.0:
                    opposed = exact if i < OPPOSED else None
                    maps[i] = _sum_evidence(maps[i], fade, rest - off, max(variance, off / EXPLAINS), off, opposed)
            self.across = max(maps)
        self._learn(0, 0.5 * best)

    def _down(self, z: float, c: float, wind: float, fade: float) -> None:
        """What one node says of the vertical axis, likewise."""
        against, along = z + c, z - c
        off, rest = against * against, min(along * along, z * z, wind)
        if off < rest or self.down > 0.0:
            variance, exact = self.wind[1] + self.wander, EXACT_M * EXACT_M + self.wander
            self.down = _sum_evidence(self.down, fade, rest - off, max(variance, off / EXPLAINS), off, exact)
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
    evidence = evidence * fade + max(-IMAGE_CAP, min(says, IMAGE_CAP))
    return evidence if evidence > TRACE else 0.0


TOLD_NOISES = 2.0
"""A question is one that is told by so many times the noise of a node [-]."""


class _LockIn(NamedTuple):
    """A lock-in detector of an answer. With a longer memory it finds it beside more of what else the commands do."""

    memory_s: float
    """Time constant of what is mixed down [s]."""
    asked_s: float
    """So long it is asked before an answer counts [s]."""
    outweighs: float
    """The question has so many times the power of all else that is told [-]: what the law does against wind is seen by
    less, as it brings that to nothing."""
    less: float
    """What shows a smaller share of the answer than this does not answer [-]."""


ACROSS = (_LockIn(0.85, 1.1, 1.5, 0.3), _LockIn(2.5, 2.5, 0.7, 0.25))
"""As of all directions the one that shows least is taken, noise makes the share less than it is."""
DOWN = (_LockIn(0.85, 1.1, 1.5, 0.4), _LockIn(2.5, 2.5, 1.0, 0.4))
SILENT_S, FORGETS, REPENTS = 0.4, 0.2, 2.0
"""So long without an answer, and it ends a flight [s]; time in which none is told from wind counts back by such a
share, and time in which it answers so many times [-]."""
ASK_LATE_S = 0.1
"""So late about is what is asked told to the vehicle [s]; that differs a little changes nothing."""
ASK_WEIGHTS = tuple((tone, tone**-3) for tone in ASK_TONES_RAD_S)
"""By how much each tone [rad/s] moves the position beside the others [-]."""


class _Question:
    """What is told and seen of one question, mixed down with it, with fading memory."""

    __slots__ = ("_asked_s", "_beside", "_circles", "_lock_in", "_seen", "_told", "_weight", "silent_s")

    def __init__(self, lock_in: _LockIn, *, circles: bool) -> None:
        """Nothing is known; it ``circles`` across, north first, or swings down."""
        self._lock_in, self._circles = lock_in, circles
        self._beside = self._weight = self._asked_s = 0.0
        self._told, self._seen = 0j, (0j, 0j)
        self.silent_s = 0.0
        """For how long it was not answered [s]."""

    def node(self, told: complex, seen: tuple[float, float], phase: complex, h: float, noise_m: float) -> None:
        """Take what one node adds, along north + i east or down [m]; ``phase`` is the question's.

        ``h`` is how long it took [s], ``noise_m`` the noise of what is seen [m].
        """
        lock_in, back = self._lock_in, phase.conjugate()
        fade = math.exp(-h / lock_in.memory_s)
        self._told = fade * self._told + told * back
        u, v = self._seen
        self._seen = u, v = fade * u + seen[0] * back, fade * v + seen[1] * back
        self._weight = fade * self._weight + _power(phase)
        self._beside = fade * self._beside + _power(told)
        self._asked_s += h
        if self._asked_s <= lock_in.asked_s:
            return
        power = _power(self._told)
        asked2 = (1.0 if self._circles else 2.0) * power / self._weight
        ratio = asked2 / max(self._beside - asked2, 1e-12)
        if ratio < lock_in.outweighs or asked2 < (TOLD_NOISES * noise_m) ** 2:
            self.silent_s = max(0.0, self.silent_s - FORGETS * h)
            return
        if self._circles:  # along the direction that shows least, of half of what circles
            xx, yy, xy = _power(u), _power(v), u.real * v.real + u.imag * v.imag
            share2 = 2.0 * (xx + yy - math.hypot(xx - yy, 2.0 * xy)) / power
        else:
            share2 = _power(u) / power
        answers = share2 >= lock_in.less * lock_in.less
        self.silent_s = max(0.0, self.silent_s + (-REPENTS if answers else 1.0) * h)


class PositionAnswer:
    """What one flight's position answers to the tones that it is asked by."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._across = [_Question(lock_in, circles=True) for lock_in in ACROSS]
        self._down = [_Question(lock_in, circles=False) for lock_in in DOWN]
        self._before: tuple[float, Vec3, Vec3] | None = None

    def node(self, time_s: float, h: float, seen: Vec3, told: Vec3, noise_m: float, *, asked: bool) -> float:
        """Take one node; how much speaks for a position that does not answer, as a share of what ends a flight [-].

        A push that grows steadily is in each node alike, so that only what changes from node to node is looked at.

        Args:
            time_s: of the pose.
            h: time since the node before [s].
            seen: how far the position left its way, by a filter that both go through [m, NED].
            told: the same of where the commands would have taken it [m, NED].
            noise_m: what such a filter has of the poses' own noise, 1σ [m].
            asked: whether the tones are played.
        """
        if not asked:
            if self._before is not None:
                self._forget()
            return 0.0
        before, self._before = self._before, (time_s, seen, told)
        if before is not None and time_s - before[0] < 1.5 * h:
            (x, y, z), (a, b, c), (_, (p, q, r), (u, v, w)) = seen, told, before
            noise_m *= math.sqrt(2.0)
            tones = sum(cmath.rect(weight, tone * (time_s - ASK_LATE_S)) for tone, weight in ASK_WEIGHTS)
            for question in self._across:
                question.node(complex(a - u, b - v), (x - p, y - q), tones, h, noise_m)
            swing = cmath.rect(1.0, ASK_THRUST_RAD_S * time_s)
            for question in self._down:
                question.node(complex(c - w), (z - r, 0.0), swing, h, noise_m)
        return max(question.silent_s for question in (*self._across, *self._down)) / SILENT_S


def _power(z: complex) -> float:
    return z.real * z.real + z.imag * z.imag
