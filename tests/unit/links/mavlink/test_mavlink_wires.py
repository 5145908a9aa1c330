"""MAVLink over TCP and a serial port, in real time: what is lost is opened again, and nothing stale ever leaves."""

import asyncio
import contextlib
import os
import pty
import tty
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from links.core import Command, LinkLost
from links.io import open_port
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.mavlink.protocol import PX4, MavlinkCodec
from tests.loops import free_address, in_real_time, until

pytestmark = pytest.mark.real_time

D = MavlinkCodec(1, 1).dialect


class Answering:
    """An autopilot at the other end of a stream: accepts everything, sends its heartbeat ten times a second."""

    def __init__(self) -> None:
        self.codec = MavlinkCodec(1, 1)
        self.heard: list[str] = []
        self.armed = False

    def answers(self, data: bytes) -> bytes:
        out = b""
        for message in self.codec.feed(data):
            self.heard.append(message.get_type())
            if message.get_type() == "COMMAND_LONG":
                self.armed = self.armed or message.command == 400
                out += self.codec.pack(D.MAVLink_command_ack_message(message.command, 0, 0, 0, 245, 190))
        return out

    def beat(self) -> bytes:
        return self.codec.pack(D.MAVLink_heartbeat_message(2, PX4, 128 if self.armed else 0, 0, 3, 3))


class TcpEnd(Answering):
    """A TCP server with one client."""

    async def start(self, address: str) -> "TcpEnd":
        host, _, port = address.partition(":")
        self.writers: list[asyncio.StreamWriter] = []
        self.server = await asyncio.start_server(self._serve, host, int(port))
        return self

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writers.append(writer)
        beating = asyncio.create_task(self._beating(writer))
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(4096):
                writer.write(self.answers(data))
        beating.cancel()
        writer.close()

    async def _beating(self, writer: asyncio.StreamWriter) -> None:
        while True:
            writer.write(self.beat())
            await asyncio.sleep(0.1)

    def drop(self) -> None:
        for writer in self.writers:
            writer.transport.abort()
        self.writers.clear()

    async def stop(self) -> None:
        self.server.close()
        self.drop()
        await asyncio.sleep(0.01)


class SerialEnd(Answering):
    """The other end of a port that can be pulled out and plugged in again under the same name."""

    def __init__(self, name: Path) -> None:
        super().__init__()
        self.name = name
        self.fd = -1

    def plug(self) -> "SerialEnd":
        self.fd, theirs = pty.openpty()
        tty.setraw(self.fd)
        os.set_blocking(self.fd, False)
        self.theirs = theirs
        self.name.unlink(missing_ok=True)
        self.name.symlink_to(os.ttyname(theirs))
        loop = asyncio.get_running_loop()
        loop.add_reader(self.fd, self._read)
        self.beating = asyncio.create_task(self._beating())
        return self

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            os.write(self.fd, self.answers(os.read(self.fd, 4096)))

    async def _beating(self) -> None:
        while True:
            os.write(self.fd, self.beat())
            await asyncio.sleep(0.1)

    def unplug(self) -> None:
        if self.fd >= 0:
            self.beating.cancel()
            asyncio.get_running_loop().remove_reader(self.fd)
            self.name.unlink(missing_ok=True)
            os.close(self.theirs)
            os.close(self.fd)
            self.fd = -1


def command() -> Command:
    now = asyncio.get_running_loop().time()
    return Command(1.0, (0.0, 0.0, 0.0), 1, now, now + 0.9)


async def lost_and_found(link: MavlinkLink, end: Answering, lose: Callable[[], Any], find: Callable[[], Any]) -> None:
    """Fly, lose the wire, find it again, and see that nothing lifts until the next arming."""
    await link.connect()
    await link.arm(command)
    assert link.send(command())
    await until(lambda: "SET_ATTITUDE_TARGET" in end.heard)
    lose()
    await until(lambda: link.status.state == "lost")
    assert "the link is lost: " in link.status.text
    assert "trying again in" in link.status.text
    sent, expired = link.status.sent, link.status.expired
    link.send(command())
    result = find()
    if isinstance(result, Awaitable):
        await result
    await until(lambda: link.status.state in ("connected", "armed"))
    await until(lambda: "arm anew" in link.status.text)
    end.heard.clear()
    for _ in range(10):
        link.send(command())
        await asyncio.sleep(0.01)
    assert "SET_ATTITUDE_TARGET" not in end.heard
    assert link.status.sent == sent
    assert link.status.phase == "over"
    assert link.status.expired == expired + 11
    await link.arm(command)
    assert link.send(command())
    await until(lambda: "SET_ATTITUDE_TARGET" in end.heard)
    assert "lost" not in link.status.text


@in_real_time
async def test_a_tcp_connection_that_is_closed_is_opened_again_and_waits_for_a_new_arming() -> None:
    address = await free_address()
    end = await TcpEnd().start(address)
    link = MavlinkLink(MavlinkLinkConfig(tcp=address, quiet=False), thrust_max_n=2.0)

    def lose() -> None:
        end.server.close()
        end.drop()

    await lost_and_found(link, end, lose, lambda: end.start(address))
    await link.close()
    await end.stop()


@in_real_time
async def test_a_serial_port_that_is_unplugged_is_opened_again_and_waits_for_a_new_arming(tmp_path: Path) -> None:
    end = SerialEnd(tmp_path / "ttyACM0").plug()
    link = MavlinkLink(MavlinkLinkConfig(serial=str(end.name), quiet=False), thrust_max_n=2.0)
    await lost_and_found(link, end, end.unplug, end.plug)
    await link.close()
    end.unplug()


@pytest.mark.parametrize("path", ["/dev/null", "nowhere/ttyACM0"])
@in_real_time
async def test_what_is_no_serial_port_is_told_of(path: str) -> None:
    link = MavlinkLink(MavlinkLinkConfig(serial=path), thrust_max_n=2.0)
    with pytest.raises(LinkLost, match=f"cannot open {path} for MAVLink .*check that it is there"):
        await link.connect()
    assert link.status.state == "closed"


@in_real_time
async def test_a_port_that_another_program_has_is_told_of(tmp_path: Path) -> None:
    end = SerialEnd(tmp_path / "ttyACM0").plug()
    held = open_port(str(end.name), 57600)
    link = MavlinkLink(MavlinkLinkConfig(serial=str(end.name)), thrust_max_n=2.0)
    with pytest.raises(LinkLost, match=r"another program|busy"):
        await link.connect()
    os.close(held)
    end.unplug()


@in_real_time
async def test_a_port_that_takes_nothing_drops_frames_and_throws_away_what_waits_in_it(tmp_path: Path) -> None:
    end = SerialEnd(tmp_path / "ttyACM0").plug()
    link = MavlinkLink(MavlinkLinkConfig(serial=str(end.name), quiet=False), thrust_max_n=2.0)
    await link.connect()
    await link.arm(command)
    asyncio.get_running_loop().remove_reader(end.fd)  # nobody takes what we send
    async with asyncio.timeout(60.0):
        while link.status.state == "armed":
            for _ in range(50):
                link.send(command())
            await asyncio.sleep(0.02)
    assert link.status.dropped["full"] > 50
    assert link.status.phase == "over"
    assert "the port takes nothing any more" in link.status.text
    await link.close()
    end.unplug()


@in_real_time
async def test_a_tcp_connection_that_stalls_is_reset_and_what_waits_in_it_never_arrives() -> None:
    address = await free_address()
    end = await TcpEnd().start(address)
    link = MavlinkLink(MavlinkLinkConfig(tcp=address, quiet=False), thrust_max_n=2.0)
    await link.connect()
    await link.arm(command)
    end.server.close()
    for writer in end.writers:
        writer.transport.pause_reading()  # type: ignore[attr-defined]  # a socket's transport has it
    left = 0
    async with asyncio.timeout(60.0):
        while link.status.state == "armed":
            for _ in range(2000):  # until the buffers on both sides are full
                link.send(command())
            left += 1
            await asyncio.sleep(0.01)
    assert "acknowledges nothing" in link.status.text
    assert link.status.dropped["full"] > 0
    await link.close()
    await end.stop()
