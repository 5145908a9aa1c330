"""Compiled code gives numpy's bits: for any straight-line program, whatever numbers it meets."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.core.geometry import Ops
from sim.batch import Compiled, Numpy, Stages
from sim.batch.kernel import INLINE, OUTSIDE, Program, symbols

Apply = Callable[[Ops, Any, Any], Any]
APPLY: dict[str, Apply] = {
    "add": lambda _, x, y: x + y,
    "sub": lambda _, x, y: 1.5 - y + x,
    "mul": lambda _, x, y: x * y,
    "truediv": lambda _, x, y: x / (0.25 + abs(y)),
    "neg": lambda _, x, y: -x * 3.0 + y,
    "abs": lambda _, x, y: abs(x) - y,
    "sqrt": lambda ops, x, y: ops.sqrt(abs(x)) + y,
    "where": lambda ops, x, y: ops.where(x > y, x, 0.1),
    "lt": lambda ops, x, y: ops.where((x < y) & (x < 1.0), y, x),
    "le": lambda _, x, y: (x <= y) * y,
    "ge": lambda ops, x, y: ops.where((x >= y) | (y >= 2.0), x - y, x),
    "eq": lambda ops, x, y: ops.where(x == 0.0, y, x) + ops.where(x != y, 1.0, y),
    "invert": lambda ops, x, y: ops.where(~(x > 0.5), x * y, -0.0),
    "clamp": lambda ops, x, y: ops.clamp(x, -0.5, 2.0) * y,
    "exp": lambda ops, x, y: ops.exp(ops.clamp(x, -3.0, 3.0)) * y,
    "sin": lambda ops, x, y: ops.sin(x) - ops.cos(y),
    "asinh": lambda ops, x, y: ops.asinh(x) + 1e-3 * y,
    "atan2": lambda ops, x, y: ops.atan2(x, y),
    "pow": lambda _, x, y: abs(x) ** 3 + y**2,
}
NUMBERS = st.one_of(
    st.floats(-4.0, 4.0), st.sampled_from([0.0, -0.0, 1e-310, 1e300, float("inf"), float("-inf"), float("nan")])
)
LINES = st.lists(st.tuples(st.sampled_from(sorted(APPLY)), st.integers(0, 999), st.integers(0, 999)), min_size=1)
VEHICLES = 5


@pytest.fixture(scope="module", autouse=True)
def _compiler(needs_program: Callable[..., str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What it makes is not kept at home."""
    needs_program("cc")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def _function(lines: list[tuple[str, int, int]]) -> Callable[..., Any]:
    """A program on what it has so far: two columns of state, one that is given, one with a number, its own lines."""

    def function(ops: Ops, state: Any, given: Any) -> Any:
        column, number = given
        known = [*state, column, column + number]
        for name, x, y in lines:
            known.append(APPLY[name](ops, known[x % len(known)], known[y % len(known)]))
        return (known[-1], state[0]), (known[-2], known[0] < known[-1], 7.0)

    return function


def _flown(stages: Stages, lines: Any, numbers: list[float], scalar: float, who: Any) -> list[Any]:
    first, second, told = np.array(numbers).reshape(3, VEHICLES)
    stage = stages(_function(lines), (first, second))
    with np.errstate(all="ignore"):
        results = [stage((told if who is None else told[who], scalar), who) for _ in range(2)]
    return [first, second, *(part for result in results for part in result)]


def _bits(numbers: Any) -> list[str]:
    """Down to the sign of zero; nan is nan."""
    return [float(x).hex() for x in np.ravel(numbers)]


@given(
    lines=LINES,
    numbers=st.lists(NUMBERS, min_size=3 * VEHICLES, max_size=3 * VEHICLES),
    scalar=NUMBERS,
    some=st.one_of(st.none(), st.sets(st.integers(0, VEHICLES - 1), min_size=1)),
)
def test_compiled_straight_line_code_gives_the_bits_of_numpy(
    lines: list[tuple[str, int, int]], numbers: list[float], scalar: float, some: set[int] | None
) -> None:
    who = None if some is None else np.array(sorted(some), np.intp)
    plain, compiled = (_flown(stages, lines, numbers, scalar, who) for stages in (Numpy, Compiled))
    for a, b in zip(plain, compiled, strict=True):
        assert np.asarray(a).dtype == np.asarray(b).dtype
        assert _bits(np.broadcast_to(a, np.shape(b))) == _bits(b)


def test_every_operation_is_drawn() -> None:
    program = Program()
    x, y = program.line("given", 0), program.line("given", 1)
    for apply in APPLY.values():
        apply(symbols(program), x, y)
    assert {name for name, _ in program.lines} >= (INLINE.keys() | OUTSIDE.keys()) - {"constant"}


def test_what_differs_from_vehicle_to_vehicle_can_not_be_branched_on() -> None:
    def branches(_: Ops, state: Any, __: Any) -> Any:
        return state, (1.0 if state[0] > 0.0 else 2.0)

    with pytest.raises(TypeError, match="must not branch"):
        Compiled(branches, (np.zeros(3),))(())


def test_a_common_subexpression_is_computed_once_and_zeros_keep_their_signs() -> None:
    program = Program()
    x: Any = program.line("given", 0)
    assert (x + 1.0).line == (x + 1.0).line
    assert (x * 0.0).line != (x * -0.0).line
