"""Poses forwarded to the simulated autopilots' estimators: true, at their rate, only good ones."""

import asyncio
import itertools
import math
from collections.abc import Awaitable, Callable

import pytest

from groundstation.core.health.pose_gate import PoseGate
from groundstation.core.messages import Ask, FlightEvent, Notice, Reply, Request, tell_lines
from groundstation.core.mission import State
from groundstation.flight import Flight, make_flight
from links.mavlink.protocol import MavlinkCodec
from sim.autopilots import Px4Autopilot
from sim.runs import Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from tests.external_poses import ExternalPoses
from tests.flight.flights import mission
from tests.known import known
from tests.loops import in_virtual_time, running, until

ON = "link.forward.enabled=true"


def ready(
    *overrides: str,
    autopilot: str = "px4",
    source: str = "vicon",
    meanwhile: Callable[[Stage, ExternalPoses], Awaitable[None]],
) -> tuple[ExternalPoses, Stage]:
    """Wait to be armed, with ``meanwhile`` beside it, and return what the autopilot received."""
    world, config = prepare(SCENARIOS["quad1kg"], list(overrides), source=source)
    external: list[ExternalPoses] = []

    async def main() -> Stage:
        async with running(Stage(world, config, seed=1, autopilot=autopilot)) as stage:
            external.append(ExternalPoses.of(stage))
            async with running(make_flight(config, confirm=confirm_at(1e6), wires=stage.wires)):
                await meanwhile(stage, external[0])
        return stage

    stage = in_virtual_time(main)()
    return external[0], stage


async def three_seconds(stage: Stage, external: ExternalPoses) -> None:
    await asyncio.sleep(3.0)


@pytest.mark.tried(3)  # each source once
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("source", ["vicon", "natnet", "json"])
def test_each_autopilot_fuses_what_the_cameras_see(autopilot: str, source: str) -> None:
    external, stage = ready(ON, autopilot=autopilot, source=source, meanwhile=three_seconds)
    assert not external.left
    last = external.fused[-60:]
    rate = (len(last) - 1) / (last[-1].arrival_s - last[0].arrival_s)
    assert rate == pytest.approx(40.0, rel=0.02)
    for fused in last:
        north, east, down = stage.world.start_ned
        place = (north, east, down - stage.world.floor_z_m)
        assert fused.position == pytest.approx(place, abs=0.005)
        assert fused.attitude == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=0.02)
        # On the clock that answers TIMESYNC.
        assert fused.arrival_s - fused.stamp_s == pytest.approx(0.01, abs=0.002)
        assert fused.variance == pytest.approx((0.005**2, math.radians(0.5) ** 2), rel=1e-5)
        if autopilot == "px4":
            # Differences of positions tell its filter nothing new.
            assert fused.velocity_body is None
        else:
            assert fused.velocity_body is not None, "it would take NaN for a velocity"
            assert fused.velocity_body == pytest.approx((0.0, 0.0, 0.0), abs=0.06)
    assert len({fused.resets for fused in external.fused}) == 1


@pytest.mark.parametrize(("autopilot", "times"), [("ardupilot", 3), ("px4", 0)])
def test_ardupilot_is_told_an_origin_once_a_second_until_it_is_armed(
    autopilot: str, times: int
) -> None:
    codec, origins = MavlinkCodec(1, 1), list[tuple[float, float]]()

    async def listen(stage: Stage, external: ExternalPoses) -> None:
        def overhear(_: float, data: bytes) -> None:
            for message in codec.feed(data):
                if message.get_type() == "SET_GPS_GLOBAL_ORIGIN":
                    origins.append((1e-7 * message.latitude, 1e-7 * message.longitude))

        stage.peer.overhear = overhear
        await asyncio.sleep(3.0)

    ready(ON, autopilot=autopilot, meanwhile=listen)
    assert len(origins) in ((times - 1, times) if times else (0,))
    assert all(one == pytest.approx((47.397742, 8.545594)) for one in origins)


def test_a_pilot_who_takes_over_keeps_the_poses_until_the_motors_stop() -> None:
    external, lines = taken_over()
    disarmed_s = next(time_s for time_s, line in lines if "motors have stopped" in line)
    taken_s = next(time_s for time_s, line in lines if line.startswith("handed_over"))
    after = [fused.arrival_s for fused in external.fused if fused.arrival_s > taken_s]
    assert disarmed_s - taken_s > 2.0, "it has to come down first"
    assert after[-1] == pytest.approx(disarmed_s, abs=0.2)
    assert max(b - a for a, b in itertools.pairwise([taken_s, *after])) < 0.05


@pytest.mark.parametrize("ask", [Ask.DESCEND, Ask.ABORT])
def test_poses_after_a_flight_end_when_asked_twice_and_not_by_a_request_to_land(ask: Ask) -> None:
    replies: list[Reply] = []

    async def asked(flight: Flight) -> None:
        for one in (Ask.LAND, ask):
            await asyncio.sleep(0.5)
            replies.append(flight.ask(Request(one, "a test")))

    external, lines = taken_over(asked)
    taken_s = next(time_s for time_s, line in lines if line.startswith("handed_over"))
    assert [reply.done for reply in replies] == [False, True]
    assert "the autopilot brings the vehicle down" in replies[0].says
    over = "nothing is sent to the vehicle any more, as"
    end_s = next(time_s for time_s, line in lines if line.startswith(over))
    assert end_s == pytest.approx(taken_s + 1.0, abs=0.2)
    assert external.fused[-1].arrival_s == pytest.approx(end_s, abs=0.15)


def test_poses_that_the_flight_rejects_do_not_reach_the_autopilot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    external: list[ExternalPoses] = []
    rejected_s: list[float] = []
    lines: list[str] = []

    async def script(flight: Flight, stage: Stage) -> None:
        external.append(ExternalPoses.of(stage))
        await until(lambda: flight.state is State.TRACKING)
        await asyncio.sleep(2.0)
        monkeypatch.setattr(PoseGate, "accepts", lambda *_: False)
        rejected_s.append(asyncio.get_running_loop().time())

    hear = tell_lines(lines.append)
    own = "sim.own_estimate=true"
    mission("paper", ON, own, figure_s=30.0, seed=1, watch=hear, script=script)
    told = "\n".join(lines)
    assert len(external[0].fused) > 60
    # Those of before alone.
    assert all(one.arrival_s <= rejected_s[0] + 0.001 for one in external[0].fused)
    assert "aborted: no pose for" in told
    assert "poses go on" not in told, "nor after the last command"


def taken_over(
    beside: Callable[[Flight], Awaitable[None]] | None = None,
) -> tuple[ExternalPoses, list[tuple[float, str]]]:
    """A mission whose pilot takes over on the figure and lands by hand; what was told, and when."""
    lines: list[tuple[float, str]] = []
    external: list[ExternalPoses] = []

    async def script(flight: Flight, stage: Stage) -> None:
        external.append(ExternalPoses.of(stage))
        await until(lambda: flight.state is State.TRACKING)
        assert isinstance(stage.autopilot, Px4Autopilot)
        stage.autopilot.take_over(asyncio.get_running_loop().time())
        await until(lambda: flight.state is State.HANDED_OVER)
        if beside is not None:
            await beside(flight)

    def hear(event: FlightEvent) -> None:
        if isinstance(event, Notice):
            lines.append((event.time_s, event.says))

    mission("paper", ON, figure_s=30.0, seed=1, watch=hear, script=script)
    return external[0], lines


def test_forwarding_stops_when_poses_stop_and_goes_on_when_they_are_back() -> None:
    stopped: list[int] = []

    async def covered(stage: Stage, external: ExternalPoses) -> None:
        await asyncio.sleep(2.0)
        known(stage.mocap).cover(True)
        await asyncio.sleep(0.05)
        stopped.append(len(external.fused))
        await asyncio.sleep(2.0)
        stopped.append(len(external.fused))
        known(stage.mocap).cover(False)
        await asyncio.sleep(1.0)

    external, _ = ready(ON, meanwhile=covered)
    assert stopped[0] == stopped[1] > 20
    assert len(external.fused) > stopped[1] + 30


def test_a_pose_that_the_gate_drops_does_not_reach_the_autopilot() -> None:
    mishaps = ("sim.swap_s=0.2", "sim.mishap_period_s=1", "sim.other_bodies=1")
    external, stage = ready(ON, *mishaps, source="json", meanwhile=three_seconds)
    assert len(external.fused) > 60
    north, east, down = stage.world.start_ned
    there = north, east, down - stage.world.floor_z_m
    assert all(math.dist(fused.position, there) < 0.01 for fused in external.fused)
