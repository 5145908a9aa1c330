"""The virtual event loop: time jumps, datagrams in memory, deadlocks found."""

import asyncio
from contextvars import ContextVar, copy_context
from typing import Any

import pytest

from sim.time import VirtualTimeLoop
from sim.time.virtual_time import SimulationStuck
from tests.loops import Inbox, SuspendableLoop, in_suspendable_time


def run(work: Any) -> Any:
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(work)


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


def test_a_suspended_process_finds_its_timers_and_datagrams_due_at_once_when_it_goes_on() -> None:
    process = ContextVar("process", default=False)
    timers_s: list[float] = []
    inbox = Inbox()

    async def live() -> None:
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: inbox, local_addr=("127.0.0.1", 5000))
        for _ in range(4):
            await asyncio.sleep(1.0)
            timers_s.append(loop.time())

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, SuspendableLoop)
        context = copy_context()
        context.run(process.set, True)
        living = asyncio.create_task(live(), context=context)
        wire, _ = await loop.create_datagram_endpoint(
            asyncio.DatagramProtocol, remote_addr=("127.0.0.1", 5000)
        )
        await asyncio.sleep(1.5)
        loop.suspend(process)
        await asyncio.sleep(1.0)
        wire.sendto(b"datagram")
        await asyncio.sleep(0.25)
        assert (timers_s, inbox.got) == ([1.0], []), "it stands still, and the others go on"
        loop.resume()
        await living

    in_suspendable_time(main)()
    assert [(when_s, data) for when_s, data, _ in inbox.got] == [(2.75, b"datagram")]
    assert timers_s[1:] == [2.75, 3.75, 4.75]
