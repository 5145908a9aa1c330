"""Each pose source's "do not use" in flight: the pose is dropped, counted and told of."""

import asyncio
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import pytest

from groundstation.core.geometry import so3
from groundstation.core.messages import PoseRecord, tell_lines
from groundstation.core.mission import State
from groundstation.flight import FlightOutcome, make_flight
from groundstation.pose.sources import describe_drop
from sim.runs import Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from sim.trackers import TrackedBody
from tests.loops import in_virtual_time, running
from tests.proving.faults import stand_between

BEGIN_S = 3.0
"""The field is set from here on, in flight [s]."""
MOMENT_S = 0.15
"""Shorter than what a flight survives without a pose [s]."""
LATENCY_S = 0.05
"""A pose was taken at most so long before it is sent [s]."""
NOWHERE = (math.nan, math.nan, math.nan)


def not_tracked(body: TrackedBody) -> TrackedBody:
    """A body that the tracker does not see, as each simulated tracker writes it."""
    return body._replace(tracked=False)


def occluded(body: TrackedBody) -> TrackedBody:
    """An object that a Vicon Tracker does not see is all zeros."""
    return body._replace(position_ned=(0.0, 0.0, 0.0), attitude=so3.IDENTITY)


def without_place(body: TrackedBody) -> TrackedBody:
    """A bridge has no flag: its position is none."""
    return body._replace(position_ned=NOWHERE)


class Flown(NamedTuple):
    """Outcome of a flight."""

    outcome: FlightOutcome
    said: list[str]
    used_s: list[float]
    """Instants of the poses that were used, since the field was set [s]."""
    dropped: dict[str, int]
    """Poses dropped, by reason, as the screens have them."""


def flown(
    monkeypatch: pytest.MonkeyPatch, source: str, lasts_s: float, spoil: Callable[[Any], Any]
) -> Flown:
    """Fly while what the source sends is spoilt for ``lasts_s`` [s]."""
    world, config = prepare(SCENARIOS["paper"], ["flight.duration_s=3"], source=source)
    said: list[str] = []

    async def main() -> Flown:
        loop = asyncio.get_running_loop()
        begin_s = loop.time() + BEGIN_S
        used_s: list[float] = []

        def keep(record: Any) -> None:
            if isinstance(record, PoseRecord):
                used_s.append(record.pose.time_s - begin_s)

        def is_bad() -> bool:
            return begin_s <= loop.time() < begin_s + lasts_s

        def seen(_: float, bodies: Sequence[TrackedBody]) -> Sequence[TrackedBody]:
            return [spoil(body) for body in bodies] if is_bad() else bodies

        stage = Stage(world, config, 0)
        if (meddler := stand_between(stage)) is not None:
            meddler.picture = seen
        else:
            pack = stage.autopilot.codec.pack

            def spoil_odometry(message: Any) -> bytes:
                return pack(
                    spoil(message) if message.get_type() == "ODOMETRY" and is_bad() else message
                )

            monkeypatch.setattr(stage.autopilot.codec, "pack", spoil_odometry)
        hear = (tell_lines(said.append), keep)
        flight = make_flight(config, confirm=confirm_at(0.0), subscribers=hear)
        async with running(stage):
            outcome = await flight.run()
        since_s = [at_s for at_s in used_s if at_s >= 0.0]
        return Flown(outcome, said, since_s, flight.snapshot().poses_dropped)

    return in_virtual_time(main)()


def failed(odometry: Any) -> Any:
    """ODOMETRY of an estimator that has failed."""
    odometry.quality = -1
    return odometry


FIELDS = [
    ("vicon", occluded, "not_tracked"),
    ("natnet", not_tracked, "not_tracked"),
    ("qualisys", not_tracked, "not_tracked"),
    ("json", not_tracked, "not_tracked"),
    ("vision", without_place, "not_finite"),
    ("odometry", failed, "failed"),
]
"""Source, the field that is set, and the reason for which its poses are dropped."""


@pytest.mark.parametrize(("source", "spoil", "reason"), FIELDS)
def test_a_pose_that_is_not_to_be_used_ends_the_flight_as_a_lost_one_does(
    source: str, spoil: Callable[[Any], Any], reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = flown(monkeypatch, source, 60.0, spoil)
    assert flight.used_s == []
    assert flight.outcome.state is State.ABORTED
    assert flight.outcome.reason.startswith("no pose for 2"), "flight.coast_s, and a frame"
    assert flight.dropped[reason] > 50, "during the bring-down, too"
    drop = describe_drop(reason).text
    assert any(f"poses are dropped: {drop}" in line for line in flight.said)
    # And afterwards.
    assert any("poses were dropped, limit 1 %" in line and drop in line for line in flight.said)


@pytest.mark.tried(2)  # sources
@pytest.mark.parametrize(("source", "spoil", "reason"), FIELDS)
def test_a_flight_survives_a_moment_of_such_poses(
    source: str, spoil: Callable[[Any], Any], reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = flown(monkeypatch, source, MOMENT_S, spoil)
    assert min(flight.used_s) >= MOMENT_S - LATENCY_S
    assert flight.outcome.state is State.LANDED, flight.outcome.reason
    assert any(f"poses are dropped: {describe_drop(reason)}" in line for line in flight.said)
    assert any(f"{reason} is over" in line for line in flight.said)
