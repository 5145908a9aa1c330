"""How flights end: landing on request, poses that stop, an operator who says no, a vehicle that crashes."""

import asyncio
import struct
from collections.abc import Callable, Coroutine
from typing import Any

import msgspec
import pytest

from groundstation.core.mission import State
from groundstation.flight import Flight, FlightOutcome, make_flight
from groundstation.settings import Config
from sim.runs import Stage
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from sim.world import World
from tests.flight.flights import flown, flying, running

Script = Callable[[Flight, Stage], Coroutine[Any, Any, None]]


class Scene:
    """One flight against the simulated side, and what came of it."""

    outcome: FlightOutcome
    stage: Stage
    sent: list[tuple[float, bytes]]

    @property
    def thrusts(self) -> list[tuple[float, float]]:
        """When each SET_ATTITUDE_TARGET left, and its thrust field [0..1]."""
        frames = [(t, data.ljust(60, b"\0")) for t, data in self.sent if data[7:10] == b"\x52\x00\x00"]
        return [(t, struct.unpack_from("<f", frame, 10 + 32)[0]) for t, frame in frames]


def play(script: Script, world_changes: dict[str, Any], *overrides: str, arm: bool = True) -> Scene:
    """Fly in virtual time with ``script`` running beside."""
    world, config = prepare(SCENARIOS["paper"], list(overrides))
    world = msgspec.structs.replace(world, **world_changes)
    scene = Scene()
    scene.sent = []
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        loop = runner.get_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.tap = lambda t, source, _, data: scene.sent.append((t, data)) if source[1] == 14540 else None
        runner.run(_play(scene, world, config, script, arm))
    return scene


async def _play(scene: Scene, world: World, config: Config, script: Script, arm: bool) -> None:
    async def confirm() -> bool:
        return arm

    async with running(Stage(world, config, 0)) as scene.stage:
        flight = make_flight(config, confirm=confirm)
        beside = asyncio.create_task(script(flight, scene.stage))
        scene.outcome = await flight.run()
        await asyncio.sleep(5.0)  # whatever still leaves or happens afterwards is seen
        beside.cancel()
        await asyncio.gather(beside, return_exceptions=True)


def test_poses_that_stop_are_answered_by_a_bring_down_within_the_coast_limit_and_then_by_silence() -> None:
    stopped: list[float] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, 5.0)
        assert stage.mocap is not None
        stage.mocap.cover(True)
        stopped.append(asyncio.get_running_loop().time())

    scene = play(script, {})
    assert scene.outcome.state is State.ABORTED
    assert "no pose for" in scene.outcome.reason
    assert "bring-down" in scene.outcome.reason
    last, final = scene.thrusts[-1]
    assert stopped[0] + 0.15 + 1.5 <= last <= stopped[0] + 0.25 + 2.0 + 1e-9
    assert final == 0.0
    # Nothing at all leaves afterwards, not even a heartbeat: the socket is closed.
    assert max(t for t, _ in scene.sent) <= stopped[0] + 2.30
    touchdown = scene.stage.plant.floor.touchdown_m_s
    assert touchdown is not None and touchdown < 2.0


async def nothing(_flight: Flight, _stage: Stage) -> None:
    """Nothing happens beside the flight."""


def test_an_operator_who_does_not_confirm_moves_nothing() -> None:
    scene = play(nothing, {}, arm=False)
    assert scene.outcome.state is State.ABORTED
    assert "did not confirm" in scene.outcome.reason
    assert not scene.thrusts
    assert scene.stage.plant.released_s is None


def test_a_request_to_land_before_take_off_ends_at_once() -> None:
    async def script(flight: Flight, _: Stage) -> None:
        flight.land("changed my mind")

    scene = play(script, {})
    assert scene.outcome.state is State.ABORTED
    assert "changed my mind" in scene.outcome.reason
    assert scene.stage.plant.released_s is None


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

    scene = play(script, {})
    assert scene.outcome.state is State.LANDED
    assert sum(counted.values()) >= 190


def test_no_poses_at_all_is_said_with_what_to_check() -> None:
    async def script(_: Flight, stage: Stage) -> None:
        assert stage.mocap is not None
        stage.mocap.cover(True)

    scene = play(script, {})
    assert scene.outcome.state is State.ABORTED
    assert "no pose within 5 s" in scene.outcome.reason
    assert "pose.kind = vicon (pose.listen = 127.0.0.1:51001, pose.object = " in scene.outcome.reason
    assert "Config(" not in scene.outcome.reason


def test_an_autopilot_that_is_heard_and_knows_no_position_yet_is_told_as_that() -> None:
    async def script(_: Flight, stage: Stage) -> None:
        stage.autopilot.has_estimate = False

    scene = play(script, {}, "pose.kind=mavlink")
    assert scene.outcome.state is State.ABORTED
    assert "the autopilot sends but has no estimate of its position yet" in scene.outcome.reason
    assert "Config(" not in scene.outcome.reason


def test_an_autopilot_whose_odometry_has_failed_is_told_as_that() -> None:
    async def script(_: Flight, stage: Stage) -> None:
        build = stage.autopilot._build
        number = stage.autopilot.codec.message_number("ODOMETRY")
        whole = build[number]

        def build_failed(now_s: float, boot_s: float) -> Any:
            message = whole(now_s, boot_s)
            message.quality = -1
            return message

        build[number] = build_failed

    scene = play(script, {}, "pose.kind=mavlink")
    assert scene.outcome.state is State.ABORTED
    assert "were dropped: failed (the sender says that its odometry has failed" in scene.outcome.reason


def test_an_autopilot_that_somebody_else_disarms_ends_the_commands() -> None:
    when: list[float] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, 4.0)
        stage.autopilot.armed = False
        when.append(asyncio.get_running_loop().time())

    scene = play(script, {})
    assert scene.outcome.state is State.ABORTED
    assert "the vehicle is disarmed" in scene.outcome.reason
    assert scene.thrusts[-1][0] < when[0] + 1.0 + 0.5 + 0.1  # its next heartbeat, our next look


def test_an_autopilot_that_disarms_by_itself_on_the_floor_has_landed_us() -> None:
    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, 4.0)
        flight.land("done")
        while stage.plant.truth(asyncio.get_running_loop().time()).position_ned[2] < 0.9:
            await asyncio.sleep(0.01)
        stage.autopilot.armed = False

    scene = play(script, {})
    assert scene.outcome.state is State.LANDED


def test_an_autopilot_that_goes_silent_and_hears_us_still_is_landed() -> None:
    fastest: list[float] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, 4.0)
        stage.peer.cut(True, hears=True)
        while not (truth := stage.plant.truth(asyncio.get_running_loop().time())).on_ground:
            fastest.append(truth.velocity_ned[2])
            await asyncio.sleep(0.01)

    scene = play(script, {})
    assert scene.outcome.state is State.ABORTED
    assert "the link is lost" in scene.outcome.reason
    assert "the autopilot was in OFFBOARD when last heard" in scene.outcome.reason
    assert "armed" not in scene.outcome.reason.split()  # nobody can know
    assert max(fastest) < 0.8


def test_an_autopilot_that_neither_hears_nor_is_heard_ends_the_commands() -> None:
    when: list[float] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, 4.0)
        stage.peer.cut(True)
        when.append(asyncio.get_running_loop().time())

    scene = play(script, {})
    assert scene.outcome.state is State.ABORTED
    assert "the link is lost" in scene.outcome.reason
    lifts = [t for t, thrust in scene.thrusts if thrust > 0.0]
    assert max(lifts) < when[0] + 8.0  # its heartbeat missed, and the landing that the poses show


def test_a_flight_into_the_floor_is_reported_as_a_crash() -> None:
    result = flown("paper", "sim.thrust_gain=0.3", duration_s=10.0)
    assert not result.completed
    assert "floor" in result.why


def test_a_request_to_land_ends_softly_on_the_floor_and_disarmed_and_frames_leave_every_22_5_ms() -> None:
    async def script(flight: Flight, _: Stage) -> None:
        await flying(flight, 6.0)
        flight.land("enough")

    scene = play(script, {})
    assert scene.outcome.state is State.LANDED
    assert not scene.stage.autopilot.armed
    touchdown = scene.stage.plant.floor.touchdown_m_s
    assert touchdown is not None and touchdown < 0.5
    gaps = [b - a for (a, _), (b, _) in zip(scene.thrusts, scene.thrusts[1:], strict=False)]
    assert sorted(gaps)[len(gaps) // 2] == pytest.approx(0.0225, abs=1e-9)
