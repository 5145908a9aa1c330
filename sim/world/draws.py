"""Random draws: every one comes from the seed, one stream a purpose, so that one figure never
shifts another's.
"""

import zlib
from collections.abc import Callable, Iterator

import numpy as np


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Return the random numbers of ``purpose`` in the flight of ``seed`` (>= 0)."""
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def rows(draw: Callable[[], float], width: int) -> Iterator[tuple[float, ...]]:
    """Yield rows of ``width`` numbers from ``draw()``, without end."""
    # One iterator, asked for each place of a row in turn.
    return zip(*[iter(draw, None)] * width, strict=True)


def normals(seed: int, purpose: str, width: int) -> Iterator[tuple[float, ...]]:
    """Yield rows of ``width`` standard normal numbers of ``purpose`` in the flight of ``seed``,
    without end.
    """
    return rows(generator(seed, purpose).standard_normal, width)
