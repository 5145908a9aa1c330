"""Contract of every pose source, on both event loops, towards a simulated sender: its bench.

The vehicle flies north at 1 m/s, two metres east of the origin and one metre up, its nose to the
east: so a pose tells by its place when it was true.
"""

import asyncio
import contextlib
import itertools
import math
from collections.abc import AsyncIterator, Callable
from functools import partial
from typing import Any, get_args

import msgspec
import pytest

from groundstation.core.geometry import Alignment, so3
from groundstation.core.messages import Pose, PoseSource
from groundstation.machine import sleep_until
from groundstation.pose import PoseConfig, make_source
from groundstation.pose.sources import (
    JsonConfig,
    MavlinkPoseConfig,
    NatNetConfig,
    QualisysConfig,
    ViconConfig,
    VisionConfig,
)
from groundstation.pose.sources.natnet_codec import Version
from links.io import parse_address
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from sim.autopilots import AutopilotPeer, Px4Autopilot
from sim.trackers import NatNetServer, TrackedBody, Tracker, make_tracker
from sim.world import TrueState
from tests.airframe_double import Brick
from tests.loops import free_address, in_virtual_time, is_virtual, on_either_loop

RATE_HZ = 100.0
LATENCY_S = 0.02
EAST = so3.from_euler_zyx(0.0, 0.0, math.pi / 2.0)


class Bench:
    """The other end of one kind of source."""

    config: PoseConfig
    alignment: Alignment | None = None
    hidden = False
    begun_s = 0.0

    def __init__(self) -> None:
        self.link = MavlinkLink(MavlinkLinkConfig(), thrust_max_n=2.0)

    async def prepare(self) -> None:
        raise NotImplementedError

    async def run(self) -> None:
        """Send until cancelled."""

    async def garbage(self, data: bytes) -> bool:
        """Send what makes no sense; False where nobody can."""
        return False


class TrackerBench(Bench):
    """A tracking system: Vicon, NatNet, Qualisys, a bridge, a home-made one."""

    tracker: Tracker

    def __init__(
        self, kind: Callable[..., PoseConfig], address: str = "listen", **keys: float
    ) -> None:
        """``address`` is the key of its address, and ``keys`` are others."""
        super().__init__()
        self._kind, self._address, self._keys = kind, address, keys

    async def prepare(self) -> None:
        keys = {self._address: await free_address(), "latency_s": LATENCY_S, **self._keys}
        self.config = self._kind(**keys)
        made = make_tracker(self.config)
        assert made is not None
        self.tracker = made[1]

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        await self.tracker.open()
        self.begun_s = loop.time()
        others = [(f"other{n}", (9.0, float(n), -1.0)) for n in range(2)]
        rest = [TrackedBody(name, place, so3.IDENTITY, True) for name, place in others]
        try:
            for frame in itertools.count():
                when = self.begun_s + frame / RATE_HZ
                await sleep_until(when)
                ours = TrackedBody("quad", (when - self.begun_s, 2.0, -1.0), EAST, not self.hidden)
                loop.call_at(when + LATENCY_S, self.tracker.send, frame, when, [ours, *rest])
        finally:
            self.tracker.close()

    async def garbage(self, data: bytes) -> bool:
        listen = getattr(self.config, "listen", None)
        if listen is None:
            return False
        loop = asyncio.get_running_loop()
        sender, _ = await loop.create_datagram_endpoint(
            asyncio.DatagramProtocol, remote_addr=parse_address(listen)
        )
        sender.sendto(data)
        sender.close()
        return True


class NatNetBench(TrackerBench):
    def __init__(self, version: Version = (4, 1), *, multicast: bool = False) -> None:
        super().__init__(NatNetConfig)
        self._version, self._multicast = version, multicast

    async def prepare(self) -> None:
        server, (_, port) = await free_address(), parse_address(await free_address())
        self.config = NatNetConfig(
            server=server, data_port=port, multicast=self._multicast, network_s=0.0
        )
        self.tracker = NatNetServer(self.config, self._version)


class Cruiser(Brick):
    """Flies north at 1 m/s, whatever it is told."""

    begun_s: float | None = None

    def truth(self, time_s: float) -> TrueState:
        if self.begun_s is None:
            self.begun_s = time_s
        place = (time_s - self.begun_s, 2.0, -1.0)
        return msgspec.structs.replace(super().truth(time_s), position_ned=place, attitude=EAST)


class OdometryBench(Bench):
    async def prepare(self) -> None:
        self.config = MavlinkPoseConfig(latency_s=LATENCY_S, rate_hz=RATE_HZ)
        self.link = MavlinkLink(MavlinkLinkConfig(listen=await free_address()), thrust_max_n=2.0)

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        cruiser = Cruiser(1.0, held=True)
        self.begun_s = loop.time()
        cruiser.truth(self.begun_s)
        address = self.link.connection._config.endpoint
        peer = AutopilotPeer(Px4Autopilot(cruiser), parse_address(address), delay_s=LATENCY_S)
        await asyncio.gather(peer.run(), self.link.connect())


BENCHES: dict[str, Callable[[], Bench]] = {
    "vicon": partial(TrackerBench, ViconConfig, rate_hz=RATE_HZ),
    "natnet": NatNetBench,
    "natnet 3.0": partial(NatNetBench, (3, 0)),
    "natnet multicast": partial(NatNetBench, multicast=True),
    "qualisys": partial(TrackerBench, QualisysConfig, "server"),
    "mavlink": OdometryBench,
    "vision": partial(TrackerBench, VisionConfig),
    "json": partial(TrackerBench, JsonConfig),
}


def test_every_source_has_a_bench() -> None:
    """The mock back end of libmotioncapture has its contract in tests/e2e."""
    kinds = {config.__struct_config__.tag for config in get_args(PoseConfig)}
    assert kinds - {"libmotioncapture"} == {name.split()[0] for name in BENCHES}


@pytest.fixture(params=list(BENCHES))
def bench(request: pytest.FixtureRequest) -> Bench:
    return BENCHES[request.param]()


@contextlib.asynccontextmanager
async def listening(bench: Bench) -> AsyncIterator[tuple[PoseSource, list[Pose]]]:
    await bench.prepare()
    if bench.alignment is not None:  # of which the sender knows nothing
        bench.config = msgspec.structs.replace(bench.config, alignment=bench.alignment)
    source = make_source(bench.config, bench.link)
    poses: list[Pose] = []
    sender: asyncio.Task[Any] | None = None
    try:
        if isinstance(bench.config, MavlinkPoseConfig):  # asks as the link connects
            await source.start(poses.append)
            sender = asyncio.create_task(bench.run())
        else:
            sender = asyncio.create_task(bench.run())
            await source.start(poses.append)
        yield source, poses
    finally:
        await source.close()
        if sender is not None:
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)
        await bench.link.close()


async def grown(poses: list[Pose], count: int) -> None:
    count += len(poses)
    async with asyncio.timeout(10.0):
        while len(poses) < count:
            await asyncio.sleep(0.01)


@on_either_loop
async def test_poses_come_numbered_in_our_frames_and_true_at_their_time(bench: Bench) -> None:
    async with listening(bench) as (source, poses):
        await grown(poses, 40)
        assert [pose.id for pose in poses] == list(range(len(poses)))
        assert source.status.accepted == len(poses)
        late = poses[10:]
        apart = [pose.position_ned[0] - pose.time_s for pose in late]
        tolerance = 2e-3 if is_virtual() else 0.05  # a busy machine may delay what is real
        assert apart == pytest.approx([-bench.begun_s] * len(late), abs=tolerance)
        for pose in late:
            assert pose.position_ned[1:] == pytest.approx((2.0, -1.0), abs=1e-6)
            alike = sum(a * b for a, b in zip(pose.attitude, EAST, strict=True))
            assert abs(alike) == pytest.approx(1.0, abs=1e-6)
            assert pose.time_s <= pose.arrival_s
        pairs = list(zip(poses, late, strict=False))
        assert all(a.time_s < b.time_s and a.arrival_s <= b.arrival_s for a, b in pairs)
        status = source.status
        if is_virtual():
            # PX4 begins with 30 Hz, until it has heard what is wanted.
            least = 25.0 if isinstance(bench, OdometryBench) else 90.0
            assert least < status.rate_hz < 110.0
            assert status.latency_s == pytest.approx(LATENCY_S, abs=2e-3)
        else:  # a busy machine reads late, and then many at once
            assert 5.0 < status.rate_hz < 1000.0
            assert LATENCY_S - 0.04 < status.latency_s < LATENCY_S + 0.4
        assert status.latency_max_s >= status.latency_s - 1e-9
        assert (status.clock_steps, status.clock_restarts) == (0, 0)


@in_virtual_time
async def test_the_configs_alignment_moves_every_pose(bench: Bench) -> None:
    if isinstance(bench, OdometryBench):
        return  # the autopilot's own frame is our world
    bench.alignment = Alignment(lab_origin_m=(0.0, 5.0, 0.0), body_rotation_deg=(0.0, 0.0, 90.0))
    async with listening(bench) as (_, poses):
        await grown(poses, 3)
        for pose in poses:
            assert pose.position_ned[1:] == pytest.approx((7.0, -1.0), abs=1e-6)
            # The body looks east, to the right of the nose.
            nose = so3.to_world(pose.attitude, (1.0, 0.0, 0.0))
            assert nose == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)


@on_either_loop
async def test_nothing_is_delivered_after_close_and_closing_twice_does_no_harm(
    bench: Bench,
) -> None:
    async with listening(bench) as (source, poses):
        await grown(poses, 3)
        await source.close()
        count = len(poses)
        await asyncio.sleep(0.1)
        await source.close()
        assert len(poses) == count


@on_either_loop
async def test_a_source_that_was_closed_can_be_started_again(bench: Bench) -> None:
    async with listening(bench) as (source, poses):
        await grown(poses, 3)
        if isinstance(bench.config, MavlinkPoseConfig):
            return  # its link must be connected again: see the link's own tests
        await source.close()
        await asyncio.sleep(0.02)
        await source.start(poses.append)
        await grown(poses, 3)


@on_either_loop
async def test_garbage_is_counted_and_the_next_pose_delivered(bench: Bench) -> None:
    async with listening(bench) as (source, poses):
        await grown(poses, 3)
        if await bench.garbage(b"\xfd\x00garbage"):
            await grown(poses, 3)
            assert sum(source.status.dropped.values()) > 0


@on_either_loop
async def test_a_hidden_vehicle_gives_no_poses_and_a_reason(bench: Bench) -> None:
    if not isinstance(bench, TrackerBench):
        return
    async with listening(bench) as (source, poses):
        await grown(poses, 3)
        where = poses[-1].position_ned
        bench.hidden = True
        await asyncio.sleep(0.1)
        count = len(poses)
        await asyncio.sleep(0.2)
        if isinstance(bench.config, ViconConfig):
            return  # tells by standing still: see its own tests
        assert len(poses) == count
        if not isinstance(bench.config, VisionConfig):
            assert source.status.dropped["not_tracked"] >= 10
        bench.hidden = False
        await grown(poses, 3)
        assert poses[-1].position_ned[0] > where[0]
