"""links/mavlink/link.py towards PX4, ArduPilot and strangers, in virtual time."""

import asyncio
import errno
import itertools
import socket
from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
import pytest

from groundstation.pose.sources import cannot_listen
from links.core import Command, LinkLost
from links.io import format_address, parse_address
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.mavlink.protocol import ARDUPILOT, INVALID, PX4, MavCommand, MavlinkCodec
from links.mavlink.protocol.config import LOCAL_PORTS
from tests.loops import Scene, in_virtual_time, on_stage

# By their numbers: a limit that the test took from the code would bear out any value.
STALE_HEARTBEAT_S = 0.5

HERE = ("127.0.0.1", 14540)
D = MavlinkCodec(1, 1).dialect


class Endpoint(asyncio.DatagramProtocol):
    """One end of a conversation, written down, with a function that answers."""

    beat_s = 1.0

    def __init__(self, system: int = 1, component: int = 1, kind: int = PX4) -> None:
        self.codec = MavlinkCodec(system, component)
        self.kind = kind
        self.armed = False
        self.heard: list[tuple[float, Any]] = []
        self.answer: Callable[[Any], list[Any]] = lambda message: []
        self.beats: asyncio.Task[None]
        """Its heartbeats, for as long as a scene does not end them."""

    async def open(
        self, local: tuple[str, int] | None = None, remote: tuple[str, int] | None = HERE
    ) -> "Endpoint":
        loop = asyncio.get_running_loop()
        self.transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=local)
        self.remote = remote
        return self

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.remote = addr
        for message in self.codec.feed(data):
            self.heard.append((asyncio.get_running_loop().time(), message))
            self.say(*self.answer(message))

    def say(self, *messages: Any) -> None:
        for message in messages:
            self.transport.sendto(self.codec.pack(message), self.remote)

    def beat(self) -> None:
        guided = 4 if self.kind == ARDUPILOT else 0
        self.say(D.MAVLink_heartbeat_message(2, self.kind, 128 if self.armed else 0, guided, 3, 3))

    async def beating(self) -> None:
        while True:
            self.beat()
            await asyncio.sleep(self.beat_s)

    def of(self, name: str) -> list[Any]:
        return [m for _, m in self.heard if m.get_type() == name]


def ack(command: int, result: int = 0, system: int = 245, component: int = 190) -> Any:
    return D.MAVLink_command_ack_message(command, result, 0, 0, system, component)


def accept(message: Any) -> list[Any]:
    return [ack(message.command)] if message.get_type() == "COMMAND_LONG" else []


def command(thrust_n: float = 1.0, coast_s: float = 0.25) -> Command:
    now = asyncio.get_running_loop().time()
    return Command(thrust_n, (0.0, 0.0, 0.0), 1, now, now + coast_s)


def play_scene(
    play: Callable[[MavlinkLink, Endpoint], Awaitable[None]],
    *,
    kind: int = PX4,
    connect: bool = True,
    vehicle_curve: float = 0.0,
    **options: Any,
) -> None:
    """Play with a link and an autopilot that accepts every command and sends its heartbeat."""

    async def main() -> None:
        autopilot = await Endpoint(kind=kind).open()
        autopilot.answer = accept
        config = MavlinkLinkConfig(**({"quiet": False} | options))
        link = MavlinkLink(config, thrust_max_n=2.0, thrust_curve=vehicle_curve)
        autopilot.beats = asyncio.create_task(autopilot.beating())
        try:
            if connect:
                await link.connect()
            await play(link, autopilot)
        finally:
            autopilot.beats.cancel()
            await link.close()

    in_virtual_time(main)()


def scene(**options: Any) -> Callable[[Scene], Callable[..., None]]:
    """Make a test of a coroutine with a link and an autopilot; ``options``: of ``play_scene``."""
    return on_stage(lambda play: play_scene(play, **options), 2)


@scene()
async def test_we_send_a_heartbeat_every_second_once_somebody_is_there(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    await asyncio.sleep(5.5)
    beats = autopilot.of("HEARTBEAT")
    assert 6 <= len(beats) <= 7
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in beats} == {(245, 190)}


@scene()
async def test_a_heartbeat_of_what_is_no_autopilot_leaves_an_armed_vehicle_armed(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    autopilot.armed = True
    await link.arm(lambda: command(0.0))
    await asyncio.sleep(STALE_HEARTBEAT_S + 1.0)
    # A companion, a gimbal, a camera with the autopilot's own numbers, which never arm.
    for kind in (18, 26, 30):
        autopilot.say(D.MAVLink_heartbeat_message(kind, INVALID, 0, 0, 4, 3))
    await asyncio.sleep(0.01)
    assert link.status.state == "armed"
    autopilot.armed = False
    autopilot.beat()
    await asyncio.sleep(0.01)
    assert link.status.state == "connected", "the autopilot's own tells"


@in_virtual_time
async def test_only_a_heartbeat_of_the_vehicle_makes_a_connection() -> None:
    link = MavlinkLink(MavlinkLinkConfig(connect_timeout_s=2.0), thrust_max_n=2.0)
    got: list[str] = []
    link.connection.subscribe(lambda m, s: got.append(m.get_type()))
    connecting = asyncio.create_task(link.connect())
    await asyncio.sleep(0.1)
    assert link.status.state == "connecting"
    wrong, right = await Endpoint(system=9).open(), await Endpoint().open()
    wrong.beat()
    right.say(D.MAVLink_vfr_hud_message(1, 2, 3, 4, 5, 6))
    # Another ground station with the same system.
    right.say(D.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    says = r"no HEARTBEAT of .* 1, component 1 .*: 2 messages of other systems, heard instead: "
    with pytest.raises(LinkLost, match=says + r"system 9, component 1 at 127\.0\.0\.1:"):
        await connecting
    assert got == []
    assert link.status.state == "closed"


@scene(connect=False)
async def test_an_autopilot_that_restarts_behind_another_address_waits_for_a_new_arming(
    link: MavlinkLink, first: Endpoint
) -> None:
    link.connection.request(lambda kind: {"ODOMETRY": 50.0})
    await link.connect()
    await link.arm(command)
    second = await Endpoint().open()
    second.answer = accept
    second.beat()
    await asyncio.sleep(0.1)
    assert link.status.dropped == {"other_address": 2}, "a heartbeat, and the answer to who it is"
    first.beats.cancel()
    await asyncio.sleep(3.5)
    second.beat()
    await asyncio.sleep(0.1)
    assert link.status.state == "connected"
    assert "arm anew" in link.status.text
    identity = float(D.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    asked = [m.param1 for m in second.of("COMMAND_LONG")]
    assert [number for number in asked if number != identity] == [230.0, 331.0]
    link.send(command())
    await asyncio.sleep(0.1)
    assert second.of("SET_ATTITUDE_TARGET") == []


@scene(quiet=True)
async def test_what_is_owed_to_a_vehicle_in_the_air_never_goes_to_another_with_its_number(
    link: MavlinkLink, own: Endpoint
) -> None:
    stranger = await Endpoint().open()
    stranger.answer = accept
    await link.arm(command)
    own.beats.cancel()
    for _ in range(200):  # its heartbeats are lost, and it is commanded all the same
        link.send(command())
        stranger.beat()
        await asyncio.sleep(0.02)
    assert link.status.state == "lost"
    assert stranger.of("SET_ATTITUDE_TARGET") == []
    assert own.of("SET_ATTITUDE_TARGET")
    await link.silent()
    stranger.beat()
    await asyncio.sleep(0.1)
    assert link.status.state == "connected"


@scene(connect=False, quiet=True)
async def test_an_autopilot_that_answers_no_requests_is_connected_all_the_same(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    autopilot.answer = lambda message: []
    await link.connect()
    assert link.status.state == "connected"
    assert len({m.param1 for m in autopilot.of("COMMAND_LONG")}) == 1  # and asked no further


def orders(autopilot: Endpoint) -> list[float]:
    return [m.param1 for m in autopilot.of("COMMAND_LONG") if m.command == MavCommand.ARM_DISARM]


@pytest.mark.parametrize(
    ("after_s", "ordered"), [(0.5, []), (1.5, [1.0, 0.0])], ids=["before", "after the order"]
)
@scene()
async def test_arming_that_is_given_up_takes_its_order_back(
    link: MavlinkLink, autopilot: Endpoint, after_s: float, ordered: list[float]
) -> None:
    autopilot.answer = lambda m: (
        accept(m) if getattr(m, "command", None) == MavCommand.DO_SET_MODE else []
    )
    arming = asyncio.create_task(link.arm(lambda: command(0.0)))
    await asyncio.sleep(after_s)
    arming.cancel()
    await asyncio.sleep(2.0)
    assert [order for order, _ in itertools.groupby(orders(autopilot))] == ordered


@scene()
async def test_a_heartbeat_that_left_before_arming_is_not_believed_after_it(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    await link.arm(lambda: command(0.0))
    autopilot.beat()  # still says disarmed
    await asyncio.sleep(0.05)
    assert link.status.state == "armed"
    await asyncio.sleep(2.0)
    assert link.status.state == "connected"
    autopilot.armed = True
    await asyncio.sleep(1.1)
    assert link.status.state == "armed"


@scene()
async def test_land_is_asked_for_while_the_newest_command_still_holds(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    link._config = msgspec.structs.replace(link._config, bring_down="land")
    autopilot.armed = True
    await link.arm(lambda: command(0.0))
    assert link.send(command(5.0))
    before = len(autopilot.of("COMMAND_LONG"))
    link.land()
    await asyncio.sleep(0.01)
    asked = autopilot.of("COMMAND_LONG")[before:]
    assert [one.command for one in asked] == [MavCommand.REQUEST_MESSAGE], "who has it comes first"
    assert link.status.phase == "fresh", "the command has not run out"


@scene(kind=ARDUPILOT)
async def test_ardupilot_that_will_not_disarm_is_put_into_land(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    autopilot.armed = True

    def answer(message: Any) -> list[Any]:
        if message.get_type() != "COMMAND_LONG":
            return []
        if message.command == MavCommand.DO_SET_MODE:
            autopilot.armed = False
        return [ack(message.command, 4 if message.command == MavCommand.ARM_DISARM else 0)]

    autopilot.answer = answer
    await link.disarm()
    last = autopilot.of("COMMAND_LONG")[-1]
    assert (last.command, last.param2) == (MavCommand.DO_SET_MODE, 9.0)
    assert link.status.state == "connected"


@pytest.mark.parametrize(("own", "share"), [(None, 0.5), (0.0, 0.25), (1.0, 0.5)])
def test_the_vehicles_curve_bends_the_signal_unless_the_link_has_its_own(
    own: float | None, share: float
) -> None:
    async def play(link: MavlinkLink, autopilot: Endpoint) -> None:
        await link.arm(lambda: command(0.0))
        link.send(command(0.5))
        await asyncio.sleep(0.1)
        last = autopilot.of("SET_ATTITUDE_TARGET")[-1]
        assert last.thrust == pytest.approx(share), "the root of 0.25"

    play_scene(play, vehicle_curve=1.0, thrust_curve=own)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"listen": "127.0.0.1:14540", "remote": "127.0.0.1:14580"}, "exclude each other"),
        ({"tcp": "a:1", "serial": "/dev/x"}, "tcp and serial exclude each other"),
        ({"listen": "a:1", "tcp": "b:1"}, "listen and tcp exclude each other"),
        ({"tcp": ""}, "tcp: '' is not an address"),
        ({"bring_down": "land", "ardupilot_mode": "GUIDED_NOGPS"}, "position estimate on board"),
        ({"tcp": "nowhere"}, "is not an address"),
        ({"listen": "nowhere"}, "is not an address"),
        ({"remote": "127.0.0.1"}, "is not an address"),
        ({"system_id": 0}, "system_id"),
        ({"period_s": 0.0}, "period_s"),
        ({"thrust_curve": 1.5}, "thrust_curve"),
        ({"lissen": "127.0.0.1:14540"}, "lissen"),
    ],
)
def test_a_bad_configuration_is_refused(options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=complaint):
        msgspec.convert(options, MavlinkLinkConfig)


@scene()
async def test_another_program_that_steers_the_same_autopilot_is_told_by_name(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    """test_mavlink_connection.py tries how long it must steer, and which vehicle."""

    async def steer(system: int, component: int) -> str:
        frame = MavlinkCodec(system, component).attitude_target(0.0, 1, 1, 0.5, (0.0, 0.0, 0.0))
        autopilot.transport.sendto(frame, autopilot.remote)
        await asyncio.sleep(0.1)
        return link.status.conflict

    await link.arm(lambda: command(0.0))
    assert await steer(245, 190) == ""
    await link.disarm()
    assert "MAVLink system 245, component 190" in await steer(245, 190)
    assert "42, component 7, sends SET_ATTITUDE_TARGET, to this vehicle, too" in await steer(42, 7)


# ---- the local port of `remote`: PX4 answers the first one that it hears, until it restarts

REMOTE = "127.0.0.1:14580"


def port(remote: str = REMOTE, **keys: Any) -> int:
    return MavlinkLinkConfig(remote=remote, **keys).local_address[1]


def link(**keys: Any) -> MavlinkLink:
    return MavlinkLink(MavlinkLinkConfig(**keys), thrust_max_n=2.0)


def test_the_port_is_the_same_each_time_and_another_for_another_vehicle_or_address() -> None:
    assert port() == port() == port(baud=9600, period_s=0.1)
    assert port() in LOCAL_PORTS
    others = {port("127.0.0.1:14581"), port("10.0.0.9:14580"), port(target_system=2)}
    assert len(others | {port()}) == 4
    assert (min(LOCAL_PORTS), max(LOCAL_PORTS)) == (20_000, 29_999)


def test_the_operator_s_port_counts_before_it() -> None:
    assert port(local_port=14600) == 14600
    with pytest.raises(ValueError, match="local_port is the port from which `remote` is spoken to"):
        MavlinkLinkConfig(local_port=14600)


@pytest.mark.parametrize(
    ("remote", "host"),
    [
        ("127.0.0.1:14580", "127.0.0.1"),
        ("localhost:14580", "127.0.0.1"),
        ("[::1]:14580", "::1"),
        ("192.168.1.20:14580", "0.0.0.0"),
        ("[fd00::20]:14580", "::"),
    ],
)
def test_on_loopback_nobody_else_reaches_it(remote: str, host: str) -> None:
    assert MavlinkLinkConfig(remote=remote).local_address[0] == host


@in_virtual_time
async def test_the_vehicle_hears_every_run_from_the_same_port() -> None:
    vehicle = await Endpoint().open(local=("127.0.0.1", 14580))
    vehicle.answer = lambda m: [vehicle.codec.dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)]
    heard = []
    for _ in range(2):
        station = link(remote=REMOTE, quiet=False)
        await station.connect()
        heard.append(vehicle.remote)
        await station.close()
    assert heard == [("127.0.0.1", port())] * 2


@in_virtual_time
async def test_where_nothing_comes_the_first_port_is_named_as_a_cause() -> None:
    says = rf"the first port that it heard.*from port {port()}: .*link\.local_port"
    with pytest.raises(LinkLost, match=says):
        await link(remote=REMOTE, connect_timeout_s=1.0).connect()
    with pytest.raises(LinkLost, match="nothing came at all") as refused:
        await link(connect_timeout_s=1.0).connect()
    assert "local_port" not in str(refused.value)


def test_an_autopilot_that_boots_after_the_first_message_is_silent_for_the_same_cause() -> None:
    async def main() -> str:
        open_port = asyncio.get_running_loop().create_datagram_endpoint
        taken, _ = await open_port(asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0))
        remote = format_address(taken.get_extra_info("sockname"))
        taken.close()
        await asyncio.sleep(0)  # the port is released in the loop's next turn
        connecting = asyncio.ensure_future(link(remote=remote, connect_timeout_s=1.3).connect())
        await asyncio.sleep(0.5)  # the network gives the first message back
        vehicle, _ = await open_port(asyncio.DatagramProtocol, local_addr=parse_address(remote))
        with pytest.raises(LinkLost) as silent:
            await connecting
        vehicle.close()
        return str(silent.value)

    assert "1 messages of ours that the network gave back" in (said := asyncio.run(main()))
    assert "link.local_port" in said


async def taken_port(says: str, **keys: Any) -> None:
    """Expect a link to be refused in words, as another program has its port of this machine."""
    taken, _ = await asyncio.get_running_loop().create_datagram_endpoint(
        asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0)
    )
    number = taken.get_extra_info("sockname")[1]
    options: dict[str, Any] = {
        key: value.format(port=number) if isinstance(value, str) else number
        for key, value in keys.items()
    }
    with pytest.raises(LinkLost, match=says.format(port=number)):
        await link(**options).connect()
    taken.close()


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"remote": REMOTE, "local_port": 0}, r"holds UDP port {port} .*`ss -lunp`.*\.local_port"),
        ({"listen": "127.0.0.1:{port}"}, "holds this port, and `ss -lunp` names it: end it"),
    ],
)
def test_a_port_that_is_taken_is_told_with_the_way_to_find_its_holder(
    keys: dict[str, Any], says: str
) -> None:
    asyncio.run(taken_port(says, **keys))


@pytest.mark.parametrize(
    ("error", "advice"),
    [
        (socket.gaierror(socket.EAI_NONAME, "not known"), "write the address in numbers"),
        (OSError(errno.EADDRNOTAVAIL, "Cannot assign"), "`ip address` lists those"),
        (OSError(errno.EACCES, "denied"), "as it does broadcast addresses, and ports below 1024"),
    ],
)
@pytest.mark.parametrize("options", [{"remote": REMOTE}, {"listen": "10.1.2.3:14540"}])
def test_an_address_that_can_not_be_used_is_not_blamed_on_a_program_that_holds_its_port(
    error: OSError, advice: str, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def refuse(*_: object) -> None:
        raise error

    monkeypatch.setattr("links.mavlink.transport.open_wire", refuse)
    with pytest.raises(LinkLost) as refused:
        asyncio.run(link(**options).connect())
    for text in (str(refused.value), str(cannot_listen("poses", "10.1.2.3:51001", error))):
        assert advice in text
        assert "holds" not in text
