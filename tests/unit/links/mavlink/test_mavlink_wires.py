"""MAVLink over each transport, in real time: losses are repaired, nothing stale leaves."""

import asyncio
import gc
import os
import random
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest

import links.mavlink.transport
from links.core import Command, LinkLost
from links.io import open_port, parse_address
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.mavlink.protocol import MavCommand, MavlinkCodec
from sim.autopilots.peer import open_far_end, open_tcp, open_udp
from sim.radio import PtyWire
from tests.loops import free_address, in_real_time, until
from tests.unit.links.mavlink.test_mavlink_link import Endpoint, accept

pytestmark = pytest.mark.real_time

FOREIGN = MavlinkCodec(7, 1)
SILENCE_S = 1.5
ARMED = 128
"""The vehicle's own heartbeat that tells of no arming would stop the commands."""


class End(Endpoint):
    """The autopilot's end of one transport; it accepts all, goes away, and comes back."""

    beat_s = 0.1

    def __init__(self, way: str, folder: Path) -> None:
        super().__init__()
        self.answer = self.obey
        self.way, self.port = way, folder / "ttyACM0"
        self.options: dict[str, Any] = {"serial": str(self.port)} if way == "serial" else {}
        """Keys of a link that reaches it."""
        self.wire: Any = None

    async def start(self) -> None:
        if self.way == "serial":
            self.wire = await open_far_end(self.datagram_received, port=PtyWire(self.port))
        else:
            address = parse_address(self.options.setdefault(self.way, await free_address()))
            if self.way == "tcp":
                self.wire = await open_tcp(self.datagram_received, address=address)
            else:
                key = "remote" if self.way == "listen" else "local"
                self.wire = await open_udp(self.datagram_received, **{key: address})
        self.beats = asyncio.create_task(self.beating())

    def put(self, data: bytes) -> None:
        for at in range(0, len(data), 1400):
            self.wire.sendto(data[at : at + 1400])

    def say(self, *messages: Any) -> None:
        for message in messages:
            self.put(self.codec.pack(message))

    def lose(self) -> None:
        self.beats.cancel()
        if self.way == "serial":
            self.wire.close()
        else:
            self.wire.abort()

    def obey(self, message: Any) -> list[Any]:
        self.armed = self.armed or getattr(message, "command", None) == MavCommand.ARM_DISARM
        return accept(message)


@pytest.fixture(params=["listen", "remote", "tcp", "serial"])
def end(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[End]:
    monkeypatch.setattr(links.mavlink.transport, "REOPEN_S", 0.05)
    monkeypatch.setattr("links.mavlink.protocol.procedures.STREAM_S", 0.1)
    yield End(request.param, tmp_path)


def of_kind(*kinds: str) -> pytest.MarkDecorator:
    """Have a test try only ends of these kinds."""
    return pytest.mark.parametrize("end", kinds, indirect=True)


def link_to(end: End, **options: Any) -> MavlinkLink:
    return MavlinkLink(MavlinkLinkConfig(**end.options, quiet=False, **options), thrust_max_n=2.0)


def command() -> Command:
    """Good for longer than a busy machine keeps this program waiting."""
    now = asyncio.get_running_loop().time()
    return Command(1.0, (0.0, 0.0, 0.0), 1, now, now + 1.0)


@of_kind("tcp", "serial")
@in_real_time
async def test_a_stream_that_is_closed_or_unplugged_is_opened_again_and_waits_for_a_new_arming(
    end: End,
) -> None:
    await end.start()
    link = link_to(end)
    await link.connect()
    await link.arm(command)
    assert link.send(command())
    await until(lambda: end.of("SET_ATTITUDE_TARGET"))
    end.lose()
    await until(lambda: link.status.state == "lost")
    assert "the link is lost: " in link.status.text
    assert "trying again every 0.05 s" in link.status.text
    sent, expired = link.status.sent, link.status.expired
    link.send(command())
    await end.start()
    await until(lambda: link.status.state in ("connected", "armed"))
    await until(lambda: "arm anew" in link.status.text)
    end.heard.clear()
    for _ in range(10):
        link.send(command())
        await asyncio.sleep(0.01)
    assert end.of("SET_ATTITUDE_TARGET") == []
    assert link.status.sent == sent
    assert link.status.phase == "over"
    assert link.status.expired == expired + 11
    await link.arm(command)
    assert link.send(command())
    await until(lambda: end.of("SET_ATTITUDE_TARGET"))
    assert "lost" not in link.status.text
    await link.close()
    end.lose()


@pytest.mark.parametrize("path", ["/dev/null", "nowhere/ttyACM0"])
@in_real_time
async def test_what_is_no_serial_port_is_told_of(path: str) -> None:
    link = MavlinkLink(MavlinkLinkConfig(serial=path), thrust_max_n=2.0)
    with pytest.raises(LinkLost, match=f"cannot open {path} for MAVLink .*check that it is there"):
        await link.connect()
    assert link.status.state == "closed"


@of_kind("serial")
@in_real_time
async def test_a_port_that_another_program_has_is_told_of(end: End) -> None:
    await end.start()
    held = open_port(end.options["serial"], 57600)
    link = link_to(end)
    with pytest.raises(LinkLost, match=r"another program|busy"):
        await link.connect()
    os.close(held)
    end.lose()


@of_kind("tcp", "serial")
@in_real_time
async def test_a_stream_that_takes_nothing_is_reset_and_what_waits_in_it_never_arrives(
    end: End,
) -> None:
    await end.start()
    link = link_to(end)
    await link.connect()
    await link.arm(command)
    if end.way == "serial":  # nobody takes what we send
        asyncio.get_running_loop().remove_reader(end.wire.fileno())
        burst, says = 50, "the port takes nothing any more"
    else:
        end.wire.server.close()
        end.wire._transport.pause_reading()
        burst, says = 2000, "acknowledges nothing"  # until the buffers on both sides are full
    async with asyncio.timeout(60.0):
        while link.status.state == "armed":
            for _ in range(burst):
                link.send(command())
            await asyncio.sleep(0.01)
    assert link.status.dropped["full"] > 50
    assert link.status.phase == "over"
    assert says in link.status.text
    await link.close()
    end.lose()


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
    """Yield bytes of noise, wrong baud rates, collisions and strangers; whole frames are true."""
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
        link = link_to(end)
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
        await until(lambda: end.of("SET_ATTITUDE_TARGET"))
        await link.kill()
        await link.close()
        end.lose()
        await asyncio.sleep(0.02)

    play(main)


def test_a_link_that_is_closed_while_its_wire_is_away_opens_nothing_any_more(end: End) -> None:
    async def main() -> None:
        await end.start()
        link = link_to(end, heartbeat_timeout_s=SILENCE_S)
        await link.connect()
        end.lose()
        await until(lambda: link.status.state == "lost")
        await link.close()
        end.heard.clear()
        await end.start()
        await asyncio.sleep(0.2)
        assert (link.status.state, link.connection._wires.wire, end.heard) == ("closed", None, [])
        end.lose()
        await asyncio.sleep(0.02)

    play(main)
