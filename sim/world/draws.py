"""Random numbers: every draw comes from the seed, one stream a purpose, so that one figure never shifts another's.

They are those of ``numpy.random.default_rng``, to the last bit. One vehicle draws them one by one, in plain Python:
to import numpy takes longer than that in a flight of minutes. Many vehicles draw arrays, from numpy.
"""

import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from sim.world.ziggurat import EDGES, INSIDE, TAIL, WIDTHS

if TYPE_CHECKING:
    import numpy as np

_32, _64, _128 = (1 << 32) - 1, (1 << 64) - 1, (1 << 128) - 1
_MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
_SHARE = 2.0**-53


def stream(seed: int, purpose: str) -> "Stream":
    """The numbers of ``purpose`` in the flight of ``seed`` (>= 0), one by one."""
    return Stream(_entropy(seed, purpose))


def generator(seed: int, purpose: str) -> "np.random.Generator":
    """The same numbers as arrays, and whatever else numpy draws."""
    import numpy as np

    return np.random.default_rng(_entropy(seed, purpose))


def rows(draw: Callable[[], float], width: int) -> Iterator[list[float]]:
    """Rows of ``width`` numbers from ``draw()``."""
    places = range(width)
    while True:
        yield [draw() for _ in places]


def _entropy(seed: int, purpose: str) -> list[int]:
    return [seed, zlib.crc32(purpose.encode())]


class Stream:
    """PCG64 (XSL-RR, 128 bits of state), seeded as numpy seeds it.

    Source: M. O'Neill, PCG: a family of simple fast space-efficient statistically good algorithms for random number
    generation, 2014; numpy 2.4, random/src/pcg64 and random/src/distributions.
    """

    __slots__ = ("_increment", "_state")

    def __init__(self, entropy: Sequence[int]) -> None:
        """As ``numpy.random.default_rng(entropy)``: whole numbers, none negative."""
        a, b, c, d = _seeded(entropy)
        self._increment = (c << 64 | d) << 1 & _128 | 1
        self._state = (self._increment + (a << 64 | b)) * _MULTIPLIER + self._increment & _128

    def _next(self) -> int:
        """The next 64 bits."""
        self._state = state = self._state * _MULTIPLIER + self._increment & _128
        folded, turn = (state >> 64 ^ state) & _64, state >> 122
        return (folded >> turn | folded << 64 - turn) & _64

    def random(self) -> float:
        """A number from 0 to below 1, all alike."""
        return (self._next() >> 11) * _SHARE

    def standard_normal(self) -> float:
        """A number of mean 0 and variance 1, by the ziggurat method."""
        while True:
            # _next(), written out: most of what a simulated flight draws is drawn here.
            self._state = state = self._state * _MULTIPLIER + self._increment & _128
            folded, turn = (state >> 64 ^ state) & _64, state >> 122
            bits = (folded >> turn | folded << 64 - turn) & _64
            layer, share = bits & 0xFF, bits >> 9 & 0xFFFFFFFFFFFFF
            x = -share * WIDTHS[layer] if bits & 0x100 else share * WIDTHS[layer]
            if share < INSIDE[layer]:
                return x
            if layer == 0:
                return self._tail(bool(share >> 8 & 1))
            if (EDGES[layer - 1] - EDGES[layer]) * self.random() + EDGES[layer] < math.exp(-0.5 * x * x):
                return x

    def _tail(self, negative: bool) -> float:
        """Beyond the lowest layer, once in some thousand draws."""
        while True:
            x = -math.log1p(-self.random()) * _TAIL_INVERSE
            y = -math.log1p(-self.random())
            if y + y > x * x:
                return -(TAIL + x) if negative else TAIL + x


_TAIL_INVERSE = 0.27366123732975827203338247596
"""1 / TAIL."""


def _seeded(entropy: Sequence[int]) -> list[int]:
    """Four numbers of 64 bits from ``entropy``: numpy's SeedSequence (M. O'Neill's seed_seq, 2015)."""
    words: list[int] = []
    for number in entropy:
        words.append(number & _32)
        while number := number >> 32:
            words.append(number & _32)
    words += [0] * (4 - len(words))
    by = 0x43B0D7E5

    def hashed(value: int) -> int:
        nonlocal by
        value ^= by
        by = by * 0x931E8875 & _32
        value = value * by & _32
        return value ^ value >> 16

    def mixed(one: int, other: int) -> int:
        value = 0xCA01F9DD * one - 0x4973F715 * other & _32
        return value ^ value >> 16

    pool = [hashed(word) for word in words[:4]]
    for source in range(4):
        for target in range(4):
            if source != target:
                pool[target] = mixed(pool[target], hashed(pool[source]))
    for word in words[4:]:
        for target in range(4):
            pool[target] = mixed(pool[target], hashed(word))
    by, halves = 0x8B51F9DD, []
    for n in range(8):
        value = pool[n % 4] ^ by
        by = by * 0x58F38DED & _32
        value = value * by & _32
        halves.append(value ^ value >> 16)
    return [low | high << 32 for low, high in zip(halves[::2], halves[1::2], strict=True)]
