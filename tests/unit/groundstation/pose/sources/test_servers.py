"""NatNet and Qualisys beside their contract: strangers, refusals, servers that restart or break."""

import asyncio
import struct
from collections.abc import Callable
from typing import Any

import pytest

from groundstation.core.geometry import frames_of, so3
from groundstation.core.messages import Pose, Sentence
from groundstation.flight.preflight import explain_drops
from groundstation.pose.sources import (
    GateConfig,
    GatedSource,
    Intake,
    NatNetConfig,
    NatNetReader,
    QualisysConfig,
    natnet_codec,
    qualisys_codec as qtm,
)
from groundstation.pose.sources.qualisys import QualisysSource
from links.io import parse_address
from sim.trackers import NatNetServer, QtmServer, TrackedBody
from sim.trackers.trackers import QtmClient
from tests.loops import BOTH_LOOPS, Run, free_address, in_real_time, in_virtual_time, until


async def streaming(server: NatNetServer, seconds: float) -> None:
    loop = asyncio.get_running_loop()
    body = TrackedBody("quad", (1.0, 2.0, -3.0), so3.IDENTITY, True)
    for n in range(round(seconds / 0.01)):
        await asyncio.sleep(0.01)
        server.send(n, loop.time() - 0.005, [body])


async def open_end(host: str, kind: Callable[[], Any] = asyncio.DatagramProtocol) -> Any:
    """A datagram socket of our own at a server's port."""
    loop = asyncio.get_running_loop()
    end, _ = await loop.create_datagram_endpoint(kind, local_addr=(host, 1510))
    return end


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
    stranger = await open_end("127.0.0.9")
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
    """``first`` is what a server answers from the address that was asked."""
    config = NatNetConfig(server="127.0.0.1:1510")
    source, poses, told = config.build(), list[Pose](), list[Sentence]()
    asked: asyncio.Future[tuple[str, int]] = asyncio.get_running_loop().create_future()

    class Asked(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
            if not asked.done():
                asked.set_result(addr)

    own, second = await open_end("127.0.0.1", Asked), await open_end(SECOND)
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
    with pytest.raises(OSError, match=r"192\.0\.2\.1:0 .*no interface of this machine has"):
        await source.start(lambda pose: None)
    await source.close()


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


class Room:
    """A QTM that streams at 100 Hz, and a source that listens."""

    def __init__(self, config: QualisysConfig) -> None:
        self.server = QtmServer(config)
        self.source: QualisysSource = config.build()
        self.poses: list[Pose] = []
        self.names = ["quad"]
        self._frame = 0

    async def stream(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            places = ((name, (float(n), 0.0, -1.0)) for n, name in enumerate(self.names))
            seen = [TrackedBody(name, place, so3.IDENTITY, True) for name, place in places]
            self.server.send(self._frame, loop.time(), seen)
            self._frame += 1
            await asyncio.sleep(0.01)

    async def more(self, count: int = 3) -> Pose:
        count += len(self.poses)
        await until(lambda: len(self.poses) >= count)
        return self.poses[-1]

    def say(self, data: bytes) -> None:
        """Send bytes of our own to every client."""
        for client in self.server.clients:
            assert client._transport is not None
            client._transport.write(data)


def scene(play: Callable[[Room], Any], run: Run = in_virtual_time) -> None:
    async def main() -> None:
        room = Room(QualisysConfig(server=await free_address(), latency_s=0.0))
        await room.server.open()
        streaming = asyncio.create_task(room.stream())
        try:
            await room.source.start(room.poses.append)
            await play(room)
        finally:
            await room.source.close()
            room.server.close()
            streaming.cancel()

    run(main)()


@pytest.mark.parametrize("run", BOTH_LOOPS)
def test_a_lost_connection_is_opened_anew(run: Run) -> None:
    async def play(room: Room) -> None:
        await room.more()
        for client in tuple(room.server.clients):
            client.close()
        await asyncio.sleep(0.1)
        await room.more()
        assert room.source.status.dropped == {"connection_lost": 1}

    scene(play, run)


ENDLESS = struct.pack("<qII", 0, 0, 0xFFFFFFFF) + struct.pack("<II", 0, 5)
"""Four thousand million components of no size: qtm-rt would count them for minutes."""
BEYOND = struct.pack("<qII", 0, 0, 1) + struct.pack("<II", 1 << 20, 5)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (bytes(8), "broken_stream"),
        (b"\xff" * 8, "broken_stream"),
        (b"GET / HTTP/1.1\r\n", "broken_stream"),
        (qtm.packet(qtm.RtPacket.DATA, b"short"), "malformed"),
        (qtm.packet(qtm.RtPacket.DATA, ENDLESS), "malformed"),
        (qtm.packet(qtm.RtPacket.DATA, BEYOND), "malformed"),
    ],
)
def test_bytes_that_would_stop_qtm_rt_or_that_it_cant_read_end_the_connection_and_not_the_flight(
    data: bytes, reason: str
) -> None:
    async def play(room: Room) -> None:
        await room.more()
        room.say(qtm.text_packet(qtm.RtPacket.ERROR, "nobody asked"))
        room.say(qtm.packet(qtm.RtPacket.EVENT, b"\x63"))  # of a newer QTM: no reason to hang up
        room.say(data)
        await asyncio.sleep(0.1)
        await room.more()
        assert room.source.status.dropped == {reason: 1, "connection_lost": 1}

    scene(play)


def test_a_body_that_is_added_while_we_listen_is_asked_for() -> None:
    async def play(room: Room) -> None:
        assert (await room.more()).position_ned == (0.0, 0.0, -1.0)
        room.names = ["wand", "quad"]
        await asyncio.sleep(0.02)
        count = len(room.poses)
        pose = await room.more()
        assert pose.position_ned == (1.0, 0.0, -1.0)
        assert all(p.position_ned == (1.0, 0.0, -1.0) for p in room.poses[count + 1 :])
        dropped = room.source.status.dropped
        assert 0 < dropped["other_bodies"] < 20, "of 100 a second: it is asked at once"
        assert dropped.keys() == {"other_bodies"}
        assert room.source.other_objects == ("wand", "quad")

    scene(play)


@in_virtual_time
async def test_nobody_there_is_said_with_what_to_check() -> None:
    source = QualisysConfig(server="127.0.0.1:22223").build()
    with pytest.raises(OSError, match=r"QTM at 127\.0\.0\.1:22223 .*little-endian port"):
        await source.start(lambda pose: None)
    await source.close()


class Mute(asyncio.Protocol):
    """Takes connections and answers nothing, or only refusals."""

    def __init__(self, refusal: str = "") -> None:
        self._refusal = refusal

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        if self._refusal and isinstance(self._transport, asyncio.Transport):
            self._transport.write(qtm.text_packet(qtm.RtPacket.ERROR, self._refusal))


@pytest.mark.parametrize(
    ("refusal", "words"),
    [
        ("", "QTM did not speak version"),
        ("Version NOT supported", "no version .* from 1.25 down to 1.8: update QTM"),
    ],
)
@in_virtual_time
async def test_a_server_that_does_not_speak_as_qtm_does_is_told_of(
    refusal: str, words: str
) -> None:
    loop = asyncio.get_running_loop()
    address = await free_address()
    await loop.create_server(lambda: Mute(refusal), *parse_address(address))
    source = QualisysConfig(server=address).build()
    with pytest.raises(OSError, match=words):
        await source.start(lambda pose: None)
    await source.close()


@pytest.mark.parametrize("run", BOTH_LOOPS)
@pytest.mark.parametrize("minor", [8, 18, 22, 24])
def test_an_older_qtm_is_asked_for_older_versions_on_a_new_connection_each(
    minor: int, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.trackers.trackers.NEWEST_MINOR", minor)
    connections = 0
    begun = QtmClient.connection_made

    def count(client: QtmClient, transport: asyncio.BaseTransport) -> None:
        nonlocal connections
        connections += 1
        begun(client, transport)

    monkeypatch.setattr(QtmClient, "connection_made", count)

    async def play(room: Room) -> None:
        assert (await room.more()).position_ned == (0.0, 0.0, -1.0)
        assert connections == 1 + 25 - minor
        assert len(room.server.clients) == 1

    scene(play, run)


@in_virtual_time
async def test_without_a_measurement_the_operator_is_asked_for_one() -> None:
    config = QualisysConfig(server=await free_address())
    server = QtmServer(config)
    await server.open()
    source = config.build()
    with pytest.raises(OSError, match="did not stream: is a measurement or a preview running"):
        await source.start(lambda pose: None)
    await source.close()
    server.close()
