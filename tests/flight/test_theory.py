"""On the plant that the law is made for, the theory can be seen: V falls to its sampling floor, the error vanishes."""

import pytest

from groundstation.core import Tick
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare


@pytest.fixture(scope="module", params=["provable", "off"])
def ideal(request: pytest.FixtureRequest) -> list[tuple[float, float, float]]:
    """(time, V, error in metres) at each command of 20 s of ``ideal``; b̃ from the truth."""
    world, config = prepare(SCENARIOS["ideal"], [f"controller.composite={request.param}"])
    rows: list[tuple[float, float, float]] = []

    def on_tick(tick: Tick) -> None:
        d = tick.decision.diagnostics
        b = sum((x - y) ** 2 for x, y in zip(d.b_hat, world.wind_mean, strict=True))
        error = sum(x * x for x in d.z1) ** 0.5
        rows.append((tick.flight_time_s, d.v_known + b / (2.0 * config.controller.kb), error))

    assert fly(world, config, seed=0, duration_s=20.0, on_tick=on_tick).completed
    return rows


def test_v_falls_from_its_start_to_a_floor_a_million_times_lower(ideal: list[tuple[float, float, float]]) -> None:
    start = ideal[0][1]
    floor = max(v for t, v, _ in ideal if t > 15.0)
    assert start > 1.0
    assert floor < 1e-6 * start


def test_v_never_rises_by_more_than_sampling_allows_on_its_way_down(ideal: list[tuple[float, float, float]]) -> None:
    """Between samples Ṫ and ω are held for 2 ms, so V may rise by terms of second order in that time."""
    values = [v for t, v, _ in ideal if t > 0.1]
    rise = max(b - a for a, b in zip(values, values[1:], strict=False))
    assert rise < 1e-3 * values[0]


def test_the_error_is_below_a_millimetre_after_10_s(ideal: list[tuple[float, float, float]]) -> None:
    assert max(e for t, _, e in ideal if t > 10.0) < 1e-3
