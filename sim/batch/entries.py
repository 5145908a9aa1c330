"""Parts of nested tuples of arrays: the entries of some vehicles, taken out and put back."""

from typing import Any

import numpy as np


def zeros(count: int, width: int) -> Any:
    """``width`` arrays of ``count`` zeros, each its own: ``put`` writes into one without touching the others."""
    return tuple(np.zeros(count) for _ in range(width))


def columns(values: Any, count: int) -> Any:
    """``values`` in nested tuples as arrays of ``count`` numbers, each its own; None stays."""
    if isinstance(values, tuple):
        return tuple([columns(value, count) for value in values])
    return None if values is None else np.array(np.broadcast_to(values, count), np.float64)


def pick(values: Any, who: Any) -> Any:
    """The entries ``who`` of every array in a nested, perhaps named, tuple; plain numbers stay."""
    if isinstance(values, np.ndarray):
        return values[who]
    if isinstance(values, tuple):
        parts = [pick(value, who) for value in values]
        return type(values)(*parts) if hasattr(values, "_fields") else tuple(parts)
    return values


def put(values: Any, who: Any, parts: Any) -> None:
    """Write ``parts`` into the entries ``who`` of every array of ``values``, of the same shape."""
    if isinstance(values, np.ndarray):
        values[who] = parts
        return
    for value, part in zip(values, parts, strict=True):
        put(value, who, part)
