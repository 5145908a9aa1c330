"""Local port of link.remote: PX4 answers the first one that it hears, until it restarts."""

import asyncio
import errno
import socket
from typing import Any

import pytest

from groundstation.pose.sources import cannot_listen
from links.core import LinkLost
from links.io import format_address, parse_address
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.mavlink.protocol.config import LOCAL_PORTS
from tests.loops import in_virtual_time
from tests.unit.links.mavlink.test_mavlink_link import Endpoint

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

    monkeypatch.setattr("links.mavlink.connection.open_wire", refuse)
    with pytest.raises(LinkLost) as refused:
        asyncio.run(link(**options).connect())
    for text in (str(refused.value), str(cannot_listen("poses", "10.1.2.3:51001", error))):
        assert advice in text
        assert "holds" not in text
