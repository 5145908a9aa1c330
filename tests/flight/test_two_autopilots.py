"""A second vehicle of the same system id at the port of a flight, before arming and in flight."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

from groundstation.core.messages import Verdict, tell_lines
from groundstation.core.mission import State
from groundstation.flight import make_flight
from groundstation.lab.pose_monitor import listen
from groundstation.settings import Config
from links.io import parse_address
from links.mavlink.protocol import MavCommand
from sim.runs import Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from tests.loops import in_virtual_time, running
from tests.unit.links.mavlink.test_mavlink_link import Endpoint

T = TypeVar("T")


def beside(
    work: Callable[[Config], Awaitable[T]], begin_s: float, source: str = "vicon"
) -> tuple[T, list[int]]:
    """Do ``work`` beside a second vehicle that sends after ``begin_s`` [s]; its commands, too."""
    world, config = prepare(SCENARIOS["paper"], ["flight.duration_s=4"], source=source)
    second = Endpoint()

    async def send() -> None:
        await asyncio.sleep(begin_s)
        await second.open(remote=parse_address(config.link.endpoint))
        await second.beating()

    async def main() -> T:
        other = asyncio.create_task(send())
        async with running(Stage(world, config, 0)):
            found = await work(config)
        other.cancel()
        return found

    return in_virtual_time(main)(), [m.command for m in second.of("COMMAND_LONG")]


def test_the_check_fails_and_names_both_addresses() -> None:
    checks, commands = beside(
        lambda config: make_flight(config, confirm=confirm_at(0.0)).check(), 0.3
    )
    (frames,) = [one for one in checks if one.name == "frames"]
    assert frames.verdict is Verdict.FAIL
    assert frames.says.startswith("two autopilots with MAVLink system id 1 are heard")
    assert frames.says.count("127.0.0.1:") == 2
    assert MavCommand.ARM_DISARM not in commands


def test_in_flight_it_is_told_once_and_the_flight_goes_on() -> None:
    said: list[str] = []
    tells = (tell_lines(said.append),)
    outcome, commands = beside(
        lambda one: make_flight(one, confirm=confirm_at(0.0), subscribers=tells).run(), 4.0
    )
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
