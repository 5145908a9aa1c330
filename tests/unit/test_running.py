"""What runs the tests: which cases are tried (tests/matrix.py), and what failing twice means
(tests/busy.py).
"""

import pytest

from tests.busy import GROSS, Attempt, retry
from tests.matrix import spread


@pytest.mark.parametrize(
    ("tried", "cases", "numbers"),
    [
        (0, 5, set()),
        (1, 5, {0}),
        (2, 5, {0, 4}),
        (3, 5, {0, 2, 4}),
        (5, 5, {0, 1, 2, 3, 4}),
        (9, 3, {0, 1, 2}),
    ],
)
def test_the_cases_that_are_tried_are_spread(tried: int, cases: int, numbers: set[int]) -> None:
    assert spread(tried, cases) == numbers


PASS = ""
BAD = "test_it.py:7: assert 2.8 < 2.0"
BAD_OTHERWISE = "test_it.py:9: TimeoutError"


AGAIN = "failed when tried again (at the same line;"
ATTEMPTS: dict[str, tuple[list[tuple[str, float]], bool, bool, str]] = {
    "passes": ([(PASS, 0.9)], True, False, ""),
    "passes when tried again": (
        [(BAD, 0.0), (PASS, 0.9)], True, False,
        "2.8 < 2.0; machine late 0% of the time), passed when tried again",
    ),
    "fails twice where the machine was late now and again": (
        [(BAD, GROSS), (BAD, GROSS)], True, False, "at the same line; machine late 5% of the time",
    ),
    "fails again on a machine that keeps time then": (
        [(BAD, 0.9), ("test_it.py:7: assert 3 < 2.0", 0.0)], True, True, AGAIN,
    ),
    "fails otherwise on a machine that keeps time then": (
        [(BAD, 0.9), (BAD_OTHERWISE, 0.04)], True, True,
        "(test_it.py:9: TimeoutError; machine late 4% of the time)",
    ),
    "fails while nothing could keep time": (
        [(BAD, 0.0), (BAD, 0.06)], False, False, f"{AGAIN} machine late 6%",
    ),
}  # fmt: skip
"""What fails when, whether that counts, whether it is waited before, and what is said."""


@pytest.mark.parametrize(("attempts", "counts", "waits", "says"), ATTEMPTS.values(), ids=ATTEMPTS)
def test_what_fails_twice_fails_unless_nothing_could_keep_time_the_second_time(
    attempts: list[tuple[str, float]], counts: bool, waits: bool, says: str
) -> None:
    left = [Attempt(*each) for each in attempts]
    waited: list[bool] = []
    found, said = retry(lambda: left.pop(0), lambda: waited.append(True))
    assert not left
    assert found is counts
    assert bool(waited) is waits
    assert says in said
    assert bool(said) == bool(says)
