"""Batches of flights agree with whole flights one at a time: two simulators cannot drift apart."""

import numpy as np
import pytest

from groundstation.core.geometry import Vec3
from groundstation.core.vehicle import ActuatorCommand
from sim.batch import fly_batch
from sim.batch.batch import ReceivedCommands
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from sim.world import Wind, generator
from tests.flight.flights import flown

SEEDS = 2
DURATION_S = 17.0
"""Two seconds count; what differs by then does not agree again."""


@pytest.mark.tried(1)  # in the other air
@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        ("adverse", ()),
        ("paper", ("sim.drag_body_per_s=[0.3,0.2,0.1]", "sim.inflow_drag_per_m=[0.1,0.1]")),
    ],
)
def test_a_batch_agrees_with_whole_flights_to_a_micrometre(
    scenario: str, overrides: tuple[str, ...]
) -> None:
    world, config = prepare(SCENARIOS[scenario], list(overrides))
    batch = fly_batch([world] * SEEDS, config, list(range(SEEDS)), duration_s=DURATION_S)
    assert batch.survived.all()
    for seed in range(SEEDS):
        verdict = flown(scenario, *overrides, seed=seed, duration_s=DURATION_S).verdict
        assert 100.0 * batch.rms_m[seed] == pytest.approx(verdict.rms_cm, abs=1e-4, rel=1e-4)
        # Two steps of the plant.
        assert batch.settle_s[seed] == pytest.approx(verdict.settle_s, abs=0.006)


@pytest.mark.parametrize("kind", ["adaptive", "l1", "indi"])
def test_every_law_is_thrown_and_pushed_in_a_batch_as_in_a_whole_flight(kind: str) -> None:
    start = "sim.start_velocity=[0.5,-0.5,0.0]", "sim.start_turn_deg=[20.0,-10.0,0.0]"
    thrown = (*start, "sim.floor_z_m=9.0")
    pushed = ("sim.wind_step=[0.0,5.0,0.0]", "sim.wind_step_time_s=4.0", "sim.wind_push_s=0.4")
    overrides = (f"controller.kind={kind}", *thrown, *pushed)
    world, config = prepare(SCENARIOS["paper"], list(overrides))
    batch = fly_batch([world], config, [1], duration_s=8.0)
    verdict = flown("paper", *overrides, seed=1, duration_s=8.0).verdict
    assert batch.survived.all()
    assert 100.0 * batch.gust_peak_m[0] == pytest.approx(verdict.gust_peak_cm, abs=0.01)
    # Two steps of the plant.
    assert batch.gust_back_s[0] == pytest.approx(verdict.gust_back_s, abs=0.006)
    assert batch.settle_s[0] == pytest.approx(verdict.settle_s, abs=0.006)
    assert batch.lowest_m[0] > world.start_ned[2], "it sinks at first"


def test_the_first_frame_arrives_and_each_later_one_as_its_own_draw_says() -> None:
    world, _ = prepare(SCENARIOS["paper"], ["sim.frame_loss=0.5"])
    seeds, level = range(8), (0.0, 0.0, 0.0)
    received = ReceivedCommands([world] * len(seeds), seeds, 1.0)
    arrived = []
    for frame in range(3):
        before = received.thrust.copy()
        command = ActuatorCommand(0.2 + 0.1 * frame, level)
        received.take(frame, 0.0, command, world.thrust_max_n, world.thrust_curve)
        arrived.append((received.thrust != before).tolist())
    draws = [generator(seed, "frame loss").random(2) >= world.frame_loss for seed in seeds]
    assert arrived == [[True] * len(seeds), *np.transpose(draws).tolist()]


def test_a_last_frame_whose_every_step_ends_after_the_flight_adds_nothing() -> None:
    world, config = prepare(SCENARIOS["adverse"], ["sim.frame_period_s=0.011"])
    shorter, longer = (fly_batch([world], config, [0], duration_s=s) for s in (0.011, 0.0111))
    assert longer.survived.all()
    assert longer.settle_s.tobytes() == shorter.settle_s.tobytes()


def test_worlds_that_cannot_share_a_batch_are_refused() -> None:
    world, config = prepare(SCENARIOS["paper"], [])
    other, _ = prepare(SCENARIOS["paper"], ["sim.pose_rate_hz=100"])
    with pytest.raises(ValueError, match="pose_rate_hz"):
        fly_batch([world, other], config, [0, 1])


def test_nobody_asks_for_the_wind_ahead_of_the_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    # The turbulence never goes back: whoever asks too early changes the wind that the vehicle then
    # feels.
    asked: list[float] = []
    answer = Wind.at

    def at(self: Wind, flight_time: float) -> Vec3:
        asked.append(flight_time)
        return answer(self, flight_time)

    monkeypatch.setattr(Wind, "at", at)
    world, config = prepare(SCENARIOS["adverse"], [])
    fly(world, config, seed=0, duration_s=1.0)
    assert len(asked) > 400
    assert all(later >= earlier - 1e-9 for earlier, later in zip(asked, asked[1:], strict=False))


def test_where_poses_stay_away_too_long_the_flight_ends() -> None:
    overrides = ["sim.outage_s=0.5", "sim.outage_period_s=3"]
    world, config = prepare(SCENARIOS["paper"], overrides)
    batch = fly_batch([world], config, [0], duration_s=5.0)
    assert not batch.survived[0]
    whole = flown("paper", *overrides, duration_s=5.0)
    assert not whole.completed
    assert "no pose for" in whole.why
