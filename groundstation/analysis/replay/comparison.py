"""Recorded and replayed side by side, to the last bit."""

import math
from typing import Any

import msgspec


class Difference(msgspec.Struct, frozen=True):
    """Where recording and replay first part."""

    what: str
    """``pose``, ``idle`` or ``command``."""
    number: int
    """Which of them, from 0."""
    time_s: float
    """On the flight's clock [s]."""
    field: str
    recorded: Any
    replayed: Any


class Comparison:
    """Counts what is the same and what is not."""

    def __init__(self) -> None:
        """Nothing compared."""
        self.count = {"pose": 0, "idle": 0, "command": 0}
        """How many of each were recorded."""
        self.differing = {"pose": 0, "idle": 0, "command": 0}
        """How many of them are not the same."""
        self.first: Difference | None = None

    def compare(self, what: str, time_s: float, was: msgspec.Struct, now: msgspec.Struct) -> None:
        """The next ``what`` as recorded, and as made anew."""
        number = self._next(what)
        for field in was.__struct_fields__:
            a, b = getattr(was, field), getattr(now, field)
            if a != b or _signs(a) != _signs(b):
                self._differ(Difference(what, number, time_s, field, a, b))
                return

    def missing(self, what: str, time_s: float, was: Any) -> None:
        """The next ``what``, as recorded, was not made anew."""
        self._differ(Difference(what, self._next(what), time_s, "all of it", was, None))

    def _next(self, what: str) -> int:
        number = self.count[what]
        self.count[what] = number + 1
        return number

    def _differ(self, difference: Difference) -> None:
        self.differing[difference.what] += 1
        self.first = self.first or difference


def _signs(value: Any) -> Any:
    """The sign of a zero counts too."""
    if isinstance(value, tuple):
        return tuple(map(_signs, value))
    if isinstance(value, msgspec.Struct):
        return tuple(map(_signs, msgspec.structs.astuple(value)))
    return math.copysign(1.0, value) if isinstance(value, float) else None
