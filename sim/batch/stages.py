"""Stages of N flights: what an elementwise function makes of the state of all the vehicles, or of some.

The function takes (ops, state, given) and returns (state, result). All are nested tuples: the state of arrays, which
never move, what is given of arrays and numbers. Plain numbers in the state are constants. Stages are numpy's, or
compiled; their figures are the same to the bit.
"""

import ctypes
from collections.abc import Callable, Iterator
from typing import Any, Protocol, TypeAlias

import numpy as np

from groundstation.config import ConfigError
from groundstation.core.geometry import arrays
from sim.batch.kernel import GIVEN, SCALAR, STATE, TRUTHS, Index, Kernel, Program, Symbol, check, symbols


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


Function: TypeAlias = Callable[..., tuple[Any, Any]]


class BatchStage(Protocol):
    """One stage."""

    def __call__(self, given: Any, who: Index | None = None) -> Any:
        """Change the state of the vehicles ``who``, or of all, in place; the result, in the order of ``who``."""
        ...


Stages: TypeAlias = Callable[[Function, Any], BatchStage]
"""Makes a stage of a function and the state that it works on."""


class Numpy:
    """A stage that calls its function with arrays."""

    def __init__(self, function: Function, state: Any) -> None:
        """See :data:`Stages`."""
        self._function, self._state, self._ops = function, state, arrays()
        self._own = set(map(id, _arrays(state)))

    def __call__(self, given: Any, who: Index | None = None) -> Any:
        """See :class:`BatchStage`."""
        where: Any = slice(None) if who is None else who
        old = self._state if who is None else pick(self._state, who)
        new, result = self._function(self._ops, old, given)
        # One array of the state may become another: all are read before any is written.
        changes = [
            (array, now.copy() if id(now) in self._own else now) for array, now in _changes(self._state, old, new)
        ]
        for array, now in changes:
            array[where] = now
        return result


class Compiled:
    """A stage whose function is compiled, once for every form of what is given."""

    def __init__(self, function: Function, state: Any) -> None:
        """See :data:`Stages`."""
        self._function, self._state, self._arrays = function, state, _arrays(state)
        assert all(x.dtype == np.float64 and x.flags.c_contiguous for x in self._arrays)
        self._count = self._arrays[0].size
        self._addresses = (ctypes.c_void_p * len(self._arrays))(*(x.ctypes.data for x in self._arrays))
        self._kernels: dict[Any, tuple[Kernel, Any]] = {}

    def __call__(self, given: Any, who: Index | None = None) -> Any:
        """See :class:`BatchStage`."""
        assert who is None or (who.dtype == np.intp and who.flags.c_contiguous)
        columns: list[Any] = []
        scalars: list[float] = []
        form = (who is None, _form(given, columns, scalars))
        if form not in self._kernels:
            self._kernels[form] = self._compile(given, everyone=who is None)
        kernel, shape = self._kernels[form]
        numbers = (ctypes.c_double * len(scalars))(*scalars)
        block = kernel(who, self._addresses, numbers, columns, self._count if who is None else who.size)
        return _replace(shape, lambda column: column(block))

    def _compile(self, given: Any, *, everyone: bool) -> tuple[Kernel, Any]:
        """The kernel, and the function's result with what finds each array in the kernel's block in its place."""
        program = Program()
        counts = dict.fromkeys((STATE, SCALAR, GIVEN), 0)

        def new(kind: str) -> Symbol:
            counts[kind] += 1
            return program.line(kind, counts[kind] - 1)

        old = _replace(self._state, lambda _: new(STATE))
        told = _replace(given, lambda _: new(GIVEN), lambda _: new(SCALAR))
        after, result = self._function(symbols(program), old, told)
        numbers = {id(array): number for number, array in enumerate(self._arrays)}
        changed = {
            numbers[id(array)]: (now if isinstance(now, Symbol) else program.line("constant", now)).line
            for array, now in _changes(self._state, old, after)
        }
        kernel = Kernel(program, changed, [x.line for x in _arrays(result)], everyone=everyone)

        def column(x: Symbol) -> Callable[[Any], Any]:
            row = kernel.rows[x.line]
            if program.lines[x.line][0] in TRUTHS:
                return lambda block: block[row] != 0.0
            return lambda block: block[row]

        return kernel, _replace(result, column)


def _changes(state: Any, old: Any, new: Any) -> Iterator[tuple[Any, Any]]:
    """Arrays of ``state`` and what they become, wherever ``new`` is not ``old``."""
    if new is old:
        return
    if isinstance(state, tuple):
        for parts in zip(state, old, new, strict=True):
            yield from _changes(*parts)
    else:
        yield state, new


def _form(values: Any, columns: list[Any], scalars: list[float]) -> Any:
    """Which kernel it takes; arrays and plain numbers are put into the two lists."""
    if isinstance(values, tuple):
        return tuple([_form(value, columns, scalars) for value in values])
    if isinstance(values, np.ndarray):
        columns.append(values)
        return GIVEN
    scalars.append(values)
    return SCALAR


def _arrays(values: Any) -> list[Any]:
    """All that is no plain number in nested tuples."""
    found: list[Any] = []
    _replace(values, found.append)
    return found


def _replace(values: Any, new: Callable[[Any], Any], number: Callable[[Any], Any] = lambda x: x) -> Any:
    """Nested tuples, with ``new`` of every array or the like in its place, and ``number`` of every plain number."""
    if isinstance(values, tuple):
        parts = [_replace(value, new, number) for value in values]
        return type(values)(*parts) if hasattr(values, "_fields") else tuple(parts)
    if values is None or isinstance(values, str):
        return values
    return number(values) if isinstance(values, float | int) else new(values)


def choose_stages(kernel: str) -> tuple[Stages, str]:
    """The stages for ``kernel``: "numpy", "c", or "auto", which is "c" where that works; and what a user should know.

    Raises:
        ConfigError: "c" does not work here; why.
    """
    if kernel == "numpy":
        return Numpy, ""
    try:
        check()
    except OSError as error:
        if kernel == "c":
            raise ConfigError("--kernel", f"{error}; auto and numpy fly without") from None
        return Numpy, f"numpy flies, at half the speed of compiled code: {error}"
    return Compiled, ""
