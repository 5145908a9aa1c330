"""Elementwise code written down as a straight-line program, by calling it once with symbols in place of its numbers.

So the source (groundstation/core/geometry/ops.py says how it is written) stays the only one. The program has its
operations, in its order, each once: whoever computes them exactly as told gets the same bits.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from groundstation.core.geometry import FLOATS, Ops

Operand: TypeAlias = "Symbol | float"


class Program:
    """Straight-line code: line ``i`` is (operation, operands)."""

    def __init__(self) -> None:
        """Empty."""
        self.lines: list[tuple[str, tuple[Operand, ...]]] = []
        self._known: dict[Any, Symbol] = {}

    def line(self, name: str, *operands: Operand) -> "Symbol":
        """The result of an operation; the same one on the same operands is computed once."""
        # A constant by its digits: 0.0 is not -0.0.
        key = (name, *(x.line if isinstance(x, Symbol) else repr(float(x)) for x in operands))
        if key not in self._known:
            self._known[key] = Symbol(self, len(self.lines))
            self.lines.append((name, operands))
        return self._known[key]

    def operands(self, line: int) -> list[int]:
        """The lines whose results ``line`` takes."""
        return [x.line for x in self.lines[line][1] if isinstance(x, Symbol)]

    def needed(self, lines: Iterable[int]) -> list[int]:
        """These lines and all that they rest on, in the order of the program."""
        found: set[int] = set()
        left = list(lines)
        while left:
            line = left.pop()
            if line not in found:
                found.add(line)
                left += self.operands(line)
        return sorted(found)


class Symbol:
    """A number that is not known yet: the result of ``line`` of ``program``."""

    __slots__ = ("line", "program")

    def __init__(self, program: Program, line: int) -> None:
        """See the class."""
        self.program = program
        self.line = line

    def __bool__(self) -> bool:
        """Refuse.

        Raises:
            TypeError: always.
        """
        raise TypeError("elementwise code must not branch on what differs from vehicle to vehicle")


def _operator(name: str, *, swapped: bool = False) -> Callable[..., Symbol]:
    def method(self: Symbol, *other: Operand) -> Symbol:
        return self.program.line(name, *other, self) if swapped else self.program.line(name, self, *other)

    return method


for _name in ("add", "sub", "mul", "truediv", "pow", "and", "or"):
    setattr(Symbol, f"__{_name}__", _operator(_name))
    setattr(Symbol, f"__r{_name}__", _operator(_name, swapped=True))
for _name in ("neg", "abs", "invert", "lt", "le", "gt", "ge", "eq", "ne"):
    setattr(Symbol, f"__{_name}__", _operator(_name))


def symbols(program: Program) -> Ops:
    """The elementary functions on symbols; plain numbers alone give plain numbers."""

    def named(name: str) -> Callable[..., Any]:
        plain: Callable[..., Any] = getattr(FLOATS, name)

        def function(*operands: Any) -> Any:
            return program.line(name, *operands) if any(isinstance(x, Symbol) for x in operands) else plain(*operands)

        return function

    return Ops(**{name: named(name) for name in Ops.__slots__})
