"""Timers and limits of a connection: attempts, waiting frames, other senders, late answers."""

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Callable
from typing import Any

import pytest

from links.core import Arrival
from links.io import NETWORK, Network
from links.mavlink import MavlinkLinkConfig
from links.mavlink.protocol import MavlinkCodec, OtherTraffic, Uplink
from links.mavlink.transport import ReconnectingTransport, SerialTransport
from tests.loops import in_virtual_time
from tests.unit.links.mavlink.test_mavlink_link import D


class Ports(Network):
    """A network whose serial ports can't be opened for a while, and then are a ``Port``."""

    def __init__(self, closed_for_s: float = 0.0) -> None:
        self._closed_for_s = closed_for_s
        self.tried_s: list[float] = []

    async def open_serial(
        self, factory: Callable[[], Any], path: str, baud: int
    ) -> tuple[Any, Any]:
        self.tried_s.append(asyncio.get_running_loop().time())
        if len(self.tried_s) > 1 and self.tried_s[-1] - self.tried_s[0] < self._closed_for_s:
            raise OSError(2, "No such file")
        port, protocol = Port(), factory()
        protocol.connection_made(port)
        return port, protocol


class Port:
    """A port in which a settable number of bytes waits."""

    def __init__(self) -> None:
        self.queued = 0
        self.sent: list[bytes] = []
        self.is_open = True

    def waiting(self) -> int:
        return self.queued

    def send(self, data: bytes) -> int:
        self.sent.append(data)
        return len(data)

    def abort(self) -> None:
        self.is_open = False


Opened = tuple[ReconnectingTransport, Any, Counter[str], list[str]]
"""The line, its port, what it has dropped, and what it has told."""


@contextlib.asynccontextmanager
async def opened(ports: Ports, baud: int = 57600) -> AsyncIterator[Opened]:
    NETWORK.set(ports)
    told, dropped = list[str](), Counter[str]()
    config = MavlinkLinkConfig(serial="/dev/ttyUSB0", baud=baud)
    line = ReconnectingTransport(
        config, dropped, on_data=lambda *_: None, on_loss=told.append, on_news=told.append
    )
    await line.open()
    assert isinstance(line.wire, SerialTransport)
    yield line, line.wire._transport, dropped, told
    line.cut()


@in_virtual_time
async def test_a_lost_wire_is_tried_every_second() -> None:
    ports = Ports(closed_for_s=3.5)
    async with opened(ports) as (line, _, _, told):
        line.lose_transport("unplugged")
        await asyncio.sleep(60.0)
        assert ports.tried_s == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
        again = "; trying again every 1 s"
        refused = f"the link is lost: cannot open /dev/ttyUSB0 (No such file){again}"
        back = "the wire is back: waiting for the autopilot's HEARTBEAT"
        assert told == [f"the link is lost: unplugged{again}", *[refused] * 3, back]
        assert line.wire is not None


@pytest.mark.parametrize(
    ("baud", "queued", "leaves"),
    [
        (57600, 0, True),
        (57600, 115, True),  # 20 ms of ten bits a byte
        (57600, 116, False),
        (9600, 64, True),  # a frame always has room
        (9600, 65, False),
        (921600, 1843, True),
        (921600, 1844, False),
    ],
)
@in_virtual_time
async def test_a_frame_leaves_by_a_port_that_is_done_with_what_waits_within_20_ms(
    baud: int, queued: int, leaves: bool
) -> None:
    async with opened(Ports(), baud) as (line, port, dropped, _):
        port.queued = queued
        assert line.send(b"frame", None) is leaves
        assert dropped == ({} if leaves else {"full": 1})
        assert port.sent == ([b"frame"] if leaves else [])


@in_virtual_time
async def test_a_port_that_takes_nothing_for_a_quarter_of_a_second_is_closed() -> None:
    async with opened(Ports()) as (line, port, dropped, _):
        port.queued = 10_000
        open_at = []
        for n in range(30):
            line.send(b"frame", None)
            open_at.append(port.is_open)
            port.queued = 0 if n == 10 else 10_000  # one frame it takes, and the time begins anew
            await asyncio.sleep(0.02)
        assert open_at.index(False) == 12 + 13
        assert dropped["full"] == 25


def heard(codec: MavlinkCodec, message: Any) -> Any:
    """``message`` as it comes out of the wire."""
    (read,) = MavlinkCodec(255, 190).feed(codec.pack(message))
    return read


def set_point(codec: MavlinkCodec, system: int) -> Any:
    level, zeros = [1.0, 0.0, 0.0, 0.0], [0.0] * 4
    return heard(codec, D.MAVLink_set_attitude_target_message(0, system, 1, 0, level, *zeros))


def test_whoever_else_steers_is_a_rival_for_three_seconds() -> None:
    others = OtherTraffic(MavlinkLinkConfig())
    others.take_message(set_point(MavlinkCodec(255, 190), 1), "10.0.0.9:14550", 10.0, ours=False)
    assert [bool(others.rival(now_s)) for now_s in (10.0, 12.99, 13.0)] == [True, True, False]
    assert "system 255, component 190" in others.rival(10.0)
    others.take_message(set_point(MavlinkCodec(255, 190), 2), "10.0.0.9:14550", 20.0, ours=False)
    assert not others.rival(20.0), "it steers another vehicle"
    config = MavlinkLinkConfig()
    own = MavlinkCodec(config.system_id, config.component_id)
    others.take_message(set_point(own, 1), "10.0.0.9:14550", 20.0, ours=True)
    assert not others.rival(20.0), "an echo of ours"
    others.take_message(set_point(own, 0), "10.0.0.9:14550", 20.0, ours=False)
    assert others.rival(20.0)


def test_at_most_sixteen_other_systems_are_named_and_whoever_tells_positions_is_known() -> None:
    others = OtherTraffic(MavlinkLinkConfig())
    for system in range(2, 20):
        beat = heard(MavlinkCodec(system, 1), D.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3))
        others.take_message(beat, f"10.0.0.{system}:14550", 0.0, ours=False)
    named = [f"system {n}, component 1 at 10.0.0.{n}:14550" for n in range(2, 18)]
    assert list(others.systems) == named
    assert not others.tells_position
    position = D.MAVLink_vision_position_estimate_message(0, 0, 0, 0, 0, 0, 0)
    others.take_message(heard(MavlinkCodec(9, 197), position), "10.0.0.9:14550", 0.0, ours=False)
    assert others.tells_position


def answer(uplink: Uplink, asked_ns: int, now_s: float) -> None:
    uplink.take_message(D.MAVLink_timesync_message(77, asked_ns), now_s, 0.02)


def begun() -> Uplink:
    uplink = Uplink(0.05)
    uplink.begin(0.0)
    return uplink


def test_an_answer_is_overdue_since_it_was_first_heard_less_the_usual_trip_and_the_period() -> None:
    uplink = begun()
    asked = [uplink.ask(now_s) for now_s in (0.0, 0.049, 0.05, 0.12)]
    assert asked == [0, None, 50_000_000, 120_000_000], "one in 50 ms"
    answer(uplink, 50_000_000, 0.07)
    assert uplink.arrival(0.07, 0.02) == Arrival()
    assert uplink.arrival(0.2, 0.02) == pytest.approx((0.2 - 0.07 - 0.02 - 0.05, 0.0))
    assert uplink.arrival(0.221, 0.02) == Arrival(), "it was not heard for 150 ms: nobody knows"


@pytest.mark.parametrize(
    ("late_s", "lasts_s", "told"), [(0.51, 0.14, False), (0.51, 0.16, True), (0.49, 0.16, False)]
)
def test_an_answer_half_a_second_beyond_the_usual_is_late_once_such_answers_last_for_150_ms(
    late_s: float, lasts_s: float, told: bool
) -> None:
    uplink = begun()
    for asked_ns in [uplink.ask(0.1 * n) for n in range(2)]:
        assert asked_ns is not None
        answer(uplink, asked_ns, asked_ns * 1e-9 + 0.02 + late_s)
    found = uplink.arrival(0.02 + late_s + lasts_s, 0.02).late_s
    assert found == (pytest.approx(late_s) if told else 0.0)


@pytest.mark.parametrize(("age_s", "overdue_s"), [(2.9, 0.07), (3.1, 0.0)])
def test_what_was_asked_more_than_three_seconds_ago_is_forgotten(
    age_s: float, overdue_s: float
) -> None:
    uplink = begun()
    uplink.ask(0.0)
    uplink.ask(age_s)
    answer(uplink, 0, age_s + 0.01)
    assert uplink.arrival(age_s + 0.15, 0.02)[0] == pytest.approx(overdue_s)


def test_what_was_held_back_once_and_came_all_together_is_not_late_any_more() -> None:
    uplink, asked = begun(), list[int]()
    for n in range(101):
        uplink.take_message(D.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3), 0.01 * n, 0.02)
        asked += [ns for ns in (uplink.ask(0.01 * n),) if ns is not None]
    for ns in asked:
        uplink.take_message(D.MAVLink_timesync_message(77, ns), 1.01, 0.02)
    assert uplink.arrival(1.01, 0.02) == (0.0, 0.0)
