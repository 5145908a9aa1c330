"""The virtual event loop: time jumps, datagrams in memory, deadlocks found."""

import asyncio
import time
from contextvars import ContextVar, copy_context
from typing import Any, get_args

import msgspec
import pytest

from groundstation.machine import sleep_until
from groundstation.pose import PoseConfig
from links.io import parse_address
from sim.time import VirtualTimeLoop
from sim.time.virtual_time import FREE_PORTS, SimulationStuck


def run(work: Any) -> Any:
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(work)


class Inbox(asyncio.DatagramProtocol):
    def __init__(self) -> None:
        self.got: list[tuple[float, bytes, tuple[str, int]]] = []

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self.got.append((asyncio.get_running_loop().time(), data, addr))


def test_an_hour_passes_at_once() -> None:
    async def work() -> float:
        await asyncio.sleep(3600.0)
        return asyncio.get_running_loop().time()

    start = time.perf_counter()
    assert run(work()) == pytest.approx(3600.0)
    assert time.perf_counter() - start < 5.0


def test_sleepers_wake_in_the_order_of_their_instants() -> None:
    async def work() -> list[float]:
        woken: list[float] = []

        async def sleeper(when: float) -> None:
            await sleep_until(when)
            woken.append(round(asyncio.get_running_loop().time(), 9))

        await asyncio.gather(*(sleeper(w) for w in (0.3, 0.1, 0.2, 0.05)))
        return woken

    assert run(work()) == [0.05, 0.1, 0.2, 0.3]


def test_waiting_for_nothing_is_an_error_and_not_a_hang() -> None:
    with pytest.raises(SimulationStuck, match="stuck"):
        run(asyncio.Event().wait())


def test_datagrams_arrive_by_address_in_order_and_the_tap_sees_them() -> None:
    async def work() -> tuple[Inbox, list[Any]]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        seen: list[Any] = []
        loop.tap = lambda *datagram: seen.append(datagram)
        _, inbox = await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", 9))
        sender, _ = await loop.create_datagram_endpoint(Inbox, remote_addr=("127.0.0.1", 9))
        sender.sendto(b"one")
        await asyncio.sleep(0.5)
        sender.sendto(b"two")
        sender.sendto(b"lost", ("127.0.0.1", 10))
        await asyncio.sleep(0.1)
        sender.close()
        sender.sendto(b"after close")
        await asyncio.sleep(0.1)
        assert isinstance(inbox, Inbox)
        return inbox, seen

    inbox, seen = run(work())
    assert [(t, d) for t, d, _ in inbox.got] == [(0.0, b"one"), (0.5, b"two")]
    assert [d for *_, d in seen] == [b"one", b"two", b"lost"]


def test_a_connected_endpoint_hears_only_its_peer() -> None:
    async def work() -> Inbox:
        loop = asyncio.get_running_loop()
        _, inbox = await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", 5), remote_addr=("127.0.0.1", 6))
        stranger, _ = await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", 7))
        peer, _ = await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", 6))
        stranger.sendto(b"stranger", ("127.0.0.1", 5))
        peer.sendto(b"peer", ("127.0.0.1", 5))
        await asyncio.sleep(0.1)
        assert isinstance(inbox, Inbox)
        return inbox

    assert [d for _, d, _ in run(work()).got] == [b"peer"]


def test_an_address_can_be_used_once() -> None:
    async def work() -> None:
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", 5))
        await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", 5))

    with pytest.raises(OSError, match="already in use"):
        run(work())


class Line(asyncio.Protocol):
    def __init__(self) -> None:
        self.got = b""
        self.lost = 0
        self.transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.got += data

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost += 1


def test_ports_that_are_handed_out_come_round_again_and_meet_none_that_is_in_use() -> None:
    """A soak opens thousands: counted on and on, one day they were the port of the poses, and a flight was refused."""

    async def work() -> list[int]:
        loop, ports = asyncio.get_running_loop(), list[int]()
        kept, _ = await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", FREE_PORTS[1]))
        for _ in range(len(FREE_PORTS) + 2):
            transport, _ = await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", 0))
            ports.append(transport.get_extra_info("sockname")[1])
            transport.close()
        kept.close()
        return ports

    ports = run(work())
    assert ports[:2] == [FREE_PORTS[0], FREE_PORTS[2]]
    assert set(ports) == set(FREE_PORTS) - {FREE_PORTS[1]}
    assert ports[-3:] == [FREE_PORTS[0], FREE_PORTS[2], FREE_PORTS[3]]


def test_no_port_that_is_handed_out_is_one_that_poses_come_to_by_default() -> None:
    fields = [field for source in get_args(PoseConfig) for field in msgspec.structs.fields(source)]
    listens = [field.default for field in fields if field.name == "listen"]
    assert len(listens) >= 3
    assert not [listen for listen in listens if parse_address(listen)[1] in FREE_PORTS]


def test_a_host_whose_ports_are_all_in_use_says_so() -> None:
    async def work() -> None:
        loop = asyncio.get_running_loop()
        for port in FREE_PORTS:
            await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", port))
        with pytest.raises(OSError, match="in use"):
            await loop.create_datagram_endpoint(Inbox, remote_addr=("127.0.0.1", 9))

    run(work())


def test_a_stream_carries_bytes_both_ways_until_one_end_hangs_up() -> None:
    async def work() -> tuple[Line, Line, list[bytes]]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        seen: list[bytes] = []
        loop.tap = lambda *sent: seen.append(sent[3])
        served: list[Line] = []

        def serve() -> Line:
            served.append(Line())
            return served[-1]

        listener = await loop.create_server(serve, "127.0.0.1", 22223)
        transport, client = await loop.create_connection(Line, "127.0.0.1", 22223)
        transport.write(b"hello ")
        transport.write(b"there")
        (server,) = served
        assert server.transport is not None
        server.transport.write(b"hi")
        await asyncio.sleep(0.1)
        server.transport.close()
        await asyncio.sleep(0.1)
        transport.write(b"anybody?")
        listener.close()
        with pytest.raises(ConnectionRefusedError):
            await loop.create_connection(Line, "127.0.0.1", 22223)
        assert isinstance(client, Line)
        return client, server, seen

    client, server, seen = run(work())
    assert (client.got, server.got) == (b"hi", b"hello there")
    assert (client.lost, server.lost) == (1, 1)
    assert seen == [b"hello ", b"there", b"hi"]


def test_a_group_brings_a_datagram_to_each_of_its_members() -> None:
    from groundstation.pose.sources import join, send_by

    async def work() -> list[list[bytes]]:
        loop = asyncio.get_running_loop()
        inboxes = []
        for member in range(3):
            transport, inbox = await loop.create_datagram_endpoint(Inbox, local_addr=("239.1.2.3", 7), reuse_port=True)
            if member < 2:
                join(transport, "239.1.2.3", "127.0.0.1")
            inboxes.append(inbox)
        sender, _ = await loop.create_datagram_endpoint(Inbox, local_addr=("127.0.0.1", 8))
        send_by(sender, "127.0.0.1")
        sender.sendto(b"all", ("239.1.2.3", 7))
        await asyncio.sleep(0.1)
        return [[data for _, data, _ in inbox.got] for inbox in inboxes]

    assert run(work()) == [[b"all"], [b"all"], []]


def test_a_suspended_process_finds_its_timers_and_datagrams_due_at_once_when_it_goes_on() -> None:
    process = ContextVar("process", default=False)
    seen: list[tuple[str, float]] = []

    class Ear(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, addr: object) -> None:
            seen.append((data.decode(), asyncio.get_running_loop().time()))

    async def live() -> None:
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(Ear, local_addr=("127.0.0.1", 5000))
        for _ in range(4):
            await asyncio.sleep(1.0)
            seen.append(("timer", loop.time()))

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        context = copy_context()
        context.run(process.set, True)
        living = asyncio.create_task(live(), context=context)
        wire, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=("127.0.0.1", 5000))
        await asyncio.sleep(1.5)
        loop.suspend(process)
        await asyncio.sleep(1.0)
        wire.sendto(b"datagram")
        await asyncio.sleep(0.25)
        assert seen == [("timer", 1.0)], "it stands still, and the others go on"
        loop.resume()
        await living

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(main())
    assert seen[1:] == [("datagram", 2.75), ("timer", 2.75), ("timer", 3.75), ("timer", 4.75)]
