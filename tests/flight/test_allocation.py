"""A minute of flight leaves nothing behind; `make soak` flies the hour."""

import pytest

from tests.proving.bench import allocation


def test_a_minute_of_flight_allocates_nothing_that_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(allocation, "LOOKS", 4)  # each goes through all that the tests hold
    facts = allocation.measure_growth(1.0 / 60.0)
    assert abs(facts["objects_grown"]) < 50
    assert abs(facts["blocks_grown"]) < 1000
