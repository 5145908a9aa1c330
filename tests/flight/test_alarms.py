"""True flights from the floor with the monitor of the poses: none ends by its poses."""

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.core.geometry import Quat, Vec3, so3
from links.mavlink.protocol import MavlinkCodec
from sim.__main__ import main
from tests import shadow_flight
from tests.proving import alarms as alarms_command
from tests.proving.alarms import WRONGS, Alarms, Watch, WatchedFlight, plan_floors, watch_all
from tests.proving.alarms import watch_capture as recorded_flights
from tests.shadow_flight import GRAVITY, NOTHING, D

GOLDEN = Path(__file__).parents[1] / "golden"


def ended(found: Alarms) -> list[tuple[int, str]]:
    return [(one.seed, one.failed) for one in found.ended]


@pytest.mark.tried(3)  # the same scenarios by more seeds
@pytest.mark.parametrize("first", range(0, 8, 4))
@pytest.mark.parametrize("scenario", ["adverse", "storm", "gust_front"])
def test_no_flight_in_bad_air_ends_by_its_poses(scenario: str, first: int) -> None:
    (found,) = watch_all([Watch(scenario, figure_s=5.0)], range(first, first + 4), workers=1)
    assert ended(found) == []
    assert found.alarm < 1.0
    assert all(one.windows > 200 for one in found.flights), "it looked all the way"
    assert found.alarm > 0.0, "and it saw something"


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


def test_a_flight_that_its_poses_end_is_told_and_the_command_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failed = WatchedFlight(
        seed=7, windows=10, alarm=1.1, suspected=2, failed="pose.stopped_dead", landed=False, why="it stopped"
    )  # fmt: skip
    fenced = msgspec.structs.replace(failed, seed=8, failed="", why="a fence")
    found = [Alarms(name="adverse", flights=(failed, fenced))]
    monkeypatch.setattr(alarms_command, "watch_all", lambda *_, **__: found)
    monkeypatch.setattr(sys, "argv", ["groundstation-sim", "dev", "alarms", "--flights", "2"])
    assert main() == 1
    told = capsys.readouterr().out.splitlines()
    assert "2 flights, 1 ended by their poses, 2 suspected; largest alarm 1.10" in told[0]
    assert told[1:] == [
        "  seed 7: pose.stopped_dead: it stopped",
        "  seed 8: did not land as planned: a fence",
    ]


class Hop(shadow_flight.Flight, frozen=True):
    """Up to 1.5 m and down again, swinging sideways."""

    def place(self, t: float) -> Vec3:
        """[m, NED]"""
        since = min(max(t - 1.0, 0.0), self.duration_s)
        share = 0.5 - 0.5 * math.cos(math.tau * since / self.duration_s)
        return 0.0, 0.5 * share * math.sin(2.5 * since), -1.5 * share

    def motion(self, t: float) -> tuple[Vec3, Vec3, Quat, float]:
        """Position, velocity, attitude and thrust (share of full) at ``t`` [s]."""
        h = 1e-3
        before, here, after = (self.place(t + step) for step in (-h, 0.0, h))
        north, east, down = ((b - a) / (2.0 * h) for a, b in zip(before, after, strict=True))
        _, aside, sinking = ((a - 2.0 * b + c) / (h * h) for a, b, c in zip(before, here, after, strict=True))
        force = math.hypot(aside, GRAVITY - sinking)
        attitude = so3.from_euler_zyx(math.asin(aside / force), 0.0, 0.0)
        flies = 1.0 <= t < 1.0 + self.duration_s
        return here, (north, east, down), attitude, self.hover * force / GRAVITY if flies else 0.2 * self.hover


class Held(Hop, frozen=True):
    """Its poses stand from four seconds on; the set-points go on as if nothing were."""

    def _odometry(self, t: float, sender: MavlinkCodec, aside_m: float = 0.0) -> bytes:
        (x, y, z), _, attitude, _ = self.motion(min(t, 4.0))
        return sender.pack(
            D.MAVLink_odometry_message(round(1e6 * t), 1, 1, x, y, z, attitude, *(6 * [0.0]), NOTHING, NOTHING, 0, 8, 0)
        )


@pytest.fixture
def capture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[shadow_flight.Flight], tuple[int, Any]]:
    def look(flight: shadow_flight.Flight) -> tuple[int, Any]:
        recording = tmp_path / "flight.tlog"
        recording.write_bytes(flight.tlog())
        monkeypatch.setattr(sys, "argv", ["groundstation-sim", "dev", "alarms", "--capture", str(recording), "--json"])
        code, told = main(), capsys.readouterr()
        return code, json.loads(told.out) if told.out else told.err

    return look


Look = Callable[[shadow_flight.Flight], tuple[int, Any]]


def test_a_recorded_flight_is_looked_at_as_one_of_ours(capture: Look) -> None:
    code, (told,) = capture(Hop())
    assert told["ended_by_poses"] == 0
    assert told["alarm"] < 1.0
    assert told["windows"] > 20
    assert code == 0


def test_recorded_poses_that_stand_fail(capture: Look) -> None:
    code, (told,) = capture(Held())
    assert told["ended_by_poses"] == 1
    assert not told["flights"][0]["landed"]
    assert code == 1


@pytest.mark.parametrize("name", ["px4_takeoff", "ardupilot_landing"])
def test_poses_of_real_autopilots_do_not_fail(name: str) -> None:
    found = recorded_flights(GOLDEN / f"{name}.tlog", [])
    assert ended(found) == []
    assert found.windows > 50


def test_a_recording_without_set_points_says_what_is_missing(capture: Look) -> None:
    code, told = capture(Hop(armed=False))
    assert code == 2
    assert "SET_ATTITUDE_TARGET" in told
