"""groundstation/flight/assembly.py: what is seen of wires, and whose."""

import asyncio
from typing import Any

from groundstation.flight import WireTaps
from groundstation.recording import ReceivedRecord, Record, SentRecord
from groundstation.recording.records import WireRecord
from groundstation.recording.writer import TlogCutter
from links.io import NETWORK, parse_address
from tests.loops import free_address, in_real_time, until
from tests.mavlink_table import FRAMES


class Echo(asyncio.DatagramProtocol):
    """Answers what it gets in capitals, past the transport where there is a socket."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport.get_extra_info("sockname", ()), tuple)
        self.transport: Any = transport

    def datagram_received(self, data: bytes, addr: object) -> None:
        self.heard.append(data)
        shared = self.transport.get_extra_info("socket")
        sender = self.transport if shared is None else shared.dup()
        sender.sendto(data.upper(), addr)
        if sender is not self.transport:
            sender.close()


@in_real_time
async def test_a_real_datagram_is_seen_both_ways_and_only_ours() -> None:
    records: list[Record] = []
    address = parse_address(await free_address())

    async def open_ours() -> Echo:
        NETWORK.set(WireTaps(records.append))
        _, echo = await NETWORK.get().open_datagram(Echo, address)
        return echo

    echo = await asyncio.create_task(open_ours())
    loop = asyncio.get_running_loop()
    somebody, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=address)
    somebody.sendto(b"hello")
    await until(lambda: len(records) >= 3)
    somebody.close()
    echo.transport.close()
    assert echo.heard[0] == b"hello"
    opened, received, sent = records[:3]
    assert (
        isinstance(opened, WireRecord)
        and isinstance(received, ReceivedRecord)
        and isinstance(sent, SentRecord)
    )
    assert (opened.wire, opened.kind, opened.local, opened.remote) == (0, "udp", address, None)
    assert (received.wire, received.data) == (0, b"hello")
    assert (sent.wire, sent.data, sent.peer) == (0, b"HELLO", received.peer)
    assert sum(isinstance(record, WireRecord) for record in records) == 1, "nobody else's wire"


@in_real_time
async def test_turns_tell_arrivals_apart_between_which_a_task_may_have_run() -> None:
    records: list[Record] = []
    wires = WireTaps(records.append)
    wires.note_received(0, b"a", None)
    wires.note_received(0, b"b", None)
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    wires.note_received(0, b"c", None)
    turns = [record.turn for record in records if isinstance(record, ReceivedRecord)]
    assert turns[0] == turns[1] < turns[2]


def test_a_stream_is_cut_into_the_frames_of_a_tlog_wherever_its_bytes_were_cut() -> None:
    frames = [golden.frame for golden in FRAMES]
    stream = b"\x00" + b"".join(frames)
    whole = TlogCutter().records(stream, 1_000_000)
    bytewise = TlogCutter()
    assert b"".join(bytewise.records(bytes([byte]), 1_000_000) for byte in stream) == whole
    assert whole == b"".join((1000).to_bytes(8, "big") + frame for frame in frames)


def test_a_datagram_whose_rest_never_comes_leaves_nothing_for_the_next() -> None:
    frame, peer = FRAMES[0].frame, ("192.168.1.7", 14550)
    cutter = TlogCutter()
    assert cutter.records(frame[:-3], 0, peer) == b""
    assert cutter.records(frame, 0, peer) == bytes(8) + frame


def test_frames_that_two_senders_cut_over_datagrams_stand_whole_in_a_tlog() -> None:
    first, second = FRAMES[0].frame, FRAMES[1].frame
    cutter = TlogCutter()
    found = b""
    for n in range(0, max(len(first), len(second)), 16):
        found += cutter.records(first[n : n + 16], 0, ("192.168.1.7", 14550))
        found += cutter.records(second[n : n + 16], 0, ("192.168.1.8", 14550))
    assert sorted(found.split(bytes(8) + b"\xfd")) == sorted([b"", first[1:], second[1:]])
