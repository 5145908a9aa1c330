"""The autopilot's own attitude: asked for, read, put on our clock, or nothing."""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.core.geometry import so3
from groundstation.pose import TlogReader
from links.core import Attitude
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.mavlink.protocol import PX4, Message, RoundTrip, attitude_of, load_dialect
from sim.autopilots import AutopilotPeer, Px4Autopilot, SimulatedAutopilot
from sim.autopilots.dialects import ArduPilotAutopilot
from tests.airframe_double import Brick
from tests.loops import in_virtual_time
from tests.unit.links.mavlink.test_mavlink_link import HERE, Endpoint, scene

# By their numbers: a limit that the test took from the code would bear out any value.
ATTITUDE_HZ = 50.0

GOLDEN = Path(__file__).parents[3] / "golden"
DIALECT = load_dialect()
CLOCK = RoundTrip(0.004, 100.0)
RATES = (0.1, -0.2, 0.3)


def quaternion(
    boot_ms: int = 105_000,
    q: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0),
    rates: tuple[float, ...] = RATES,
) -> Message:
    return DIALECT.MAVLink_attitude_quaternion_message(boot_ms, *q, *rates)


def test_both_messages_tell_the_same() -> None:
    angles = (0.3, -0.2, 2.5)
    q = so3.from_euler_zyx(*angles)
    one = attitude_of(quaternion(q=q), 5.01, CLOCK)
    other = attitude_of(DIALECT.MAVLink_attitude_message(105_000, *angles, *RATES), 5.01, CLOCK)
    assert one is not None and other is not None
    assert one.attitude == pytest.approx(q)
    assert other.attitude == pytest.approx(q)
    assert one.rates_rad_s == other.rates_rad_s == RATES
    assert one.time_s == other.time_s == 5.0


@pytest.mark.parametrize(
    ("arrival_s", "clock", "time_s"),
    [
        (5.003, CLOCK, 5.0),
        (4.999, CLOCK, 5.0),  # TIMESYNC is wrong by half a round trip
        (5.9, CLOCK, 5.0),
        (6.1, CLOCK, 6.1),
        (4.8, CLOCK, 4.8),
        (5.003, None, 5.003),
    ],
)
def test_its_time_is_its_stamp_where_the_clock_is_known_and_else_its_arrival(
    arrival_s: float, clock: RoundTrip | None, time_s: float
) -> None:
    told = attitude_of(quaternion(), arrival_s, clock)
    assert told is not None and told.time_s == pytest.approx(time_s)


@pytest.mark.parametrize(
    "message",
    [
        DIALECT.MAVLink_heartbeat_message(2, PX4, 0, 0, 3, 3),
        quaternion(q=(0.0, 0.0, 0.0, 0.0)),
        quaternion(q=(math.nan, 0.0, 0.0, 1.0)),
        quaternion(q=(math.inf, 0.0, 0.0, 1.0)),
        quaternion(q=(1.1, 0.0, 0.0, 0.0)),
        quaternion(rates=(0.0, math.nan, 0.0)),
        quaternion(rates=(0.0, math.inf, 0.0)),
        DIALECT.MAVLink_attitude_message(0, math.inf, 0.0, 0.0, 0.0, 0.0, 0.0),
        DIALECT.MAVLink_attitude_message(0, 0.0, math.nan, 0.0, 0.0, 0.0, 0.0),
    ],
    ids=str,
)
def test_what_is_no_attitude_is_nothing(message: Message) -> None:
    assert attitude_of(message, 1.0, CLOCK) is None


def test_every_attitude_of_a_real_autopilot_is_read() -> None:
    records = TlogReader((GOLDEN / "ardupilot_landing.tlog").read_bytes())
    messages = [r.message for r in records if r.message.get_type() == "ATTITUDE_QUATERNION"]
    told = [attitude_of(message, 0.0, None) for message in messages]
    assert len(told) == 1750
    assert None not in told


@pytest.mark.parametrize("make", [Px4Autopilot, ArduPilotAutopilot])
@pytest.mark.parametrize("quiet", [True, False])
@in_virtual_time
async def test_whoever_watches_gets_fifty_attitudes_a_second_on_our_clock(
    make: Callable[[Brick], SimulatedAutopilot], quiet: bool
) -> None:
    heard: list[tuple[float, Attitude]] = []
    loop = asyncio.get_running_loop()
    link = MavlinkLink(MavlinkLinkConfig(quiet=quiet), thrust_max_n=2.0)
    link.watch_attitude(lambda told: heard.append((loop.time(), told)))
    peer = asyncio.create_task(AutopilotPeer(make(Brick()), HERE, delay_s=0.03).run())
    await link.connect()
    heard.clear()
    await asyncio.sleep(4.0)
    assert link.status.angles_rad == heard[-1][1].angles_rad
    await link.close()
    peer.cancel()
    assert len(heard) == pytest.approx(4.0 * ATTITUDE_HZ, abs=3)
    late = [when - told.time_s for when, told in heard[10:]]
    assert max(late) - min(late) < 0.002
    # Half of the round trip, which is 30 ms one way and nothing the other.
    assert 0.01 < min(late) < 0.035


@scene(connect=False, quiet=True)
async def test_the_quaternion_is_asked_for_and_the_angles_are_stopped(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    link.watch_attitude(lambda told: None)
    await link.connect()
    asked = {m.param1: m.param2 for m in autopilot.of("COMMAND_LONG")}
    assert (asked[30.0], asked[31.0]) == (-1.0, 20_000.0)


@scene(connect=False)
async def test_unless_it_is_to_be_quiet_no_message_is_stopped(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    await link.connect()
    assert -1.0 not in {m.param2 for m in autopilot.of("COMMAND_LONG")}
