"""A minute of flight leaves nothing behind; `make soak` flies the hour."""

from tests.proving.bench.allocation import measure_growth


def test_a_minute_of_flight_allocate_nothing_that_stays() -> None:
    facts = measure_growth(1.0 / 60.0)
    assert abs(facts["objects_grown"]) < 50
    assert abs(facts["blocks_grown"]) < 1000
