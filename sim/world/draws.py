"""Random numbers: every draw comes from the seed, one stream a purpose, so that one figure never shifts another's."""

import zlib
from collections.abc import Callable, Iterator

import numpy as np

BLOCK = 256
"""Rows drawn at a time."""


def stream(seed: int, purpose: str) -> np.random.Generator:
    """The generator of ``purpose`` in the flight of ``seed`` (>= 0)."""
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def rows(
    draw: Callable[[tuple[int, int]], "np.ndarray[tuple[int, ...], np.dtype[np.float64]]"], width: int
) -> Iterator[list[float]]:
    """Rows of ``width`` numbers from ``draw(shape)``, the same ones whatever the size of the blocks."""
    while True:
        yield from draw((BLOCK, width)).tolist()
