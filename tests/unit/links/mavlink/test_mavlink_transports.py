"""The same troubles on every transport, in real time: no exception escapes, the status tells, the link recovers."""

import asyncio
import gc
import os
import random
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any, Protocol

import pytest

import links.mavlink.connection
from links.core import Command
from links.io import parse_address
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.mavlink.protocol import MavlinkCodec
from tests.loops import free_address, in_real_time, until
from tests.unit.links.mavlink.test_mavlink_wires import Answering, SerialEnd, TcpEnd

pytestmark = pytest.mark.real_time

FOREIGN = MavlinkCodec(7, 1)
SILENCE_S = 1.5
ARMED = 128
"""The vehicle's own heartbeat that tells of no arming would stop the commands."""


class End(Protocol):
    """The autopilot's end of one transport; it can go away and come back under the same name."""

    codec: MavlinkCodec
    heard: list[str]
    options: dict[str, Any]

    async def start(self) -> Any: ...

    def put(self, data: bytes) -> None: ...

    def lose(self) -> None: ...

    def beat(self) -> bytes: ...


class Udp(Answering, asyncio.DatagramProtocol):
    """Sends to us first (``listen``), or waits for us (``remote``)."""

    def __init__(self, way: str) -> None:
        super().__init__()
        self.way = way
        self.options: dict[str, Any] = {}
        self.target: Any = None

    async def start(self) -> None:
        address = self.options.setdefault(self.way, await free_address())
        first, loop = self.way == "listen", asyncio.get_running_loop()
        self.target = parse_address(address) if first else None
        local = ("127.0.0.1", 0) if first else parse_address(address)
        self.transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=local)
        self.beating = asyncio.create_task(self._beating())

    async def _beating(self) -> None:
        while True:
            self.put(self.beat())
            await asyncio.sleep(0.1)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.target = addr
        if answers := self.answers(data):
            self.put(answers)

    def put(self, data: bytes) -> None:
        for at in range(0, len(data), 1400):
            if self.target is not None:
                self.transport.sendto(data[at : at + 1400], self.target)

    def lose(self) -> None:
        self.beating.cancel()
        self.transport.abort()


class Tcp(TcpEnd):
    def __init__(self) -> None:
        super().__init__()
        self.options: dict[str, Any] = {}

    async def start(self, address: str = "") -> "Tcp":
        await super().start(self.options.setdefault("tcp", await free_address()))
        return self

    def put(self, data: bytes) -> None:
        for writer in self.writers:
            writer.write(data)

    def lose(self) -> None:
        self.server.close()
        self.drop()


class Serial(SerialEnd):
    def __init__(self, folder: Path) -> None:
        super().__init__(folder / "ttyACM0")
        self.options: dict[str, Any] = {"serial": str(self.name)}

    async def start(self) -> None:
        self.plug()

    def put(self, data: bytes) -> None:
        os.write(self.fd, data)

    def lose(self) -> None:
        self.unplug()


ENDS: dict[str, Callable[[Path], End]] = {
    "listen": lambda _: Udp("listen"),
    "remote": lambda _: Udp("remote"),
    "tcp": lambda _: Tcp(),
    "serial": Serial,
}


@pytest.fixture(params=ENDS)
def end(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[End]:
    monkeypatch.setattr(links.mavlink.connection, "FIRST_PAUSE_S", 0.05)
    monkeypatch.setattr("links.mavlink.protocol.procedures.STREAM_S", 0.1)
    yield ENDS[request.param](tmp_path)


def command() -> Command:
    """Good for longer than a busy machine keeps this program waiting."""
    now = asyncio.get_running_loop().time()
    return Command(1.0, (0.0, 0.0, 0.0), 1, now, now + 1.0)


def play(main: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run ``main`` in real time; an exception that escaped to the event loop fails the test."""

    async def watched() -> None:
        escaped: list[dict[str, Any]] = []
        asyncio.get_running_loop().set_exception_handler(lambda _, context: escaped.append(context))
        await main()
        gc.collect()  # a task that nobody awaited tells now
        assert escaped == []

    in_real_time(watched)()


def troubles(codec: MavlinkCodec, seed: int) -> Iterator[bytes]:
    """What noise, wrong baud rates, collisions and strangers put on a wire; what is whole of it, says what is true."""
    luck = random.Random(seed)
    beat = codec.dialect.MAVLink_heartbeat_message(2, 12, ARMED, 0, 3, 3)
    for _ in range(60):
        whole = codec.pack(beat)
        cut = luck.randrange(1, len(whole))
        flipped = bytearray(whole)
        flipped[luck.randrange(len(whole))] ^= 1 << luck.randrange(8)
        yield luck.choice(
            [
                luck.randbytes(luck.randrange(1, 400)),
                whole[:cut],
                whole[cut:],
                bytes(flipped),
                b"\xfd" * luck.randrange(1, 300),
                b"\xfe" + luck.randbytes(7),
                b"\xfd\xff\x00\x00" + luck.randbytes(30),
                FOREIGN.pack(beat),
                FOREIGN.pack(beat)[:-1] + whole,
            ]
        )


@pytest.mark.parametrize("seed", range(2))
def test_garbage_and_half_frames_are_counted_and_commands_go_on(end: End, seed: int) -> None:
    async def main() -> None:
        await end.start()
        link = MavlinkLink(MavlinkLinkConfig(**end.options, quiet=False), thrust_max_n=2.0)
        await link.connect()
        await link.arm(command)
        received = link.status.received
        for trouble in troubles(MavlinkCodec(1, 1), seed):
            end.put(trouble)
            link.send(command())
            await asyncio.sleep(0.004)
        end.put(bytes(300))  # the end of whatever a false start has promised
        end.heard.clear()
        await until(lambda: link.send(command()) and link.status.received > received + 5)
        assert sum(link.status.dropped.values()) > 20
        assert link.status.state == "armed"
        assert link.send(command())
        await until(lambda: "SET_ATTITUDE_TARGET" in end.heard)
        await link.kill()
        await link.close()
        end.lose()
        await asyncio.sleep(0.02)

    play(main)


def test_a_link_that_is_closed_while_its_wire_is_away_opens_nothing_any_more(end: End) -> None:
    async def main() -> None:
        await end.start()
        config = MavlinkLinkConfig(**end.options, quiet=False, heartbeat_timeout_s=SILENCE_S)
        link = MavlinkLink(config, thrust_max_n=2.0)
        await link.connect()
        end.lose()
        await until(lambda: link.status.state == "lost")
        await link.close()
        end.heard.clear()
        await end.start()
        await asyncio.sleep(0.2)
        assert (link.status.state, end.heard) == ("closed", [])
        end.lose()
        await asyncio.sleep(0.02)

    play(main)
