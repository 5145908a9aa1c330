"""The Vicon source on a real UDP socket. The loop's clock can jump, so that a silent second costs none."""

import asyncio
import math
import os
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from functools import wraps
from typing import Any, ParamSpec

import msgspec
import pytest

from groundstation.core.messages import Pose
from groundstation.pose.sources import ViconConfig
from groundstation.pose.sources.vicon_codec import ViconObject, encode
from tests.loops import until
from tests.vicon_table import OURS

P = ParamSpec("P")


class JumpingLoop(asyncio.SelectorEventLoop):
    """A real loop whose clock can be put forward."""

    ahead_s = 0.0

    def time(self) -> float:
        return super().time() + self.ahead_s


def on_jumping_clock(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """Make a test of a coroutine function, which runs on such a loop."""

    @wraps(test)
    def run(*args: P.args, **options: P.kwargs) -> None:
        with asyncio.Runner(loop_factory=JumpingLoop) as runner:
            runner.run(test(*args, **options))

    return run


def jump(seconds: float) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, JumpingLoop)
    loop.ahead_s += seconds


async def free_port() -> int:
    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
        asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0)
    )
    port: int = transport.get_extra_info("sockname")[1]
    transport.abort()
    await asyncio.sleep(0)
    return port


class Bench:
    """A source that listens, and a sender beside it."""

    def __init__(self, config: ViconConfig, send: Callable[[bytes], None], poses: asyncio.Queue[Pose]) -> None:
        self.config = config
        self.source = config.build()
        self.send = send
        self._poses = poses

    async def next_pose(self) -> Pose:
        return await asyncio.wait_for(self._poses.get(), 5.0)

    async def dropped(self, count: int) -> dict[str, int]:
        """What was dropped, once ``count`` datagrams were."""
        await until(lambda: sum(self.source.status.dropped.values()) >= count)
        return self.source.status.dropped


@asynccontextmanager
async def listening(**settings: Any) -> AsyncIterator[Bench]:
    port = await free_port()
    config = ViconConfig(object=OURS, listen=f"127.0.0.1:{port}", **settings)
    poses: asyncio.Queue[Pose] = asyncio.Queue()
    sender, _ = await asyncio.get_running_loop().create_datagram_endpoint(
        asyncio.DatagramProtocol, remote_addr=("127.0.0.1", port)
    )
    bench = Bench(config, sender.sendto, poses)
    await bench.source.start(poses.put_nowait)
    try:
        yield bench
    finally:
        sender.close()
        await bench.source.close()


def frame(number: int, north_mm: float = 0.0) -> bytes:
    return encode(number, [ViconObject(OURS, (north_mm, -2000.0, 1000.0), (0.0, 0.0, -math.pi / 2.0))])


@on_jumping_clock
async def test_each_frame_counts_once_and_never_backwards() -> None:
    async with listening() as bench:
        for number, north_mm in ((10, 0.0), (11, 1.0), (11, 1.0), (10, 0.0), (13, 3.0), (12, 2.0), (14, 4.0)):
            bench.send(frame(number, north_mm))
        poses = [await bench.next_pose() for _ in range(4)]
        assert [pose.position_ned[0] for pose in poses] == [0.0, 0.001, 0.003, 0.004]
        assert [pose.id for pose in poses] == [0, 1, 2, 3]
        assert bench.source.status.dropped == {"duplicate": 1, "out_of_order": 2}


@on_jumping_clock
async def test_of_two_trackers_at_once_only_the_one_ahead_is_heard() -> None:
    async with listening() as bench:
        for i in range(10):
            bench.send(frame(5_000 + i, float(i)))
            bench.send(frame(100 + i, 9_000.0 + i))
            jump(0.5)
            assert (await bench.next_pose()).position_ned[0] == i / 1000.0
        assert await bench.dropped(10) == {"out_of_order": 10}


@on_jumping_clock
async def test_a_pose_that_stands_still_to_the_last_bit_is_not_a_measurement() -> None:
    async with listening() as bench:
        for number in (1, 2, 3):
            bench.send(frame(number, 1.0))
        bench.send(frame(4, math.nextafter(1.0, 2.0)))
        await bench.next_pose()
        assert (await bench.next_pose()).id == 1
        assert bench.source.status.dropped == {"frozen": 2}


@on_jumping_clock
async def test_a_port_in_use_is_named_with_what_to_do() -> None:
    async with listening() as bench:
        with pytest.raises(OSError, match=r"cannot listen for Vicon poses on 127\.0\.0\.1:") as refused:
            second = bench.config.build()
            await second.start(lambda pose: None)
        assert f"(process {os.getpid()}) holds this port: end it" in str(refused.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"listen": "127.0.0.1"}, "it has no port"),
        ({"object": ""}, "1 to 24 bytes"),
        ({"world": "yup"}, "yup"),
        ({"latency_s": -0.1}, ">= 0.0"),
        ({"latency_s": math.nan}, ">= 0.0"),
        ({"latency": 0.1}, "unknown field `latency`"),
    ],
)
def test_a_bad_setting_is_refused_in_words(settings: dict[str, object], words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert({"kind": "vicon", "object": OURS, **settings}, ViconConfig)
