"""True flights from the floor with the monitor of the poses: none ends by its poses."""

from pathlib import Path

import pytest

from tests.proving.alarms import WRONGS, Alarms, Watch, plan_floors, watch_all, watch_capture as recorded_flights

GOLDEN = Path(__file__).parents[1] / "golden"


def ended(found: Alarms) -> list[tuple[int, str]]:
    return [(one.seed, one.failed) for one in found.ended]


@pytest.mark.tried(3)  # the same scenarios by more seeds
@pytest.mark.parametrize("first", range(0, 8, 2))
@pytest.mark.parametrize("scenario", ["adverse", "storm", "gust_front"])
def test_no_flight_in_bad_air_ends_by_its_poses(scenario: str, first: int) -> None:
    (found,) = watch_all([Watch(scenario, figure_s=5.0)], range(first, first + 2), workers=1)
    assert ended(found) == []
    assert found.alarm < 1.0
    assert all(one.windows > 200 for one in found.flights), "it looked all the way"
    assert found.alarm > 0.0, "and it saw something"


@pytest.mark.tried(2)  # flights
@pytest.mark.parametrize(
    ("scenario", "seed", "what"),
    [
        ("adverse", 7000036, "wind that the law answered held the height still while it climbed"),
        ("adverse", 7000029, "the same in a hold"),
        ("storm", 7000019, "speed that the model alone had after an outage"),
        ("storm", 7000017, "a short window knew its own scatter too well"),
        ("storm", 8000082, "a window that rested on the pose after an outage"),
    ],
)
def test_flights_that_a_monitor_ended_once_are_flown(scenario: str, seed: int, what: str) -> None:
    (found,) = watch_all([Watch(scenario)], (seed,), workers=1)
    assert ended(found) == [], what
    assert found.alarm < 0.75, what


@pytest.mark.tried(3)  # what is wrong
@pytest.mark.parametrize("floor", WRONGS, ids=lambda floor: floor.name)
def test_no_flight_ends_by_its_poses_where_something_is_configured_wrong(floor: object) -> None:
    (*_, watch) = [one for one in plan_floors(Watch("", figure_s=5.0)) if one.floor == floor]
    (found,) = watch_all([watch], (0,), workers=1)
    assert ended(found) == []
    # Of what it was told it would weigh 174 % at full thrust, and stays on the floor.
    assert found.grounded == (1 if watch.floor is not None and "0.62" in watch.floor.name else 0)


@pytest.mark.tried(1)  # seeds
@pytest.mark.parametrize("seed", [0, 1])
def test_an_estimate_that_wanders_and_turns_its_heading_does_not_fail(seed: int) -> None:
    wanders = ("sim.estimate_wander_m=0.05", "sim.estimate_yaw_step_deg=19")
    watch = Watch("paper", overrides=wanders, source="odometry")
    (found,) = watch_all([watch], (seed,), workers=1)
    assert ended(found) == []
    assert [one.why for one in found.flights if not one.landed] == []


@pytest.mark.tried(1)  # seeds
@pytest.mark.parametrize("seed", [16, 18])
def test_an_estimate_that_has_its_height_wrong_on_the_floor_has_touched_down_all_the_same(
    seed: int,
) -> None:
    wanders = (
        "sim.own_estimate=true",
        "sim.estimate_wander_m=0.05",
        "sim.estimate_yaw_step_deg=19",
    )
    watch = Watch("quad1kg", overrides=wanders, source="odometry")
    (found,) = watch_all([watch], (seed,), workers=1)
    assert [one.why for one in found.flights if not one.landed] == []


@pytest.mark.parametrize("name", ["px4_takeoff", "ardupilot_landing"])
def test_poses_of_real_autopilots_do_not_fail(name: str) -> None:
    found = recorded_flights(GOLDEN / f"{name}.tlog", [])
    assert ended(found) == []
    assert found.windows > 50
