"""The relay: every datagram to every core, bytes unchanged; a core that is gone harms nobody."""

import asyncio

import pytest
from hypothesis import given, settings, strategies as st

from groundstation.core.messages import PoseStatus, SourceError
from groundstation.lab import Relay
from groundstation.lab.relay import SENDERS
from groundstation.pose.sources import JsonConfig, send_by
from groundstation.pose.sources.json_codec import encode, json_pose
from links.io import parse_address
from tests.e2e.stations import program, run_command
from tests.loops import BOTH_LOOPS, Inbox, Run, free_address, in_real_time, in_virtual_time


async def ears(addresses: list[str]) -> list[Inbox]:
    """Cores that only listen."""
    open_port = asyncio.get_running_loop().create_datagram_endpoint
    return [(await open_port(Inbox, local_addr=parse_address(one)))[1] for one in addresses]


async def speakers(address: str, count: int) -> list[asyncio.DatagramTransport]:
    """Trackers that send to an address, each from a port of its own."""
    open_port = asyncio.get_running_loop().create_datagram_endpoint
    return [
        (await open_port(asyncio.DatagramProtocol, remote_addr=parse_address(address)))[0]
        for _ in range(count)
    ]


async def handed_on(sent: list[bytes], *, gone: bool) -> tuple[list[Inbox], Relay]:
    """What three cores hear of ``sent``, the second of which may not be there."""
    targets = [await free_address() for _ in range(3)]
    listen = await free_address()
    relay = Relay(listen, targets)
    await relay.open()
    listening = await ears([targets[0], targets[2]] if gone else targets)
    (sender,) = await speakers(listen, 1)
    for data in sent:
        sender.sendto(data)
        await asyncio.sleep(0.002)
    await asyncio.sleep(0.05)
    relay.close()
    sender.sendto(b"late")
    await asyncio.sleep(0.01)
    for transport in (sender, *(ear.transport for ear in listening)):
        transport.close()
    await asyncio.sleep(0)
    return listening, relay


@settings(max_examples=30)
@given(st.lists(st.binary(min_size=1, max_size=2000), max_size=10), st.booleans())
def test_bytes_reach_every_core_that_is_there_unchanged_and_in_order(
    sent: list[bytes], gone: bool
) -> None:
    listening, relay = in_virtual_time(handed_on)(sent, gone=gone)
    assert [ear.heard for ear in listening] == [sent] * (2 if gone else 3)
    assert relay.received == len(sent)
    assert not relay.dropped


@pytest.mark.real_time
def test_a_core_that_is_gone_takes_nothing_from_the_others() -> None:
    sent = [bytes([number]) * (number + 1) for number in range(50)]
    listening, relay = in_real_time(handed_on)(sent, gone=True)
    assert [ear.heard for ear in listening] == [sent] * 2
    assert f"relay: {len(sent)} datagrams handed on to 3 cores" in relay.summary()


@pytest.mark.parametrize("run", BOTH_LOOPS)
def test_a_core_sees_by_the_relay_s_ports_that_two_trackers_send_its_body(run: Run) -> None:
    async def work() -> tuple[PoseStatus, str]:
        target, listen = await free_address(), await free_address()
        relay = Relay(listen, [target])
        await relay.open()
        core = JsonConfig(listen=target).build()
        await core.start(lambda pose: None)
        senders = await speakers(listen, SENDERS + 2)
        for n in range(20):
            for k, sender in enumerate(senders[:2]):
                place = (0.001 * n + k, 0.0, 1.0)
                sender.sendto(
                    encode([json_pose("quad", place, (1.0, 0.0, 0.0, 0.0), t=0.01 * n + 0.001)])
                )
            await asyncio.sleep(0.01)
        for sender in senders:  # more senders than ports
            sender.sendto(b"{}")
        await asyncio.sleep(0.05)
        status = core.status
        await core.close()
        relay.close()
        for sender in senders:
            sender.close()
        await asyncio.sleep(0)
        return status, relay.summary()

    status, summary = run(work)()
    assert "poses of the vehicle come from two addresses" in status.advice
    assert status.dropped["second_sender"] >= 15
    assert status.accepted >= 18
    assert summary.startswith(
        f"relay: {40 + SENDERS + 2} datagrams handed on to 1 cores, from 127.0.0.1:"
    )
    assert summary.count("127.0.0.1:") == SENDERS


@pytest.mark.parametrize("run", BOTH_LOOPS)
def test_a_group_is_joined(run: Run) -> None:
    async def main() -> list[bytes]:
        target, port = await free_address(), parse_address(await free_address())[1]
        relay = Relay(f"127.0.0.1:{port}", [target], group="239.255.42.98")
        await relay.open()
        (ear,) = await ears([target])
        sender, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0)
        )
        send_by(sender, "127.0.0.1")
        sender.sendto(b"frame", ("239.255.42.98", port))
        await asyncio.sleep(0.05)
        for transport in (sender, ear.transport):
            transport.close()
        relay.close()
        await asyncio.sleep(0)
        return ear.heard

    assert run(main)() == [b"frame"]


@pytest.mark.real_time
@in_real_time
async def test_a_port_that_is_taken_is_named() -> None:
    address = await free_address()
    (ear,) = await ears([address])
    try:
        with pytest.raises(SourceError, match=f"cannot listen for poses to hand on on {address}"):
            await Relay(address, ["127.0.0.1:51101"]).open()
    finally:
        ear.transport.close()
        await asyncio.sleep(0)


@pytest.mark.parametrize(
    ("listen", "target", "says"),
    [
        ("127.0.0.1:51001", "127.0.0.1:51001", "hear its own copies for ever: give each core a p"),
        ("0.0.0.0:51001", "127.0.0.1:51001", "hear its own copies for ever: give each core a port"),
        (
            "127.0.0.1:51001",
            "192.0.2.7:51101",
            "is not on this machine, .*: name a core here, such",
        ),
    ],
)
def test_a_target_that_no_copy_reaches_or_comes_back_from_is_refused(
    listen: str, target: str, says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        Relay(listen, ["127.0.0.1:51101", target])
    Relay(listen, ["127.0.0.1:51101", "127.0.0.2:51101"])
    with pytest.raises(ValueError, match="--group: expected a multicast"):
        Relay(listen, ["127.0.0.1:51101"], group="1.2.3.4")


@pytest.mark.real_time
def test_a_relay_ends_with_a_standard_input_that_nobody_can_wait_for() -> None:
    words = ("fleet", "relay", in_real_time(free_address)(), "--to", "127.0.0.1:51101")
    done = run_command(program("groundstation", *words, "--until-eof"))
    assert "relay: 0 datagrams handed on to 1 cores, from nobody" in done.stdout
    assert (done.returncode, done.stderr) == (0, "")
