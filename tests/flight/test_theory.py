"""The theory on the plant that the law is made for: V falls to its floor, the error vanishes."""

import pytest

from tests.flight.flights import Certified, flown_ideal

# 12 s at 500 Hz; what V falls by is among the properties of the law.
pytestmark = pytest.mark.matrix


@pytest.fixture(scope="module", params=["provable", "off"])
def ideal(request: pytest.FixtureRequest) -> list[Certified]:
    """Each command of 12 s of ``ideal``."""
    return flown_ideal(request.param)[1]


def test_v_never_rises_by_more_than_sampling_allows_on_its_way_down(ideal: list[Certified]) -> None:
    """Ṫ and ω are held for 2 ms, so V may rise by terms of second order in that time."""
    values = [v for t, v, _ in ideal if t > 0.1]
    rise = max(b - a for a, b in zip(values, values[1:], strict=False))
    assert rise < 1e-3 * values[0]


def test_the_error_is_below_a_millimetre_after_10_s(ideal: list[Certified]) -> None:
    assert max(e for t, _, e in ideal if t > 10.0) < 1e-3
