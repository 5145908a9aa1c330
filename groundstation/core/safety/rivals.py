"""Rival test: along each axis, does the position answer the push, or show a part of what it must have done? Sans-IO.

Second differences of the positions from node to node are accelerations, a, known to some 0.1 m/s²; those of where the
commands alone would have taken the vehicle are u. What pushes it beside, d = a - u, is wind, or thrust told wrong.
While the truth is seen, the wind moves the picture first, and the law follows: so a new d is believed at once where a
has gone with it, and slowly where it has not.

A coordinate that is not the vehicle's leaves d = -u, whatever the law makes of that. The rivals are pictures that show
no acceleration, a tenth or three tenths of it, or all of it smoothed. Evidence is a log likelihood ratio between them
and a vehicle that obeys in some wind, summed with fading memory and never below zero. And a picture that begins to lie
shows from one pose to the next a rival's share of the speed, where nothing stops or brakes a vehicle like that.
"""

import math

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
CAP, FADE_S = 2.0, 2.0
"""Most that one node may say, and how long evidence lasts [s]."""
TRACE = 0.02
"""Less evidence is none: noise leaves it, and it would fade for seconds [-]."""
GALE_M_S2, BREEZE_M_S2, USUAL, USUAL_S = 3.5, 2.5, 6.0, 5.0
"""No wind to fly in pushes across by so much more than was known, for two nodes, and the picture does not go with it
[m/s²]; in a calm, where so many times [-] what it was mostly off by in the last time [s] is less than the second, none
pushes by that."""
SAYS = 1.2
"""Where a vehicle that obeys is off by so little more than the noise, squared, no rival is looked at [-]."""
NOISE_M_S2, WIND_M_S2 = 0.06, 0.3
"""Noise of an acceleration at least, and what wind leaves across that a law has just answered, 1σ [m/s²]."""
NOISES = math.sqrt(6.0)
"""A second difference has so many times the noise of one position [-]."""
LEARNS_S, LEARNS_AT_ONCE, MOVES = 2.0, 0.6, 0.35
"""A push is learnt with this time constant [s]; by the second share at once, where what is seen has gone with it by the
third [-]."""
STAYS_S = 0.6
"""So long after a leap nothing is learnt, and speeds are held against those of before [s]."""
STOPS_M_S, STOPS_AT, STOPS, GOES_ON, STOPS_NOISES = 0.12, 0.05, 4.0, 1.0, 18.0
"""A coordinate that moved so fast [m/s], and from one pose to the next has the speed of a rival but for this share of
that [-], says so much, and then so much with each node. Less than so many times its noise [-] is no speed."""
ASTRAY_M_S, ASTRAY_NOISES, ASTRAY_M_S2 = 0.1, 3.0, 0.5
"""A speed after a leap that is so much off [m/s], so many times its noise [-], and by what wind makes of it [m/s²], for
two nodes, has changed from one pose to the next: something has hit the vehicle, or the picture is another's."""
LEAPS_AS = 0.9 * STOPS / ENDS
"""So large a share has what has leapt, and goes on as a rival [-]."""
BEGINS = 5
"""So many nodes are averaged to begin with."""


class Rivals:
    """One flight's."""

    def __init__(self) -> None:
        """Nothing seen."""
        self._axes: tuple[_RivalAxis, ...] = ()
        self._gale = 0.0
        self._usual = WIND_M_S2 * WIND_M_S2
        self._astray = 0

    def begin(self, position: Vec3, pushed: Vec3) -> None:
        """Look anew from one instant on; what is known of the push stays, and evidence.

        Args:
            position: as seen [m, NED].
            pushed: where the commands would have taken it, from any point that it was at with any velocity [m, NED].
        """
        if not self._axes:
            self._axes = _RivalAxis(WIND_M_S2), _RivalAxis(WIND_M_S2), _RivalAxis(0.0)
        for axis, x, told in zip(self._axes, position, pushed, strict=True):
            axis.begin(x, told)

    def node(self, position: Vec3, pushed: Vec3, h: float, noise_m: float, leapt: bool) -> float:
        """What speaks for a rival along any axis, as a share of what ends a flight [-].

        Args:
            position: as seen [m, NED].
            pushed: as for :meth:`begin` [m, NED].
            h: time since the node before [s], shorter than ``SMOOTHED_S``.
            noise_m: of a second difference of the positions, 1σ [m].
            leapt: whether a pose since then was where nothing pushes a vehicle.
        """
        x, y, z = self._axes
        (a, b, c), (p, q, r) = position, pushed
        speed_noise = noise_m / h
        sigma = NOISE_M_S2 + speed_noise / h
        variance = sigma * sigma
        x.node(a, p, h, variance, speed_noise, leapt)
        y.node(b, q, h, variance, speed_noise, leapt)
        z.node(c, r, h, variance, speed_noise, leapt)
        squared, usual = x.off * x.off + y.off * y.off, self._usual
        most = USUAL * math.sqrt(usual)
        calm = most <= BREEZE_M_S2
        most = (BREEZE_M_S2 if calm else min(most, GALE_M_S2)) + 3.0 * sigma
        self._usual += h / USUAL_S * (min(squared, 4.0 * usual) - usual)
        before, self._gale = self._gale, math.sqrt(squared) / most
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
        gale = min(before, self._gale) + (across / ENDS if calm else 0.0)
        # A trim is no help in a gale or on a tether: these end a flight, or are nothing.
        held = max(gale, down / ENDS)
        return max(across / ENDS, held if held >= 1.0 else 0.5 * held)


class _RivalAxis:
    """One axis."""

    __slots__ = (
        "_before", "_h", "_known", "_moved", "_place", "_push", "_smooth", "_speed", "_told", "_wind",
        "astray", "evidence", "off", "since_s", "speaks",
    )  # fmt: skip

    def __init__(self, wind_m_s2: float) -> None:
        """``wind_m_s2`` is what wind leaves that was just answered [m/s²]."""
        self._wind = wind_m_s2 * wind_m_s2
        self._known, self._push, self._smooth = 0, 0.0, 0.0
        self._before = 0.0
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
        self.off = off = a - u - self._push
        if self._known < BEGINS:
            self._known += 1
            self._push += off / self._known
            self.off = 0.0
            return
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
        variance += self._wind
        wrong = EXACT2 * off * off + variance
        if self.speaks or wrong >= SAYS * variance:  # else it says nothing, as nearly always
            self._weigh(a, obeys, wrong, h, variance)
        if self.since_s > STAYS_S:
            at_once = a * off > MOVES * off * off
            self._push += (LEARNS_AT_ONCE if at_once else h / LEARNS_S) * off

    def _compare(self, speed: float, goes: float, sigma: float) -> None:
        """What the speed after a leap says, where it ``goes`` so fast by what it was told since, ± ``sigma`` [m/s]."""
        self.astray = speed - goes
        if abs(goes) < max(STOPS_M_S, STOPS_NOISES * sigma):
            return
        says = STOPS if self.since_s < 1.5 * self._h else GOES_ON
        for i, share in enumerate(SHARES):
            if abs(speed - share * goes) < STOPS_AT * abs(goes) + 3.0 * sigma:
                self.evidence[i] += says
            else:
                self.evidence[i] = max(0.0, self.evidence[i] - CAP)
        self.speaks = any(self.evidence)

    def _weigh(self, a: float, obeys: float, wrong: float, h: float, variance: float) -> None:
        """What ``a`` says [m/s²], where one that ``obeys`` accelerates so much, and is ``wrong`` by that, squared."""
        fade, evidence = 1.0 - h / FADE_S, self.evidence
        p, q, r = SHARES
        for i, one in enumerate((a - p * obeys, a - q * obeys, a - r * obeys, a - self._smooth)):
            square, found = one * one + variance, evidence[i]
            if square < wrong or found > 0.0:
                says = 0.5 * math.log(wrong / square)
                found = found * fade + (says if -CAP < says < CAP else math.copysign(CAP, says))
                evidence[i] = found if found > TRACE else 0.0
        self.speaks = any(evidence)
