"""A second vehicle with the same system id sends to the port of a flight: before arming, and in flight."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from groundstation.core.messages import Verdict, tell_lines
from groundstation.core.mission import State
from groundstation.flight import make_flight
from groundstation.lab.pose_monitor import listen
from groundstation.settings import Config
from links.io import parse_address
from links.mavlink.protocol import PX4, MavCommand, MavlinkCodec
from sim.runs import Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import running
from tests.loops import in_virtual_time

T = TypeVar("T")


class SecondVehicle(asyncio.DatagramProtocol):
    """Sends the heartbeat of system 1, and notes what it is sent."""

    def __init__(self) -> None:
        self.codec = MavlinkCodec(1, 1)
        self.heard: list[Any] = []

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.heard += self.codec.feed(data, addr)

    async def run(self, station: tuple[str, int], begin_s: float) -> None:
        await asyncio.sleep(begin_s)
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(lambda: self)
        while True:
            beat = self.codec.dialect.MAVLink_heartbeat_message(2, PX4, 0, 6 << 16, 3, 3)
            transport.sendto(self.codec.pack(beat), station)
            await asyncio.sleep(1.0)

    @property
    def commands(self) -> list[int]:
        return [m.command for m in self.heard if m.get_type() == "COMMAND_LONG"]


def beside(work: Callable[[Config], Awaitable[T]], begin_s: float, source: str = "vicon") -> tuple[T, list[int]]:
    """Return what ``work`` returns beside a second vehicle that sends after ``begin_s`` [s], and its commands."""
    world, config = prepare(SCENARIOS["paper"], ["flight.duration_s=4"], source=source)
    second = SecondVehicle()

    async def main() -> T:
        other = asyncio.create_task(second.run(parse_address(config.link.endpoint), begin_s))
        async with running(Stage(world, config, 0)):
            found = await work(config)
        other.cancel()
        return found

    return in_virtual_time(main)(), second.commands


def test_the_check_fails_and_names_both_addresses() -> None:
    checks, commands = beside(lambda config: make_flight(config, confirm=confirm_at(0.0)).check(), 0.3)
    (frames,) = [one for one in checks if one.name == "frames"]
    assert frames.verdict is Verdict.FAIL
    assert frames.says.startswith("two autopilots with MAVLink system id 1 are heard")
    assert frames.says.count("127.0.0.1:") == 2
    assert MavCommand.ARM_DISARM not in commands


def test_in_flight_it_is_told_once_and_the_flight_goes_on() -> None:
    said: list[str] = []
    tells = (tell_lines(said.append),)
    outcome, commands = beside(lambda one: make_flight(one, confirm=confirm_at(0.0), subscribers=tells).run(), 4.0)
    assert outcome.state is State.LANDED, outcome.reason
    told = [line for line in said if "two autopilots with MAVLink system id 1 are heard" in line]
    assert len(told) == 1
    assert any("during the flight" in line and "another address" in line for line in said)
    assert MavCommand.ARM_DISARM not in commands


def test_a_look_at_the_autopilot_s_own_poses_names_both() -> None:
    seen, _ = beside(lambda config: listen(config, 4.0), 0.3, source="odometry")
    assert seen.advice.startswith("two autopilots with MAVLink system id 1 are heard")
    assert seen.poses > 100
    assert not seen.ok
