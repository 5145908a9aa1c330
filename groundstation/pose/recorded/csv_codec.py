"""Recorded poses as CSV: one row a pose, in order of time. Sans-IO.

    t,x,y,z,qw,qx,qy,qz          [s, m, -]
    t,x,y,z,qw,qx,qy,qz,arrival  as in a run's folder: also when its bytes came [s], by the same clock

A first row of names may stand above; empty rows and rows that begin with # are skipped.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from groundstation.core.geometry import Quat, Vec3

COLUMNS = "t,x,y,z,qw,qx,qy,qz,arrival"
LONGEST_ROW = 1000
"""A longer row is none [characters]."""


class Row(NamedTuple):
    """One recorded pose, in the axes of the file."""

    t_s: float
    """When it was true, on the clock of the recording [s]."""
    arrival_s: float
    """When it came, on the same clock [s]; ``t_s`` where the file does not tell."""
    position: Vec3
    attitude: Quat


def encode(row: Row) -> str:
    """The row with its end of line; numbers read back to the last bit."""
    return ",".join(map(repr, (row.t_s, *row.position, *row.attitude, row.arrival_s))) + "\n"


def rows(lines: Iterable[str], dropped: Counter[str]) -> Iterator[Row]:
    """The poses in ``lines``; what is none is counted in ``dropped``: malformed, not_finite."""
    first = True
    for line in lines:
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        heading, first = first and text[0].isalpha(), False
        if heading:
            continue
        fields = text.split(",") if len(text) <= LONGEST_ROW else []
        try:
            t, x, y, z, qw, qx, qy, qz, *more = map(float, fields)
            (arrival,) = more or [t]
        except ValueError:
            dropped["malformed"] += 1
            continue
        if math.isfinite(t + arrival + x + y + z + qw + qx + qy + qz):
            yield Row(t, arrival, (x, y, z), (qw, qx, qy, qz))
        else:
            dropped["not_finite"] += 1
