"""Contract of every link, on both event loops, towards a simulated other end: its bench."""

import asyncio
import contextlib
import itertools
import math
from collections.abc import AsyncIterator, Callable
from functools import partial
from typing import Any, Protocol

import msgspec
import pytest

from links import make_link
from links.bridge import Bridge, BridgeConfig, BridgeLinkConfig
from links.core import Command, CommandLink, LinkError, LinkLost, LinkMisuse, Segment
from links.io import parse_address
from links.make import LINKS
from links.mavlink import MavlinkLinkConfig
from links.rf import RF_CODECS
from links.rf.channel_map import ArmSwitch
from sim.autopilots import AutopilotPeer, Px4Autopilot
from sim.radio import PtyWire, RfPeer, RfReceiver, WirePort
from sim.radio.radio import opened_on
from tests.airframe_double import Brick, nonce
from tests.loops import free_address, in_virtual_time, is_virtual, on_either_loop, running, until

THRUST_MAX_N = 2.0
BRING_DOWN = (
    Segment(0.2, 0.8, (0.4, 0.0, 0.0)),
    Segment(0.3, 0.6, (0.0, 0.0, 0.0)),
    Segment(0.1, 0.0, (0.0, 0.0, 0.0)),
)


class Bench(Protocol):
    """The other end of one kind of link."""

    vehicle: Brick
    config: Any
    wires: dict[str, Any]
    """What the link gets in the place of hardware."""
    steps: tuple[float, float]
    """Tolerance of what arrives: share of the thrust, rates [rad/s]."""
    grain_s: float
    """Tolerance of the instant at which it arrives [s]."""
    farewell_s: float
    """Duration of closing after the bring-down [s]."""

    async def prepare(self) -> None: ...

    async def prepare_nobody(self) -> str:
        """Configure a link to nobody; returns words of the error that this must end in."""
        ...

    async def run(self) -> None: ...

    def arrived(self) -> int:
        """Datagrams or frames that came from the link."""
        ...


class MavlinkBench:
    steps = (1e-3, 1e-3)
    grain_s = 2e-3
    farewell_s = 0.0

    def __init__(self) -> None:
        self.wires: dict[str, Any] = {}
        self.vehicle = Brick(0.0)
        self.autopilot = Px4Autopilot(self.vehicle)

    async def prepare(self) -> None:
        self.config = MavlinkLinkConfig(listen=await free_address(), period_s=0.01)

    async def prepare_nobody(self) -> str:
        self.config = MavlinkLinkConfig(listen=await free_address(), connect_timeout_s=0.3)
        return "nothing came at all"

    async def run(self) -> None:
        await AutopilotPeer(self.autopilot, parse_address(self.config.endpoint)).run()

    def arrived(self) -> int:
        return self.autopilot.codec.received


class RfBench:
    """A receiver on the network in memory, or on a pseudo-terminal in real time."""

    steps = (1e-3, 7e-3)
    grain_s = 0.01 + 1e-6
    farewell_s = 0.1

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.vehicle = Brick(0.0)
        self.wires: dict[str, Any] = {}
        self.config: Any = None
        self.pty: PtyWire | None = None

    async def prepare(self) -> None:
        changes: dict[str, Any] = {"period_s": 0.01, "disarm_s": self.farewell_s}
        if is_virtual():
            self.wires["open_pacer"] = opened_on(WirePort())
            changes |= {"arm_low_s": 0.3, "arm_high_s": 0.5}
        else:  # real time is dear
            self.pty = PtyWire()
            changes |= {"port": self.pty.path, "arm_low_s": 0.1, "arm_high_s": 0.1}
        order = msgspec.structs.replace(RF_CODECS[self.kind]().map, arm=ArmSwitch(channel=5))
        self.config = RF_CODECS[self.kind](**changes, map=order)
        self.peer = RfPeer(RfReceiver(self.vehicle, self.config), self.config)

    async def prepare_nobody(self) -> str:
        self.config = RF_CODECS[self.kind](port="/dev/no-such-port")
        if is_virtual():
            wire = WirePort()
            wire.cut = True
            self.wires["open_pacer"] = opened_on(wire)
        return "cannot open"

    async def run(self) -> None:
        if self.pty is None:
            await self.peer.run()
            return
        self.pty.listen(lambda data: self.peer.datagram_received(data, None))
        try:
            await self.peer.last()
        finally:
            self.pty.close()

    def arrived(self) -> int:
        return self.peer.receiver.frames


class CountingBridge(Bridge):
    """A bridge that counts what comes."""

    came = 0

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.came += 1
        super().datagram_received(data, addr)


class BridgeBench:
    """A bridge with a module of its own, which sends disarm frames also without a link."""

    KEY = bytes(range(1, 33))
    steps, grain_s, farewell_s = RfBench.steps, RfBench.grain_s, RfBench.farewell_s

    def __init__(self) -> None:
        self.module = RfBench("dsm")
        self.vehicle = self.module.vehicle
        self.wires = {"key": self.KEY, "nonce": nonce}
        self.config: Any = None

    async def prepare(self) -> None:
        await self.module.prepare()
        listen = await free_address()
        config = BridgeConfig(listen=listen, link=self.module.config)
        self.bridge = CountingBridge(config, self.KEY, **self.module.wires, nonce=nonce)
        self.config = BridgeLinkConfig(remote=listen)

    async def prepare_nobody(self) -> str:
        self.config = BridgeLinkConfig(remote=await free_address(), connect_timeout_s=0.3)
        return "no answer from a bridge"

    async def run(self) -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(self.module.run())
            group.create_task(self.bridge.run())

    def arrived(self) -> int:
        return self.bridge.came


BENCHES: dict[str, Callable[[], Bench]] = {
    "mavlink": MavlinkBench,
    "rf_bridge": BridgeBench,
    **{kind: partial(RfBench, kind) for kind in RF_CODECS},
}


def test_every_link_has_a_bench() -> None:
    assert BENCHES.keys() == LINKS.keys()


@pytest.fixture(params=list(LINKS))
def bench(request: pytest.FixtureRequest) -> Bench:
    return BENCHES[request.param]()


def command(
    thrust_n: float = 1.0, rates: tuple[float, float, float] = (0.1, -0.2, 0.3), **changes: float
) -> Command:
    now = asyncio.get_running_loop().time()
    return Command(thrust_n, rates, 7, now, changes.get("deadline_s", now + 0.25), BRING_DOWN)


def idle() -> Command:
    return command(0.0, (0.0, 0.0, 0.0))


@contextlib.asynccontextmanager
async def connected(bench: Bench) -> AsyncIterator[CommandLink]:
    await bench.prepare()
    link = make_link(bench.config, thrust_max_n=THRUST_MAX_N, **bench.wires)
    async with running(bench):
        try:
            await link.connect()
            yield link
        finally:
            await link.close()


@contextlib.asynccontextmanager
async def armed(bench: Bench) -> AsyncIterator[CommandLink]:
    async with connected(bench) as link:
        await link.arm(idle)
        yield link


def lifting(bench: Bench) -> list[tuple[float, float, Any]]:
    """What was done to the vehicle that could make it move."""
    return [act for act in bench.vehicle.acts if act[1] > 0.0]


@on_either_loop
async def test_an_armed_vehicle_does_what_is_sent_and_disarms(bench: Bench) -> None:
    async with connected(bench) as link:
        assert link.status.state == "connected"
        await link.arm(idle)
        assert link.status.state == "armed"
        assert bench.vehicle.powered[-1][1] is True
        bench.vehicle.acts.clear()
        before = link.status.sent
        assert link.send(command())
        await until(lambda: bool(lifting(bench)))
        _, thrust, rates = bench.vehicle.acts[-1]
        assert thrust == pytest.approx(0.5, abs=bench.steps[0])
        assert rates == pytest.approx((0.1, -0.2, 0.3), abs=bench.steps[1])
        assert link.status.sent > before
        if is_virtual():  # a late machine's link repeats it
            assert link.status.sent == before + 1
        zeros = asyncio.create_task(stream(link))
        await link.disarm()
        zeros.cancel()
        assert bench.vehicle.powered[-1][1] is False
        assert link.status.state == "connected"


async def stream(link: CommandLink) -> None:
    while True:
        link.send(idle())
        await asyncio.sleep(link.period_s)


@on_either_loop
async def test_commands_stream_at_the_links_period_while_it_arms(bench: Bench) -> None:
    loop = asyncio.get_running_loop()
    asked: list[float] = []

    def idle() -> Command:
        asked.append(loop.time())
        return command(0.0, (0.0, 0.0, 0.0))

    async with connected(bench) as link:
        begun = loop.time()
        await link.arm(idle)
        took = loop.time() - begun
        # In real time a busy machine repeats frames, or leaves them out.
        assert link.status.sent >= len(asked)
        least = 0.5 if is_virtual() else 0.1
        assert least * took / link.period_s < len(asked) <= took / link.period_s + 2
        if is_virtual():
            assert link.status.sent == len(asked)
            periods = [b - a for a, b in itertools.pairwise(asked)]
            assert periods == pytest.approx([link.period_s] * (len(asked) - 1))


@on_either_loop
async def test_a_command_past_its_deadline_never_leaves(bench: Bench) -> None:
    async with armed(bench) as link:
        now = asyncio.get_running_loop().time()
        assert not link.send(command(1.5, deadline_s=now - 0.001))
        for deadline_s in (math.nan, math.inf, now + 1.2):
            with pytest.raises(LinkMisuse):
                link.send(command(1.5, deadline_s=deadline_s))
        await asyncio.sleep(0.05)
        assert lifting(bench) == []
        assert link.status.expired == 1


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@in_virtual_time
async def test_a_number_that_is_not_finite_never_leaves(bench: Bench, bad: float) -> None:
    async with armed(bench) as link:
        with pytest.raises(LinkMisuse):
            link.send(command(bad))
        for rates in ((bad, 0.0, 0.0), (0.0, bad, 0.0), (0.0, 0.0, bad)):
            with pytest.raises(LinkMisuse):
                link.send(command(1.0, rates))
        await asyncio.sleep(0.05)
        assert lifting(bench) == []


@pytest.mark.parametrize(("thrust_n", "share"), [(-1.0, 0.0), (5.0, 1.0)])
@in_virtual_time
async def test_thrust_beyond_the_vehicles_is_clamped(
    bench: Bench, thrust_n: float, share: float
) -> None:
    async with armed(bench) as link:
        link.send(command(thrust_n))
        await asyncio.sleep(0.05)
        assert bench.vehicle.acts[-1][1] == share


@in_virtual_time
async def test_what_is_sent_before_anybody_has_armed_never_leaves(bench: Bench) -> None:
    async with connected(bench) as link:
        assert not link.send(command())
        assert link.status.sent == 0
        assert link.status.phase == "over"


def plays(acts: list[tuple[float, float, tuple[float, float, float]]]) -> list[tuple[float, float]]:
    """Runs of the same thrust (rounded, as a share) and how long each lasted."""
    times = [time_s for time_s, _, _ in acts]
    lasts = zip(acts, [*times[1:], times[-1]], strict=True)
    return [
        (share, sum(next_s - time_s for (time_s, _, _), next_s in run))
        for share, run in itertools.groupby(lasts, lambda act: round(act[0][1], 2))
    ]


@in_virtual_time
async def test_without_a_newer_command_the_newest_is_repeated_then_brought_down_then_nothing(
    bench: Bench,
) -> None:
    async with armed(bench) as link:
        bench.vehicle.acts.clear()
        assert link.send(command())
        assert link.status.phase == "fresh"
        await asyncio.sleep(0.4)
        assert link.status.phase == "bring_down"
        assert not link.send(command())  # a controller that wakes up again
        await link.silent()
        assert link.status.phase == "over"
        sent = link.status.sent
        acts = list(bench.vehicle.acts)
        await asyncio.sleep(1.0)
        assert not link.send(command())
        await asyncio.sleep(1.0)
        assert link.status.sent == sent
        runs = plays(acts)
        assert [share for share, _ in runs] == [0.5, 0.4, 0.3, 0.0]
        lasted = [lasted_s for _, lasted_s in runs[:3]]
        assert lasted == pytest.approx([0.25, 0.2, 0.3], abs=bench.grain_s)
        assert 0.05 < runs[3][1] <= 0.1 + bench.grain_s
        await link.arm(idle)
        assert link.send(command())


@in_virtual_time
async def test_closing_in_the_air_brings_down_first(bench: Bench) -> None:
    loop = asyncio.get_running_loop()
    async with armed(bench) as link:
        bench.vehicle.acts.clear()
        link.send(command())
        begun = loop.time()
        await link.close()
        assert loop.time() - begun == pytest.approx(0.25 + 0.6 + bench.farewell_s, abs=0.02)
        assert [share for share, _ in plays(bench.vehicle.acts)] == [0.5, 0.4, 0.3, 0.0]


@in_virtual_time
async def test_a_kill_cuts_the_bring_down_of_a_closing_link_short(bench: Bench) -> None:
    async with armed(bench) as link:
        link.send(command())
        closing = asyncio.create_task(link.close())
        await asyncio.sleep(0.35)
        killed = asyncio.create_task(link.kill())
        await asyncio.sleep(0.02)
        bench.vehicle.acts.clear()
        await asyncio.gather(killed, closing)
        assert bench.vehicle.powered[-1][1] is False
        assert lifting(bench) == []
        assert link.status.state == "closed"


@in_virtual_time
async def test_commands_leave_in_the_order_of_their_poses(bench: Bench) -> None:
    async with armed(bench) as link:
        for thrust_n in (0.5, 0.75):
            assert link.send(command(thrust_n))
            await asyncio.sleep(link.period_s)
        newest = command(1.0)
        assert link.send(newest)
        await asyncio.sleep(link.period_s)
        older = msgspec.structs.replace(newest, thrust_n=1.5, pose_time_s=newest.pose_time_s - 0.02)
        assert not link.send(older)
        assert link.send(msgspec.structs.replace(newest, thrust_n=1.25)), "of the same pose"
        await asyncio.sleep(0.05)
        shares = [round(thrust, 2) for _, thrust, _ in lifting(bench)]
        assert list(dict.fromkeys(shares)) == pytest.approx([0.25, 0.38, 0.5, 0.62], abs=0.011)
        assert link.status.expired == 1


@on_either_loop
async def test_a_kill_stops_the_motors_in_the_air_and_nothing_else_leaves(bench: Bench) -> None:
    async with armed(bench) as link:
        loop, newest = asyncio.get_running_loop(), command()
        assert link.send(newest)
        await asyncio.sleep(0.055)
        begun_s = loop.time()
        await link.kill()
        off_s, on = bench.vehicle.powered[-1]
        assert not on
        # In real time machine and wire take theirs, yet less than the dead man's switch.
        assert off_s <= (newest.deadline_s if not is_virtual() else begun_s + 0.002 + bench.grain_s)
        assert not link.send(command())
        await asyncio.sleep(0.5)
        assert bench.vehicle.powered[-1] == (off_s, False)
        assert [act for act in lifting(bench) if act[0] > off_s] == []
        await link.close()


@on_either_loop
async def test_nothing_leaves_after_close(bench: Bench) -> None:
    async with armed(bench) as link:
        link.send(command())
        await asyncio.sleep(0.05)
        await link.close()
        assert link.status.state == "closed"
        await asyncio.sleep(0.02)  # what left before is on its way
        before = bench.arrived()
        for attempt in (lambda: link.send(command()), link.disarm, lambda: link.arm(command)):
            with pytest.raises(LinkMisuse):
                result = attempt()
                if asyncio.iscoroutine(result):
                    await result
        await asyncio.sleep(1.2)  # longer than anything that repeats
        assert bench.arrived() == before


@in_virtual_time
async def test_closing_while_it_arms_ends_that_and_nothing_leaves_any_more(bench: Bench) -> None:
    async with connected(bench) as link:
        arming = asyncio.create_task(link.arm(idle))
        await asyncio.sleep(0.505)
        await link.close()
        before = bench.arrived()
        with pytest.raises(Exception, match="closed"):
            await arming
        await asyncio.sleep(3.0)
        assert bench.arrived() == before


@in_virtual_time
async def test_arming_ends_where_the_pose_under_the_idle_command_goes_stale_and_no_motor_turns(
    bench: Bench,
) -> None:
    async with connected(bench) as link:
        old = idle()
        with pytest.raises(LinkError, match="the idle command had expired, as its pose is too old"):
            await link.arm(lambda: old)
        await asyncio.sleep(3.0)
        assert link.status.state == "connected"
        assert not any(on for _, on in bench.vehicle.powered)


@in_virtual_time
async def test_sending_before_connecting_or_during_arming_is_misuse(bench: Bench) -> None:
    await bench.prepare()
    link = make_link(bench.config, thrust_max_n=THRUST_MAX_N, **bench.wires)
    assert link.status.state == "closed"
    with pytest.raises(LinkMisuse):
        link.send(command())
    async with connected(bench) as link:
        arming = asyncio.create_task(link.arm(idle))
        await asyncio.sleep(0.1)
        with pytest.raises(LinkMisuse):
            link.send(command())
        with pytest.raises(LinkMisuse):
            await link.connect()
        await arming
        assert link.send(command())


@on_either_loop
async def test_nobody_at_the_other_end_is_a_lost_link(bench: Bench) -> None:
    words = await bench.prepare_nobody()
    link = make_link(bench.config, thrust_max_n=THRUST_MAX_N, **bench.wires)
    with pytest.raises(LinkLost, match=words):
        await link.connect()
    assert link.status.state == "closed"


@in_virtual_time
async def test_a_link_can_be_connected_again_after_it_was_closed(bench: Bench) -> None:
    async with connected(bench) as link:
        await link.close()
        await link.connect()
        await link.arm(idle)
        assert link.send(command())
