"""Ends of flights: landing on request, poses that stop, a refusal to confirm, a lost link."""

import asyncio
import itertools
import re
from typing import Any

import pytest

from groundstation.core.mission import State
from groundstation.flight import Flight
from sim.runs import Stage
from sim.runs.flight import Script
from tests.flight.flights import after, cover_cameras, fly_beside, flying, nothing

OWN_POSES = ("pose.kind=mavlink",)
STRUCK_S = 2.0
"""On the trajectory when something happens [s]."""


def test_poses_that_stop_are_answered_by_a_bring_down_and_then_by_silence() -> None:
    wire = fly_beside(after(STRUCK_S, cover_cameras))
    stopped_s = wire.begun_s + STRUCK_S
    assert wire.state is State.ABORTED
    assert "no pose for" in wire.reason
    assert "bring-down" in wire.reason
    last, final, _ = wire.frames[-1]
    assert stopped_s + 0.15 + 1.5 <= last <= stopped_s + 0.25 + 2.0 + 1e-9
    assert final == 0.0
    # Nothing at all leaves afterwards, not even a heartbeat: the socket is closed.
    assert max(t for t, _ in wire.sent) <= stopped_s + 2.30
    touchdown = wire.stage.plant.floor.touchdown_m_s
    assert touchdown is not None and touchdown < 2.0


async def land_at_once(flight: Flight, _: Stage) -> None:
    flight.land("changed my mind")


async def see_nothing(flight: Flight, stage: Stage) -> None:
    cover_cameras(flight, stage)


async def know_no_position(_: Flight, stage: Stage) -> None:
    stage.autopilot.has_estimate = False


async def fail_odometry(_: Flight, stage: Stage) -> None:
    number = stage.autopilot.codec.message_number("ODOMETRY")
    build = stage.autopilot._build[number]

    def build_failed(now_s: float, boot_s: float) -> Any:
        message = build(now_s, boot_s)
        message.quality = -1
        return message

    stage.autopilot._build[number] = build_failed


async def refuse() -> bool:
    return False


NO_POSE = r"no pose within 5 s.*pose.kind = vicon \(pose.listen = 127.0.0.1:51001, pose.object = "
FAILED = r"were dropped: failed \(the sender says that its odometry has failed"
NO_ESTIMATE = "the autopilot sends but has no estimate of its position yet"


@pytest.mark.parametrize(
    ("script", "overrides", "options", "says"),
    [
        (nothing, (), {"confirm": refuse}, "did not confirm"),
        (nothing, ("flight.floor_z_m=0.1",), {}, "the poses show the vehicle on its floor"),
        (land_at_once, (), {}, "changed my mind"),
        (see_nothing, (), {}, NO_POSE),
        (know_no_position, OWN_POSES, {}, NO_ESTIMATE),
        (fail_odometry, OWN_POSES, {}, FAILED),
    ],
)
def test_a_flight_that_may_not_or_can_not_begin_moves_nothing_and_says_why(
    script: Script, overrides: tuple[str, ...], options: dict[str, Any], says: str
) -> None:
    wire = fly_beside(script, *overrides, **options)
    assert wire.state is State.ABORTED
    assert re.search(says, wire.reason), wire.reason
    assert "Config(" not in wire.reason
    assert wire.stage.plant.released_s is None
    assert all(frame.thrust == 0.0 for frame in wire.frames)


def test_a_stream_of_garbage_beside_the_poses_changes_nothing_but_the_counters() -> None:
    counted: dict[str, int] = {}

    async def script(flight: Flight, __: Stage) -> None:
        loop = asyncio.get_running_loop()
        garbage, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol)
        await flying(flight, 1.0)
        for i in range(200):
            garbage.sendto(bytes([i % 256]) * (i * 7 % 1400), ("127.0.0.1", 51001))
            garbage.sendto(bytes([i % 256]) * (i * 3 % 300), ("127.0.0.1", 14540))
            await asyncio.sleep(0.01)
        counted.update(flight.snapshot().poses_dropped)
        flight.land("done")

    wire = fly_beside(script)
    assert wire.state is State.LANDED
    assert sum(counted.values()) >= 190


def test_an_autopilot_that_somebody_else_disarms_ends_the_commands() -> None:
    wire = fly_beside(after(STRUCK_S, lambda _, stage: setattr(stage.autopilot, "armed", False)))
    assert wire.state is State.ABORTED
    assert "the vehicle is disarmed" in wire.reason
    # Its next heartbeat, our next look.
    assert wire.frames[-1].time_s < wire.begun_s + STRUCK_S + 1.0 + 0.5 + 0.1


def test_an_autopilot_that_disarms_by_itself_on_the_floor_has_landed_us() -> None:
    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, STRUCK_S)
        flight.land("done")
        while stage.plant.truth(asyncio.get_running_loop().time()).position_ned[2] < 0.9:
            await asyncio.sleep(0.01)
        stage.autopilot.armed = False

    wire = fly_beside(script)
    assert wire.state is State.LANDED


def test_an_autopilot_that_goes_silent_and_hears_us_still_is_landed() -> None:
    fastest: list[float] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, STRUCK_S)
        stage.peer.cut(True, hears=True)
        while not (truth := stage.plant.truth(asyncio.get_running_loop().time())).on_ground:
            fastest.append(truth.velocity_ned[2])
            await asyncio.sleep(0.01)

    wire = fly_beside(script)
    assert wire.state is State.ABORTED
    assert "the link is lost" in wire.reason
    assert "the autopilot was in OFFBOARD when last heard" in wire.reason
    assert "armed" not in wire.reason.split()  # nobody can know
    assert max(fastest) < 0.8


def test_an_autopilot_that_neither_hears_nor_is_heard_ends_the_commands() -> None:
    wire = fly_beside(after(STRUCK_S, lambda _, stage: stage.peer.cut(True)))
    assert wire.state is State.ABORTED
    assert "the link is lost" in wire.reason
    lifts = [frame.time_s for frame in wire.frames if frame.thrust > 0.0]
    # Its heartbeat missed, and the landing that the poses show.
    assert max(lifts) < wire.begun_s + STRUCK_S + 8.0


def test_a_request_to_land_ends_softly_and_disarmed_and_frames_leave_every_22_5_ms() -> None:
    wire = fly_beside(after(STRUCK_S, lambda flight, _: flight.land("enough")))
    assert wire.state is State.LANDED
    assert not wire.stage.autopilot.armed
    touchdown = wire.stage.plant.floor.touchdown_m_s
    assert touchdown is not None and touchdown < 0.5
    gaps = [b.time_s - a.time_s for a, b in itertools.pairwise(wire.frames)]
    assert sorted(gaps)[len(gaps) // 2] == pytest.approx(0.0225, abs=1e-9)
