"""Kernel: a straight-line program as C, one loop over the vehicles in place of one pass an operation.

The program is elementwise code (groundstation/core/geometry/so3.py) written down by calling it once with symbols in
place of its numbers. + - * / and roots are rounded the same everywhere, so C gives numpy's bits; other functions stay
numpy's own, and the loop ends where one is needed. What the compiler makes runs as the user, so it is kept in the
user's cache where nobody else can write, or not at all.

A stage is what an elementwise function makes of the state of all the vehicles, or of some. It takes (ops, state, given)
and returns (state, result), all nested tuples: the state of arrays, which never move, what is given of arrays and
numbers. Plain numbers in the state are constants. Stages are numpy's, or compiled; their figures are the same.
"""

import ctypes
import hashlib
import operator
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from groundstation.config import ConfigError
from groundstation.core.geometry import FLOATS, Ops, arrays
from groundstation.runtime import FILE, FOLDER, is_ours

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Operand: TypeAlias = "Symbol | float"


class Program:
    """Straight-line code: line ``i`` is (operation, operands)."""

    def __init__(self) -> None:
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

    def find_needs(self, lines: Iterable[int]) -> list[int]:
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

    def make_function(name: str) -> Callable[..., Any]:
        plain: Callable[..., Any] = getattr(FLOATS, name)

        def function(*operands: Any) -> Any:
            return program.line(name, *operands) if any(isinstance(x, Symbol) for x in operands) else plain(*operands)

        return function

    return Ops(**{name: make_function(name) for name in Ops.__slots__})


FLAGS = ("-std=gnu99", "-O1", "-ftree-vectorize", "-shared", "-fPIC", "-nostdlib")
"""For any machine of this kind, as homes are shared. No headers, no library: a bare compiler will do."""
EXACT = ("-ffp-contract=off", "-fno-fast-math", "-fno-math-errno", "-fno-trapping-math")
"""Nothing is contracted or reordered. Roots set no errno, and nobody traps: only then is a loop made of vectors."""
_PATIENCE_S = 60.0


def built(text: str) -> ctypes.CDLL:
    """``text`` compiled, or as it was compiled before.

    Raises:
        OSError: there is no compiler, it does not take the text, or what it made can't be loaded.
    """
    command, version = find_compiler()
    said = "\n".join((text, *command, version, *FLAGS, *EXACT, platform.machine()))
    name = f"{hashlib.sha256(said.encode()).hexdigest()}.so"
    folder = _cache()
    if folder is not None and _own(folder / name, FILE):
        with suppress(OSError):  # spoilt, by a full disk or a crash: it is made anew
            return ctypes.CDLL(str(folder / name))
    with tempfile.TemporaryDirectory(dir=folder) as scratch:  # for this user alone
        made = Path(scratch) / name
        _run([*command, *FLAGS, *EXACT, "-x", "c", "-", "-o", str(made)], text)
        if folder is None:
            return ctypes.CDLL(str(made))
        made.chmod(0o700)
        made.replace(folder / name)
    return ctypes.CDLL(str(folder / name))


@cache
def find_compiler() -> tuple[list[str], str]:
    """The command, and which version it is."""
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if shutil.which(command[0]) is None:
        raise OSError(f"no C compiler: {command[0]!r} is not installed")
    return command, _run([*command, "--version"])


def _run(command: list[str], text: str = "") -> str:
    try:
        done = subprocess.run(  # noqa: S603  # the user's own compiler
            command, input=text, capture_output=True, text=True, check=False, timeout=_PATIENCE_S
        )
    except subprocess.TimeoutExpired:
        raise OSError(f"{command[0]!r} takes too long") from None
    if done.returncode != 0:
        said = next(iter(done.stderr.splitlines()), "") or f"exit {done.returncode}"
        raise OSError(f"{command[0]!r} fails: {said}")
    return done.stdout


def _cache() -> Path | None:
    """Where compiled text is kept; None where that is not for this user alone."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    try:
        root = (Path(given) if Path(given).is_absolute() else Path.home() / ".cache").resolve()
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        # Who may write a folder may put others in the place of those in it.
        for folder in (root, root / "groundstation", root / "groundstation" / "kernels"):
            folder.mkdir(mode=0o700, exist_ok=True)
            if not _own(folder, FOLDER):
                return None
    except (OSError, RuntimeError):
        return None
    return folder if os.access(folder, os.W_OK) else None


def _own(path: Path, kind: Callable[[int], bool]) -> bool:
    """Whether it is there, and this user's alone."""
    try:
        return is_ours(path.lstat(), kind)
    except OSError:
        return False


INLINE = {
    "constant": "{}",
    "add": "{} + {}",
    "sub": "{} - {}",
    "mul": "{} * {}",
    "truediv": "{} / {}",
    "neg": "-{}",
    "abs": "__builtin_fabs({})",
    "sqrt": "__builtin_sqrt({})",
    "where": "{} != 0.0 ? {} : {}",
    "clamp": "clamped({}, {}, {})",
    "lt": "{} < {}",
    "le": "{} <= {}",
    "gt": "{} > {}",
    "ge": "{} >= {}",
    "eq": "{} == {}",
    "ne": "{} != {}",
    "and": "({} != 0.0) & ({} != 0.0)",
    "or": "({} != 0.0) | ({} != 0.0)",
    "invert": "{} == 0.0",
}
"""Operations as C. What is true or false is 1.0 or 0.0 there."""
TRUTHS = ("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "invert")
_OPS = arrays()
_ARGUMENTS = (ctypes.c_ssize_t, *(ctypes.c_void_p,) * 4)
OUTSIDE: dict[str, Callable[..., Any]] = {
    "pow": operator.pow,
    **{name: getattr(_OPS, name) for name in _OPS.__slots__ if name not in INLINE},
}
"""Operations that numpy does."""
STATE, SCALAR, GIVEN = INPUTS = ("state", "scalar", "given")
"""Lines that are inputs; their operand is the input's number among those of its kind."""
HEAD = """\
#if __FLT_EVAL_METHOD__ == 2 || __FLT_EVAL_METHOD__ < 0
#error "this machine rounds otherwise than numpy"
#endif
typedef __INTPTR_TYPE__ whole;
static inline double clamped(double x, double low, double high) {
    x = (x < low) | (low != low) ? low : x; /* what is not a number spreads, as in numpy */
    return (x > high) | (high != high) ? high : x;
}
"""
_LOOP = """
void level{level}(whole n, const whole *who, double *const *state, const double *scalar, double *block) {{
{pointers}
#pragma GCC ivdep
    for (whole i = 0; i < n; i++) {{
        const whole j = {number};
{body}
    }}
}}
"""


class Kernel:
    """A program compiled. What is given and found, and what waits between two loops, are rows of one block."""

    def __init__(self, program: Program, state: dict[int, int], found: Sequence[int], *, everyone: bool) -> None:
        """Compile what puts lines into the ``state``, by its number, and the lines ``found``.

        ``everyone`` tells that the loops are over all vehicles, and not over some of them by number.

        Raises:
            OSError: it can't be compiled or loaded, and why.
        """
        self._program = program
        self.rows = {i: self._number(i) for i in range(len(program.lines)) if self._name(i) == GIVEN}
        """Line to row of the block."""
        self._level: dict[int, int] = {}
        ends = [*state.values(), *found]
        self._needed = program.find_needs(ends)
        for line in self._needed:
            self._place(line)
        last = max((self._level[i] for i in ends), default=0)
        for line in ends:
            if line in found or self._level[line] < last:
                self._keep(line)
        loops = [self._loop(level, state if level == last else {}, everyone=everyone) for level in range(last + 1)]
        library = built(HEAD + "".join(loops))
        self._steps = [(self._calls(level), getattr(library, f"level{level}")) for level in range(last + 1)]
        for _, loop in self._steps:
            loop.argtypes, loop.restype = _ARGUMENTS, None

    def __call__(self, who: Index | None, state: Any, scalars: Any, given: Sequence[Array], count: int) -> Array:
        """The block, of shape (rows, count), for the vehicles ``who``; ``state`` and ``scalars`` are C arrays."""
        block = np.empty((len(self.rows), count))
        if given:
            np.concatenate(given, out=block[: len(given)].reshape(-1))
        numbers, address = None if who is None else who.ctypes.data, block.ctypes.data
        for calls, loop in self._steps:
            for function, row, sources in calls:
                block[row] = function(*(block[x] if isinstance(x, int) else x for x in sources))
            loop(count, numbers, state, scalars, address)
        return block

    def _name(self, line: int) -> str:
        return self._program.lines[line][0]

    def _keep(self, line: int) -> None:
        """Give ``line`` a row."""
        self.rows.setdefault(line, len(self.rows))

    def _place(self, line: int) -> None:
        """Find the loop that ``line`` belongs to: the one after the last function of numpy's that it rests on."""
        outside, below = self._name(line) in OUTSIDE, self._program.operands(line)
        self._level[line] = level = max((self._level[x] for x in below), default=0) + outside
        for x in below:
            if outside or (self._level[x] < level and self._name(x) not in INPUTS):
                self._keep(x)
        if outside:
            self._keep(line)

    def _calls(self, level: int) -> list[tuple[Callable[..., Any], int, list[int | float]]]:
        """What numpy does before the loop ``level``: function, row of the result, rows or constants it takes."""
        return [
            (OUTSIDE[name], self.rows[i], [self.rows[x.line] if isinstance(x, Symbol) else float(x) for x in operands])
            for i in self._needed
            for name, operands in [self._program.lines[i]]
            if self._level[i] == level and name in OUTSIDE
        ]

    def _loop(self, level: int, state: dict[int, int], *, everyone: bool) -> str:
        """The C of one loop, which ends with putting lines into the ``state``."""
        inside = {i: None for i in self._needed if self._level[i] == level and self._name(i) in INLINE}
        kept = [i for i in self.rows if i in inside or (level == 0 and self._name(i) in (STATE, SCALAR))]
        used = {*kept, *state.values(), *(x for i in inside for x in self._program.operands(i))}
        body = [f"x{i} = {self._source(i)}" for i in sorted(used - inside.keys())]
        for i in inside:
            name, operands = self._program.lines[i]
            body.append(f"x{i} = " + INLINE[name].format(*map(_write_operand, operands)))
        lines = [f"        const double {line};" for line in body]
        lines += [f"        block[{self.rows[i]} * n + i] = x{i};" for i in kept]
        lines += [f"        s{number}[j] = x{i};" for number, i in state.items()]
        numbers = {*state, *(self._number(i) for i in used if self._name(i) == STATE)}
        return _LOOP.format(
            level=level,
            pointers="\n".join(f"    double *s{number} = state[{number}];" for number in sorted(numbers)),
            number="i" if everyone else "who[i]",
            body="\n".join(lines),
        )

    def _number(self, line: int) -> int:
        """Of an input, among those of its kind."""
        (number,) = self._program.lines[line][1]
        assert not isinstance(number, Symbol)
        return int(number)

    def _source(self, line: int) -> str:
        """Where a loop finds a number that it does not compute."""
        name = self._name(line)
        if name == STATE:
            return f"s{self._number(line)}[j]"
        return f"scalar[{self._number(line)}]" if name == SCALAR else f"block[{self.rows[line]} * n + i]"


def _write_operand(x: Operand) -> str:
    """An operand in C."""
    if isinstance(x, Symbol):
        return f"x{x.line}"
    return f"({float(x)!r})".replace("inf", "__builtin_inf()").replace("nan", '__builtin_nan("")')


def check() -> None:
    """Compile every operation once.

    Raises:
        OSError: this machine can't; why.
    """
    program = Program()
    x = program.line(GIVEN, 0.0)
    lines = [program.line(name, *(x,) * text.count("{}")).line for name, text in INLINE.items()]
    Kernel(program, {}, lines, everyone=True)


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
