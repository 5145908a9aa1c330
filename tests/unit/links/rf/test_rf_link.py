"""The serial RF link in virtual time, on a wire that can be cut, towards a simulated receiver."""

import asyncio
import contextlib
from collections.abc import AsyncIterator

import pytest

from links.core import LinkError, LinkLost, LinkMisuse, LinkRejected
from links.rf import CrsfLinkConfig, DsmLinkConfig, SerialRfLink, Service
from links.rf.channel_map import ArmSwitch, ChannelMap
from sim.radio import FAILSAFE_S, RfPeer, RfReceiver, WirePort
from sim.radio.radio import opened_on
from tests.airframe_double import Brick, RfRoom, command, idle
from tests.loops import in_virtual_time, running

CONFIG = DsmLinkConfig(map=ChannelMap(arm=ArmSwitch(channel=5)))


class Room(RfRoom):
    """One link, its wire, and the vehicle at the other end."""

    def __init__(self, config: DsmLinkConfig | CrsfLinkConfig) -> None:
        self.wire = WirePort()
        self.vehicle = Brick(0.0)
        self.receiver = RfReceiver(self.vehicle, config)
        self.peer = RfPeer(self.receiver, config)
        self.link = SerialRfLink(config, thrust_max_n=2.0, open_pacer=opened_on(self.wire))


@contextlib.asynccontextmanager
async def room(
    config: DsmLinkConfig | CrsfLinkConfig = CONFIG, *, armed: bool = False
) -> AsyncIterator[Room]:
    it = Room(config)
    async with running(it.peer):
        try:
            await it.link.connect()
            if armed:
                await it.link.arm(idle)
            yield it
        finally:
            with contextlib.suppress(LinkLost):
                await it.link.kill()
            await it.link.close()


@in_virtual_time
async def test_arming_takes_its_stated_time_and_returns_just_ahead_of_a_frame() -> None:
    loop = asyncio.get_running_loop()
    async with room() as it:
        begun = loop.time()
        await it.link.arm(idle)
        stated_s = CONFIG.arm_low_s + CONFIG.arm_high_s
        assert loop.time() - begun == pytest.approx(stated_s, abs=2.1 * CONFIG.period_s)
        assert it.receiver.armed
        it.link.send(command(1.0))
        await asyncio.sleep(CONFIG.lead_s + CONFIG.frame_s + 1e-6)
        assert it.thrust == pytest.approx(0.5, abs=1e-3), "the very next frame took it"


@in_virtual_time
async def test_a_kill_ends_an_arming_and_says_so() -> None:
    async with room() as it:
        arming = asyncio.create_task(it.link.arm(idle))
        await asyncio.sleep(0.7)
        await it.link.kill()
        with pytest.raises(LinkError, match="the motors were killed"):
            await arming
        assert not it.receiver.armed
        await it.link.arm(idle)
        assert it.receiver.armed


@in_virtual_time
async def test_an_unplugged_port_is_told_and_comes_back_disarmed() -> None:
    async with room(armed=True) as it:
        await it.stream(1.0, 0.5)
        it.wire.cut = True
        await it.stream(1.0, FAILSAFE_S + 0.2)
        assert it.link.status.state == "lost"
        assert "unplugged" in it.link.status.text
        assert it.receiver.failsafe
        assert not it.receiver.armed
        with pytest.raises(LinkLost, match="unplugged"):
            await it.link.arm(idle)
        with pytest.raises(LinkLost, match="the receiver's failsafe has to act: cannot open"):
            await it.link.kill()
        it.wire.cut = False
        await it.stream(1.0, 2.0)
        assert it.link.status.state == "connected"
        assert not it.receiver.failsafe
        assert not it.receiver.armed
        await it.link.arm(idle)
        assert it.link.status.state == "armed"


@in_virtual_time
async def test_arming_twice_is_misuse_and_changes_nothing() -> None:
    async with room(armed=True) as it:
        stream = asyncio.create_task(it.stream(1.0, 1.0))
        await asyncio.sleep(0.1)
        with pytest.raises(LinkMisuse, match="armed"):
            await it.link.arm(idle)
        assert it.thrust == pytest.approx(0.5, abs=1e-3)
        await stream


@in_virtual_time
async def test_a_module_binds_and_checks_its_range_only_while_disarmed() -> None:
    async with room() as it:
        await it.link.serve(Service.BIND, 0.5)
        await it.link.serve(Service.RANGE_CHECK, 0.5)
        assert set(it.receiver.services) == {Service.BIND, Service.RANGE_CHECK}
        it.receiver.services.clear()
        await it.link.arm(idle)
        stream = asyncio.create_task(it.stream(1.0, 1.0))
        with pytest.raises(LinkRejected, match="disarm first"):
            await it.link.serve(Service.BIND, 0.5)
        await stream
        assert it.receiver.services == []


@in_virtual_time
async def test_a_crsf_module_is_told_that_it_has_no_range_check() -> None:
    async with room(CrsfLinkConfig()) as it:
        with pytest.raises(LinkRejected, match="see its own menu"):
            await it.link.serve(Service.RANGE_CHECK, 0.5)
        await it.link.serve(Service.BIND, 0.1)
        assert it.receiver.services == [Service.BIND]


def test_a_receiver_that_hears_nothing_stops_its_motors_and_wants_the_switch_down_again() -> None:
    brick = Brick(0.0)
    receiver = RfReceiver(brick, CONFIG)
    codec = CONFIG.codec()
    up, down = [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0]
    full = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    for time_s, positions, armed in (
        (0.0, up, False),  # it has not seen the switch down
        (0.1, down, False),
        (0.2, full, False),  # nor does it arm with the throttle up
        (0.3, up, True),
        (0.4, full, True),
    ):
        receiver.receive(codec.encode(positions), time_s)
        assert receiver.armed is armed
    receiver.watch(0.4 + FAILSAFE_S)
    assert receiver.failsafe
    assert not receiver.armed
    receiver.receive(codec.encode(full), 2.0)
    receiver.receive(codec.encode(up), 2.1)
    assert not receiver.armed
    assert not receiver.failsafe


@in_virtual_time
async def test_a_slow_radio_brings_frames_late_and_whole() -> None:
    it = Room(CONFIG)
    it.peer = RfPeer(it.receiver, CONFIG, 0.05)
    loop = asyncio.get_running_loop()
    peer = asyncio.create_task(it.peer.run())
    await asyncio.sleep(0.0)
    for k in range(5):
        it.peer.datagram_received(CONFIG.codec().encode([0.1 * k] * 6), None)
        await asyncio.sleep(CONFIG.period_s)
    begun = loop.time()
    await asyncio.sleep(0.05)
    assert it.receiver.frames == 5
    assert it.receiver.heard_s == pytest.approx(begun - CONFIG.period_s + CONFIG.frame_s + 0.05)
    peer.cancel()
