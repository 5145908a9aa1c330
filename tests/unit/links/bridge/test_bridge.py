"""Link and RF bridge in virtual time, over a network that loses, delays, repeats and forges."""

import asyncio
import contextlib
import itertools
from collections import Counter
from collections.abc import AsyncIterator, Callable
from typing import Any

import pytest
from hypothesis import given, strategies as st

from links.bridge import Bridge, BridgeConfig, BridgeLink, BridgeLinkConfig
from links.bridge.codec import UPS, DatagramKind, Seal, Up, kind_of
from links.bridge.link import RemotePacer
from links.core import Command, LinkLost, LinkRejected, Segment
from links.io import parse_address
from links.rf import Arm, DsmLinkConfig, Give, PacerReport
from links.rf.channel_map import ArmSwitch, ChannelMap
from sim.radio import RfPeer, RfReceiver, WirePort
from sim.radio.radio import opened_on
from sim.time import VirtualTimeLoop
from tests.airframe_double import DOWN, Brick, RfRoom, command, idle, nonce
from tests.loops import in_virtual_time

# By their numbers: a limit that the test took from the code would bear out any value.
SILENT_S = 1.0

KEY = bytes(range(32))
MODULE = DsmLinkConfig(map=ChannelMap(arm=ArmSwitch(channel=5)), disarm_s=0.1)
ADDRESS = "127.0.0.1:14600"
Datagram = tuple[tuple[str, int], tuple[str, int], bytes]


class Network:
    """Between station and bridge; what passes is written down."""

    def __init__(self) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        self._loop, self._carry = loop, loop.carry
        loop.carry = self.carry  # type: ignore[method-assign]  # the wire itself is what is tested here
        self.seen: list[Datagram] = []
        self.lose: Callable[[Datagram], bool] = lambda datagram: False
        self.delay_s: Callable[[Datagram], float] = lambda datagram: 0.0

    def carry(self, source: tuple[str, int], target: tuple[str, int], data: bytes) -> None:
        datagram = source, target, data
        if kind_of(data) is None:
            self._carry(*datagram)
            return
        self.seen.append(datagram)
        if not self.lose(datagram):
            self._loop.call_later(self.delay_s(datagram), self._carry, *datagram)

    def again(self, datagram: Datagram) -> None:
        """Bring a datagram that was seen before once more."""
        self._carry(*datagram)

    def ups(self) -> list[Datagram]:
        return [each for each in self.seen if kind_of(each[2]) == DatagramKind.UP]


class Room(RfRoom):
    """A bridge with a module and a vehicle, and a station."""

    def __init__(self, *, remote_only: bool = False) -> None:
        self.network = Network()
        self.wire = WirePort()
        self.remote_only = remote_only
        self.vehicle = Brick(0.0)
        self.receiver = RfReceiver(self.vehicle, MODULE)
        self.peer = RfPeer(self.receiver, MODULE)
        self.said: list[str] = []
        self.bridge = self.new_bridge()
        self.link = self.station()
        self._peer = asyncio.create_task(self.peer.run())
        self.running = asyncio.create_task(self.bridge.run())

    def new_bridge(self) -> Bridge:
        config = BridgeConfig(listen=ADDRESS, link=MODULE)
        wires: dict[str, Any] = {"open_pacer": opened_on(self.wire), "nonce": nonce}
        return Bridge(config, KEY, say=self.said.append, remote_only=self.remote_only, **wires)

    async def restart(self) -> None:
        self.running.cancel()
        await asyncio.gather(self.running, return_exceptions=True)
        self.bridge = self.new_bridge()
        self.running = asyncio.create_task(self.bridge.run())

    def station(self, key: bytes = KEY) -> BridgeLink:
        config = BridgeLinkConfig(remote=ADDRESS, connect_timeout_s=0.5)
        return BridgeLink(config, thrust_max_n=2.0, key=key, nonce=nonce)

    async def flies_again(self) -> None:
        """Arm, and see that a command of half the thrust is obeyed."""
        await self.link.arm(idle)
        await self.stream(1.0, 0.2)
        assert self.thrust == pytest.approx(0.5, abs=2e-3)

    def lifted_s(self) -> list[float]:
        """When the vehicle was told to lift [s]."""
        return [time_s for time_s, share, _ in self.vehicle.acts if share > 0.0]

    async def leave(self) -> None:
        self.network.lose = lambda datagram: False
        await self.link.close()
        for task in (self.running, self._peer):
            task.cancel()
        await asyncio.gather(self.running, self._peer, return_exceptions=True)


@in_virtual_time
async def test_a_bridge_with_a_real_module_hears_no_station_on_its_own_machine() -> None:
    async with room(connected=False, remote_only=True) as it:
        with pytest.raises(LinkLost, match="no answer"):
            await it.link.connect()
        (says,) = (line for line in it.said if "not heard" in line)
        assert says.startswith("a station on this machine (127.0.0.1) is not heard: ")
        assert says.endswith("link.kind = 'dsm' and link.port")
        assert it.bridge.dropped["from_this_machine"] > 2
        assert not it.receiver.armed


@contextlib.asynccontextmanager
async def room(
    *, connected: bool = True, armed: bool = False, remote_only: bool = False
) -> AsyncIterator[Room]:
    it = Room(remote_only=remote_only)
    try:
        if connected:
            await it.link.connect()
        if armed:
            await it.link.arm(idle)
        yield it
    finally:
        await it.leave()


async def soon() -> None:
    await asyncio.sleep(2.0 * MODULE.period_s)


@in_virtual_time
async def test_another_sessions_datagrams_do_nothing_in_this_one() -> None:
    async with room(armed=True) as it:
        await it.stream(1.5, 0.3)
        recorded = list(it.network.seen)
        await it.link.close()
        await it.restart()
        await it.link.connect()
        acts = len(it.vehicle.acts)
        for each in recorded:
            it.network.again(each)
        await asyncio.sleep(1.0)
        assert not it.receiver.armed
        assert len(it.vehicle.acts) == acts
        assert it.bridge.dropped["other_session"] > 10
        assert it.link.status.state == "connected"


@in_virtual_time
async def test_without_the_key_nothing_is_answered() -> None:
    async with room() as it:
        stranger = it.station(key=bytes(reversed(KEY)))
        with pytest.raises(LinkLost, match="with the same key"):
            await stranger.connect()
        assert it.bridge.dropped["bad_seal"] > 5
        assert it.link.status.state == "connected"


@in_virtual_time
async def test_a_datagram_changed_in_any_byte_is_dropped() -> None:
    async with room(armed=True) as it:
        await it.stream(1.5, 0.1)
        await it.link.kill()
        source, target, data = it.network.ups()[-1]
        counter = int.from_bytes(data[13:21], "big") + 1000
        newer = data[:13] + counter.to_bytes(8, "big") + data[21:]
        for at in range(len(newer)):
            changed = newer[:at] + bytes((newer[at] ^ 1,)) + newer[at + 1 :]
            it.network.again((source, target, changed))
        it.network.again((source, target, newer))
        await asyncio.sleep(0.1)
        assert sum(it.bridge.dropped.values()) > len(newer)
        assert it.link.status.state == "connected"
        await it.link.arm(idle)


@in_virtual_time
async def test_whoever_delays_datagrams_makes_no_command_live_longer() -> None:
    loop = asyncio.get_running_loop()
    async with room(armed=True) as it:
        await it.stream(1.0, 0.3)
        it.network.delay_s = lambda datagram: 0.4 * (kind_of(datagram[2]) == DatagramKind.UP)
        it.vehicle.acts.clear()
        last = loop.time()
        await it.stream(1.5, 0.5)
        await asyncio.sleep(2.0)
        assert not it.receiver.armed
        assert max(share for _, share, _ in it.vehicle.acts) == pytest.approx(0.5, abs=2e-3)
        assert it.lifted_s()[-1] < last + 0.25 + DOWN.duration_s + 0.02


@in_virtual_time
async def test_a_network_that_fails_is_brought_down_by_the_bridge_and_comes_back_disarmed() -> None:
    async with room(armed=True) as it:
        await it.stream(1.0, 0.3)
        it.network.lose = lambda datagram: True
        await it.stream(1.0, 0.4)
        assert it.thrust == pytest.approx(0.4, abs=2e-3), "its bring-down"
        await it.stream(1.0, 1.2)
        assert not it.receiver.armed
        assert it.link.status.state == "lost"
        assert "is not heard" in it.link.status.text
        now_s = asyncio.get_running_loop().time()
        assert it.receiver.heard_s == pytest.approx(now_s, abs=0.03), "still disarming"
        it.network.lose = lambda datagram: False
        await it.stream(1.0, 2.0)
        assert it.link.status.state == "connected"
        assert not it.receiver.armed
        await it.flies_again()


@pytest.mark.parametrize("both_ways", [False, True])
@in_virtual_time
async def test_a_network_that_comes_back_or_fails_one_way_does_not_cut_a_bring_down_short(
    both_ways: bool,
) -> None:
    loop = asyncio.get_running_loop()
    async with room(armed=True) as it:
        await it.stream(1.0, 0.3)
        down = (Segment(1.5, 0.8, (0.0, 0.0, 0.0)),)
        assert it.link.send(command(1.0, bring_down=down))
        await asyncio.sleep(it.link.period_s)
        it.network.lose = lambda datagram: both_ways or kind_of(datagram[2]) != DatagramKind.UP
        it.vehicle.acts.clear()
        failed_s, until_s = loop.time(), loop.time() + 3.5
        while loop.time() < until_s:
            if loop.time() > failed_s + 1.1:
                it.network.lose = lambda datagram: False
            it.link.send(command(1.0, bring_down=down))
            await asyncio.sleep(it.link.period_s)
        lifted = it.lifted_s()
        held = 0.0 if both_ways else SILENT_S
        assert lifted[-1] == pytest.approx(failed_s + held + 0.25 + 1.5, abs=0.25)
        assert all(share > 0.0 for time_s, share, _ in it.vehicle.acts if time_s < lifted[-1])
        assert not it.receiver.armed


@pytest.mark.parametrize("share", [0.1, 0.5])
@in_virtual_time
async def test_orders_arrive_over_a_network_that_loses_much(share: float) -> None:
    luck = itertools.cycle([k * 0.618034 % 1.0 < share for k in range(997)])
    async with room() as it:
        it.network.lose = lambda datagram: next(luck)
        await it.link.arm(idle)
        await it.stream(1.0, 1.0)
        assert it.receiver.armed
        assert it.thrust == pytest.approx(0.5, abs=2e-3)
        killed = asyncio.create_task(it.link.kill())
        await asyncio.sleep(0.1)
        assert not it.receiver.armed
        await killed
        await it.link.arm(idle)
        await it.stream(1.0, 0.2)
        await it.link.close()
        assert not it.receiver.armed


@in_virtual_time
async def test_one_station_commands_and_another_only_after_it_has_left() -> None:
    async with room(armed=True) as it:
        second = it.station()
        flying = asyncio.create_task(it.stream(1.0, 2.0))
        with pytest.raises(LinkRejected, match="obeys another station"):
            await second.connect()
        assert it.thrust == pytest.approx(0.5, abs=2e-3)
        await flying
        await it.link.close()
        await second.connect()
        assert second.status.state == "connected"
        await second.arm(idle)
        with pytest.raises(LinkRejected, match="obeys another station"):
            await it.link.connect()
        await second.close()


@in_virtual_time
async def test_a_station_that_fell_silent_is_followed_by_another_once_the_vehicle_is_down() -> None:
    async with room(armed=True) as it:
        assert it.link.send(command(1.0, bring_down=(Segment(1.5, 0.8, (0.0, 0.0, 0.0)),)))
        first = it.network.ups()[-1][0]
        it.network.lose = lambda datagram: first in datagram[:2]
        await asyncio.sleep(SILENT_S + 0.1)
        assert it.thrust == pytest.approx(0.4, abs=2e-3)
        second = it.station()
        with pytest.raises(LinkRejected, match="brings a vehicle down"):
            await second.connect()
        assert it.thrust == pytest.approx(0.4, abs=2e-3)
        await asyncio.sleep(0.5)
        await second.connect()
        await second.arm(idle)
        await second.close()


@in_virtual_time
async def test_a_bridge_that_is_started_again_is_found_again_and_nothing_is_armed() -> None:
    async with room(armed=True) as it:
        await it.stream(1.0, 0.3)
        await it.restart()
        await it.stream(1.0, 3.5)
        assert it.link.status.state == "connected"
        assert not it.receiver.armed
        await it.flies_again()


@in_virtual_time
async def test_a_plug_pulled_at_the_bridge_is_told_at_the_station() -> None:
    async with room(armed=True) as it:
        it.wire.cut = True
        await it.stream(1.0, 0.5)
        assert it.link.status.state == "lost"
        why = "on the bridge: cannot open the simulated port: it is unplugged"
        assert why in it.link.status.text
        it.wire.cut = False
        await it.stream(1.0, 2.0)
        assert it.link.status.state == "connected"
        assert any("unplugged" in line for line in it.said)
        assert "the port is back, disarmed" in it.said


@in_virtual_time
async def test_a_bridge_tells_once_that_the_pacers_stand_by_brings_down() -> None:
    async with room(armed=True) as it:
        await it.stream(0.5, 0.2)
        assert it.wire.pacer is not None
        it.wire.pacer.strike()
        await asyncio.sleep(2.0)
        (told,) = (line for line in it.said if "stand-by has taken over" in line)
        assert told.startswith("the pacer was killed; its stand-by has taken over")


@in_virtual_time
async def test_a_pacer_and_a_stand_by_that_die_at_the_bridge_are_started_again() -> None:
    async with room(armed=True) as it:
        await it.stream(1.0, 0.3)
        pacer: Any = it.wire.pacer
        pacer._task.cancel()
        it.bridge._pacer._take_report(None)
        await it.stream(1.0, 0.05)
        assert not it.link.send(command(1.0))
        assert "being started again" in it.link.status.text
        assert not it.receiver.armed, "the new one begins at once, and disarmed"
        assert "the vehicle is disarmed" not in it.said
        await it.stream(1.0, 1.0)
        ended, down = "the pacer ended: starting it again, disarmed", "the vehicle is disarmed"
        assert it.said.index(ended) < it.said.index(down)
        assert it.link.status.state == "connected"
        assert not it.receiver.armed
        await it.flies_again()


@in_virtual_time
async def test_a_bridge_that_ends_takes_no_command_any_more_and_tells_the_station() -> None:
    async with room(armed=True) as it:
        loop = asyncio.get_running_loop()
        await it.stream(1.0, 0.3)
        it.vehicle.acts.clear()
        ended = loop.time()
        it.running.cancel()
        await it.stream(1.5, 0.1)
        assert not it.link.send(command(1.5))
        assert it.link.status.phase == "fresh"
        assert "commands count no more" in it.link.status.text
        await it.stream(1.5, 1.5)
        assert it.running.done()
        assert not it.receiver.armed
        most = max(share for _, share, _ in it.vehicle.acts)
        assert most == pytest.approx(0.5, abs=2e-3), "the one it held"
        assert it.lifted_s()[-1] < ended + 0.25 + DOWN.duration_s + MODULE.period_s
        it.running = asyncio.create_task(asyncio.sleep(0.0))  # nothing is left to end


@in_virtual_time
async def test_a_bridge_whose_pacers_stand_still_ends_all_the_same() -> None:
    async with room(armed=True) as it:
        pacer: Any = it.wire.pacer
        pacer.lose_commander(stopped=True)
        it.running.cancel()
        async with asyncio.timeout(5.0):
            await asyncio.wait([it.running])
        assert it.running.cancelled()


@in_virtual_time
async def test_the_operator_of_the_bridge_can_stop_the_motors() -> None:
    async with room(armed=True) as it:
        await it.stream(1.0, 0.3)
        it.bridge.kill()
        await it.stream(1.0, 0.1)
        assert not it.receiver.armed
        assert it.link.status.state == "connected"
        assert not it.link.send(command())


# ---- clocks


class AnotherClock:
    """The event loop as a machine that was started at another time sees it."""

    def __init__(self, shift_s: float) -> None:
        self._loop = asyncio.get_running_loop()
        self._shift = shift_s

    def time(self) -> float:
        return self._loop.time() + self._shift

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loop, name)


@pytest.mark.parametrize("shift_s", [-7654.3, 0.0, 1e6])
@in_virtual_time
async def test_deadlines_hold_whatever_the_other_machines_clock_shows(shift_s: float) -> None:
    loop = asyncio.get_running_loop()
    it = Room()
    it.network.delay_s = lambda datagram: 0.04
    reports: list[PacerReport | None] = []
    station = RemotePacer(ADDRESS, 2.0, 0.0, KEY, nonce, reports.append)
    station._loop = AnotherClock(shift_s)  # type: ignore[assignment]  # a loop in all that is used
    await station.open(0.5)
    here = loop.time() + shift_s
    station.give(Arm(1, here))
    for _ in range(80):
        here = loop.time() + shift_s
        station.give(Give(1, Command(1.0, (0.0, 0.0, 0.0), 1, here, here + 0.25)))
        await asyncio.sleep(0.02)
    assert it.thrust == pytest.approx(0.5, abs=2e-3)
    last_s = loop.time() - 0.02 + 0.25
    await asyncio.sleep(1.0)
    lifted = it.lifted_s()
    assert last_s - 0.04 - MODULE.period_s < lifted[-1] <= last_s + MODULE.frame_s + 1e-6
    newest = reports[-1]
    assert newest is not None and newest.now_s == pytest.approx(loop.time() + shift_s, abs=0.25)
    assert newest.note.endswith("; bridge answers in 80.0 ms")
    station.forget()
    await it.leave()


# ---- bytes


@given(st.binary(max_size=300))
@in_virtual_time
async def test_no_bytes_at_all_make_either_side_raise(data: bytes) -> None:
    async with room() as it:
        station = it.network.ups()[-1][0]
        bridge = parse_address(ADDRESS)
        for head in (b"", *(b"RFB1" + bytes((kind,)) for kind in range(6))):
            it.network.again((station, bridge, head + data))
            it.network.again((bridge, station, head + data))
        await soon()
        assert it.link.status.state == "connected"


def test_a_seal_opens_what_it_closed_once_and_in_order() -> None:
    ours, theirs = (Seal(KEY, DatagramKind.UP, b"12345678") for _ in range(2))
    dropped = Counter[str]()
    first, second = ours.close(Up(1.0, 2.0, 3.0)), ours.close(Up(2.0, 2.0, 3.0))
    assert theirs.open(second, UPS, dropped) == Up(2.0, 2.0, 3.0)
    assert theirs.open(first, UPS, dropped) is None
    assert theirs.open(second, UPS, dropped) is None
    assert dropped == {"replayed_or_late": 2}
