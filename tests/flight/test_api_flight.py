"""Whatever the clients of a flight do, short of a request that is obeyed, the bytes that leave stay the same."""

import asyncio
from functools import cache
from typing import Any

import pytest

from groundstation.core.messages import Snapshot
from groundstation.core.mission import State
from groundstation.flight import Flight
from groundstation.interfaces.api import Server
from groundstation.interfaces.api.server import CLIENTS_MAX
from groundstation.machine import Latest, StatusConfig
from sim.runs import Stage, fly_mission, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from tests.flight.test_missions import SHORT

API_PORT = 40000


class Sent:
    """Every datagram of the flight with its instant; the clients' own connections are left out.

    In virtual time, the order within one instant is nobody's promise, nor are the numbers of MAVLink frames by it.
    """

    def __init__(self) -> None:
        self._frames: list[tuple[float, bytes]] = []

    def __call__(self, time_s: float, source: Any, target: Any, data: bytes) -> None:
        if API_PORT in (source[1], target[1]):
            return
        mavlink = data[:1] == b"\xfd"
        self._frames.append((time_s, data[:4] + data[5 : 10 + data[1]] if mavlink else data))

    @property
    def frames(self) -> list[tuple[float, bytes]]:
        return sorted(self._frames)


class Deaf(asyncio.Protocol):
    """A client that never reads what it is sent."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None: ...


class Choked(asyncio.Transport):
    """The server's end towards a client whose socket is full."""

    def __init__(self, end: asyncio.Transport) -> None:
        super().__init__()
        self.is_closing, self.abort, self.close = end.is_closing, end.abort, end.close  # type: ignore[method-assign]  # but for one

    def get_write_buffer_size(self) -> int:
        return 1 << 30


async def served(flight: Flight, trouble: str) -> None:
    """The core API of ``flight`` on the network in memory, and its clients at their worst."""
    loop = asyncio.get_running_loop()
    await asyncio.sleep(0.0123457)  # never at the very instant of a pose or a command: it would be anybody's turn first
    latest: Latest[Snapshot] = Latest()
    server = Server(StatusConfig(path="unused", rate_hz=50.0), "mqx", latest, flight)
    await loop.create_server(server.client, "127.0.0.1", API_PORT)
    publishing = asyncio.ensure_future(server.publish())
    clients: list[Deaf] = []
    number = 0
    while True:
        latest.put(flight.snapshot())
        for _ in range(3):
            _, client = await loop.create_connection(Deaf, "127.0.0.1", API_PORT)
            clients.append(client)
        for client in clients:
            number += 1
            if trouble == "flood and garbage" and number % 2:
                client.transport.write(b'{"id": %d, "control": "take"}\n' % number)
                client.transport.write(b'{"id": %d, "ask": "hold"}\n' % number * 50)  # replayed
            elif trouble == "flood and garbage":
                client.transport.write(b"\x00\xff{" * 100 + b"\n" + b"x" * 70_000)
            elif trouble == "land" and flight.state is State.TRACKING:
                client.transport.write(b'{"id": %d, "ask": "land"}\n' % number)
        if trouble == "full sockets":
            for end in list(server._clients):
                end.transport = Choked(end.transport)
        for client in clients[: len(clients) - CLIENTS_MAX // 2]:  # the oldest die
            client.transport.abort()
        del clients[: len(clients) - CLIENTS_MAX // 2]
        if flight.state in (State.LANDED, State.ABORTED):
            publishing.cancel()
            return
        await asyncio.sleep(0.0200917)


@cache
def left(trouble: str) -> list[tuple[float, bytes]]:
    sent = Sent()
    begun = VirtualTimeLoop.__init__

    def tapped(loop: VirtualTimeLoop) -> None:
        begun(loop)
        loop.tap = sent

    async def script(flight: Flight, _: Stage) -> None:
        if trouble:
            await served(flight, trouble)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(VirtualTimeLoop, "__init__", tapped)
        world, config = from_floor(*prepare(SCENARIOS["adverse"], list(SHORT)), 2.0)
        flown = fly_mission(world, config, seed=4, script=script)
    assert flown.landed, flown.why
    assert len(sent.frames) > 500
    return sent.frames


def test_clients_that_die_flood_talk_nonsense_or_never_read_change_no_byte_that_leaves() -> None:
    alone = left("")
    for trouble in ("flood and garbage", "full sockets"):
        assert left(trouble) == alone, trouble


def test_a_request_that_is_obeyed_does_change_what_leaves() -> None:
    assert left("land") != left("")
