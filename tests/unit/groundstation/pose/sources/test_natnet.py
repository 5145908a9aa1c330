"""The NatNet source beside its contract: who is heard, what is refused, a server that restarts."""

import asyncio
import math
import struct
from typing import Any

import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.core.geometry import frames_of, so3
from groundstation.core.messages import Pose, Sentence
from groundstation.flight.preflight import explain_drops
from groundstation.pose.sources import GateConfig, GatedSource, Intake, NatNetConfig, NatNetReader, natnet_codec
from groundstation.settings import Config
from links.io import parse_address
from sim.trackers import NatNetServer, TrackedBody
from tests.loops import free_address, in_real_time, in_virtual_time


async def streaming(server: NatNetServer, seconds: float) -> None:
    loop = asyncio.get_running_loop()
    for n in range(round(seconds / 0.01)):
        await asyncio.sleep(0.01)
        server.send(n, loop.time() - 0.005, [TrackedBody("quad", (1.0, 2.0, -3.0), so3.IDENTITY, True)])


@in_virtual_time
async def test_only_the_server_is_heard() -> None:
    config = NatNetConfig(server="127.0.0.1:1510")
    server = NatNetServer(config)
    await server.open()
    source, poses = config.build(), list[Pose]()
    await source.start(poses.append)
    await streaming(server, 0.1)
    await asyncio.sleep(0.1)
    count = len(poses)
    loop = asyncio.get_running_loop()
    stranger, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=("127.0.0.9", 1510))
    (ours,) = server._clients
    body = natnet_codec.RigidBody(1, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0, 1.0))
    forged = natnet_codec.NatNetFrame(10**6, (body,), 10**12, 10**12)
    stranger.sendto(natnet_codec.encode_frame(forged, (4, 1)), ours)
    await asyncio.sleep(0.1)
    assert len(poses) == count
    assert source.status.dropped["other_address"] == 1
    await source.close()
    server.close()


SECOND = "127.0.0.7"
"""Another address of the server's machine."""


@pytest.mark.parametrize("first", ["nothing", "its name", "all but frames"])
@in_virtual_time
async def test_a_server_that_answers_from_a_second_address_is_named(first: str) -> None:
    """A server that answers nothing from the address that was asked, or only who it is, or all that it is asked."""
    config = NatNetConfig(server="127.0.0.1:1510")
    source, poses, told = config.build(), list[Pose](), list[Sentence]()
    asked: asyncio.Future[tuple[str, int]] = asyncio.get_running_loop().create_future()

    class Asked(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
            if not asked.done():
                asked.set_result(addr)

    loop = asyncio.get_running_loop()
    own, _ = await loop.create_datagram_endpoint(Asked, local_addr=("127.0.0.1", 1510))
    second, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=(SECOND, 1510))
    gated = GatedSource(source, GateConfig(), lost_s=0.25, say=told.append)
    await gated.start(poses.append)
    station = await asked
    info = natnet_codec.encode_server_info(natnet_codec.ServerInfo("Motive", (4, 1), 10**7))
    (second if first == "nothing" else own).sendto(info, station)
    body = natnet_codec.RigidBody(1, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 1.0))
    for n in range(200):
        frame = natnet_codec.NatNetFrame(n, (body,), 10**5 * n + 1, 10**5 * n + 2)
        await asyncio.sleep(0.01)
        second.sendto(natnet_codec.encode_frame(frame, (4, 1)), station)
        if first == "all but frames" and n % 10 == 0:
            own.sendto(info, station)
    advice = gated.status.advice
    assert poses == []
    assert f"replies from another address, {SECOND}" in advice
    assert f'write pose.server = "{SECOND}:1510"' in advice
    assert str(explain_drops(gated.status)) == advice
    said = [str(event) for event in told if event.id in ("pose.dropping", "pose.advice")]
    assert said.count(advice) == 1
    assert said[-1] == advice
    await gated.close()
    own.close()
    second.close()


@in_virtual_time
async def test_a_unicast_server_that_forgets_its_clients_is_told_again() -> None:
    config = NatNetConfig()
    server = NatNetServer(config)
    await server.open()
    source, poses = config.build(), list[Pose]()
    await source.start(poses.append)
    await streaming(server, 10.0)
    assert len(poses) == pytest.approx(1000, abs=3), "the keep-alive keeps it streaming"
    server.close()
    await asyncio.sleep(3.0)
    again = NatNetServer(config, (3, 0))
    await again.open()
    count = len(poses)
    await streaming(again, 4.0)
    assert len(poses) > count + 200
    assert poses[-1].position_ned == pytest.approx((1.0, 2.0, -3.0))
    await source.close()
    again.close()


@pytest.mark.real_time
@in_real_time
async def test_a_group_on_an_interface_that_is_not_ours_is_refused_in_words() -> None:
    port = parse_address(await free_address())[1]
    source = NatNetConfig(multicast=True, interface="192.0.2.1", data_port=port).build()
    with pytest.raises(OSError, match=r"NatNet poses on 192\.0\.2\.1:0 .*no interface of this machine has"):
        await source.start(lambda pose: None)
    await source.close()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"server": "motive.lab:1510"}, "server: expected a numeric IPv4 address, got 'motive.lab'"),
        ({"server": "239.1.1.1:1510"}, "server: expected no multicast address"),
        ({"interface": "eth0"}, "interface: expected a numeric IPv4 address, got 'eth0'"),
        ({"group": "192.168.1.5"}, "group: expected a multicast address, such as 239.255.42.99, got '192.168.1.5'"),
        ({"server": "127.0.0.1"}, "it has no port"),
        ({"name": ""}, "name: expected a string of 1 to 256 characters"),
        ({"world": "zup"}, "zup"),
        ({"kind": "vicon", "object": ""}, "1 to 24 bytes"),
        ({"kind": "vicon", "latency_s": math.nan}, "latency_s: expected a number >= 0"),
    ],
)
def test_a_bad_setting_is_refused_in_words(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        from_dict({"pose": {"kind": "natnet", **settings}}, Config)


@pytest.mark.parametrize(
    ("number", "reason"),
    [
        (3, None),  # an answer to a command of ours
        (100, None),  # a server that does not know it
        (7, "no_server_info"),  # a frame, which only the server's version lets us read
        (5, "no_server_info"),  # names, likewise
        (8, "unknown_message"),  # a text
        (10, "unknown_message"),  # what a client says
    ],
)
def test_messages_are_told_apart_by_natnets_numbers(number: int, reason: str | None) -> None:
    reader = NatNetReader("quad", Intake(0.0, frames_of(NatNetConfig())))
    assert not reader.read(struct.pack("<HH", number, 0), 0.0)
    assert dict(reader.status.dropped) == ({} if reason is None else {reason: 1})
