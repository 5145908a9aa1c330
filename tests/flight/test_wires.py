"""The simulated vehicle flown in real time over TCP and a serial port, as a stream of bytes."""

import asyncio
import contextlib
import os
import pty
import tty
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.analysis.replay import replay_facts
from groundstation.core.messages import Ask, CommandSent, FlightEvent, Request, Tick
from groundstation.flight import Flight, about, make_flight
from groundstation.pose import TlogReader
from groundstation.recording import FlightLog
from links.io import parse_address
from links.mavlink.protocol import find_frame_end
from sim.runs import Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from tests.loops import free_address, in_real_time, running

pytestmark = pytest.mark.real_time

FLOWN_S = 1.5


class Relay(asyncio.DatagramProtocol):
    """Between an autopilot that speaks UDP and a stream."""

    def __init__(self, write: Callable[[bytes], Any]) -> None:
        self.write = write
        self.rest = b""
        self.autopilot: Any = None

    async def open(self, address: str) -> "Relay":
        loop = asyncio.get_running_loop()
        self.transport, _ = await loop.create_datagram_endpoint(
            lambda: self, local_addr=parse_address(address)
        )
        return self

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.autopilot = addr
        self.write(data)

    def feed(self, data: bytes) -> None:
        """Pass on the whole frames; each must begin where the last one ended."""
        self.rest += data
        while self.rest and (end := find_frame_end(self.rest, 0)) <= len(self.rest):
            assert end, "what the link writes is frame after frame"
            # Who speaks to an autopilot that hasn't started isn't heard.
            if self.autopilot is not None:
                self.transport.sendto(self.rest[:end], self.autopilot)
            self.rest = self.rest[end:]


async def over_tcp(udp: str, folder: Path, stack: contextlib.AsyncExitStack) -> dict[str, str]:
    ours: list[asyncio.StreamWriter] = []

    def write(data: bytes) -> None:
        for writer in ours:
            writer.write(data)

    relay = await Relay(write).open(udp)
    stack.callback(relay.transport.close)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        ours.append(writer)
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(4096):
                relay.feed(data)

    address = await free_address()
    server = await asyncio.start_server(serve, *parse_address(address))
    stack.callback(server.close)
    return {"tcp": address}


async def over_serial(udp: str, folder: Path, stack: contextlib.AsyncExitStack) -> dict[str, str]:
    fd, theirs = pty.openpty()
    tty.setraw(fd)
    relay = await Relay(lambda data: os.write(fd, data)).open(udp)
    stack.callback(os.close, fd)
    stack.callback(os.close, theirs)
    stack.callback(relay.transport.close)
    loop = asyncio.get_running_loop()
    loop.add_reader(fd, lambda: relay.feed(os.read(fd, 4096)))
    stack.callback(loop.remove_reader, fd)
    return {"serial": os.ttyname(theirs)}


def flown(autopilot: str, over: Any, folder: Path, source: str = "vicon") -> list[Tick]:
    """The commands of a short flight, which is recorded in ``folder``."""

    async def main() -> list[Tick]:
        udp, cameras = await free_address(), await free_address()
        async with contextlib.AsyncExitStack() as stack:
            way = await over(udp, folder, stack)
            told = [
                f"link.listen={udp}",
                *([f"pose.listen={cameras}"] if source == "vicon" else []),
            ]
            world, config = prepare(SCENARIOS["paper"], told, source=source)
            stage = await stack.enter_async_context(
                running(Stage(world, config, 0, autopilot=autopilot))
            )
            config = msgspec.structs.replace(
                config, link=msgspec.structs.replace(config.link, listen=None, **way)
            )
            ticks: list[Tick] = []

            def hear(event: FlightEvent) -> None:
                if isinstance(event, CommandSent):
                    ticks.append(event.tick)
                    if event.tick.flight_time_s > FLOWN_S:
                        flight.ask(Request(Ask.KILL, "enough"))

            log = FlightLog(
                folder / "flight.mcap", about(config), epoch_ns=0, tell=lambda text, *_: print(text)
            )
            stack.callback(log.close)
            flight: Flight = make_flight(
                config, confirm=confirm_at(0.0), subscribers=(hear,), give=log.write
            )
            outcome = await flight.run()
            assert outcome.reason == "motors off: enough"
            assert not stage.autopilot.armed
            return ticks

    return in_real_time(main)()


@pytest.mark.parametrize(("autopilot", "over"), [("ardupilot", over_tcp), ("px4", over_serial)])
def test_the_vehicle_is_flown_over_a_stream(autopilot: str, over: Any, tmp_path: Path) -> None:
    ticks = flown(autopilot, over, tmp_path)
    last = ticks[-1]
    off = [a - b for a, b in zip(last.pose.position_ned, last.reference.position_ned, strict=True)]
    assert max(map(abs, off)) < 0.3
    assert len(ticks) > 0.5 * FLOWN_S / 0.0225
    records = TlogReader((tmp_path / "flight.tlog").read_bytes())
    names = Counter(record.message.get_type() for record in records)
    assert names["SET_ATTITUDE_TARGET"] >= len(ticks)
    assert names["HEARTBEAT"] > 2


def test_a_flight_on_poses_by_a_serial_port_is_flown_again_to_the_last_bit(tmp_path: Path) -> None:
    ticks = flown("px4", over_serial, tmp_path, source="odometry")
    facts = replay_facts(tmp_path / "flight.mcap")
    assert facts["first_difference"] is None
    assert facts["identical"] is True
    assert facts["commands"] >= len(ticks)
    assert facts["unheard_wires"] == []
