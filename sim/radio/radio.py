"""Simulated radio: a scenario's serial link, the bridge that stands before it, and the receiver on board.

- The wire takes its time: a byte is there when its 10 bits have passed, and a frame counts when it is complete.
- The last frame is held. After ``FAILSAFE_S`` without one the motors stop, until it is armed anew.
- It arms when the arm channel goes up with the throttle down, having been seen down; it disarms when that goes down.
  Where the map has no such channel it is armed once the throttle was seen down.
- Frames that bind move nothing.
"""

import asyncio
from collections.abc import Callable
from typing import Any

import msgspec

from groundstation.config import from_dict
from groundstation.core.vehicle import Vehicle
from groundstation.settings import Config
from links.bridge import Bridge, BridgeConfig, BridgeLinkConfig
from links.rf import RF_CODECS, Channels, RfConfig, RfFrame, RfLinkConfig, Service
from sim.radio.inline_pacer import MODULE, WirePort, opened_on
from sim.world import Airframe, World

KINDS = (*RF_CODECS, "rf_bridge")
"""Every link that ends at a radio's receiver."""
BEHIND_BRIDGE = "dsm"
"""The module that a simulated bridge has."""
FASTEST_STICK_DEG_S = 720.0
"""Body rate at full stick where the vehicle has no limit [deg/s]: a stick has few steps."""
KEY = bytes(range(32))
"""What a simulated station and bridge share."""


def section(kind: str, world: World, told: Vehicle) -> dict[str, Any]:
    """The link's section of a configuration; full stick is the vehicle's limit."""
    if kind == "rf_bridge":
        return {"kind": kind}
    rates = dict(zip(("roll", "pitch", "yaw"), told.rate_limits_deg_s, strict=True))
    order = RF_CODECS[kind]().map
    sticks = {
        axis: {**msgspec.to_builtins(getattr(order, axis)), "full_rate_deg_s": min(rate, FASTEST_STICK_DEG_S)}
        for axis, rate in rates.items()
    }
    sticks["arm"] = {"channel": 5}
    return {
        "kind": kind,
        "period_s": world.frame_period_s,
        "lead_s": min(0.005, 0.25 * world.frame_period_s),
        "map": sticks,
    }


def module(config: Config, world: World) -> RfConfig:
    """The module that the commands of ``config`` leave by in the end."""
    if isinstance(config.link, RfConfig):
        return config.link
    found = from_dict({"link": section(BEHIND_BRIDGE, world, config.vehicle)}, Config).link
    assert isinstance(found, RfConfig), "this section is a module's"
    return found


def wires(
    config: Config, radio: RfConfig, nonce: Callable[[int], bytes], port: WirePort
) -> tuple[dict[str, Any], Bridge | None]:
    """What the link of ``config`` gets in the place of hardware, and the bridge to run beside it, if it wants one.

    ``port`` is the wire to the module.
    """
    open_pacer = opened_on(port)
    if not isinstance(config.link, BridgeLinkConfig):
        return {"open_pacer": open_pacer}, None
    bridge = Bridge(BridgeConfig(listen=config.link.remote, link=radio), KEY, open_pacer=open_pacer, nonce=nonce)
    return {"key": KEY, "nonce": nonce}, bridge


FAILSAFE_S = 1.0
"""How long the last frame is held [s]."""
THROTTLE_DOWN = 0.02
"""Thrust below this share counts as none."""
GAP_FRAMES = 0.6
"""The wire silent for so many periods ends a frame that was begun."""


class RfReceiver:
    """Flies one ``airframe``. Sans-IO; times are on the event loop's clock [s] and never go backwards."""

    def __init__(self, airframe: Airframe, config: RfLinkConfig, *, lose: Callable[[], bool] = lambda: False) -> None:
        """``lose`` tells of each frame whether it got lost on the air."""
        codec = config.codec()
        self.decoder = codec.decoder()
        self.armed = False
        self.failsafe = False
        """True from frames that stopped until the next one."""
        self.frames = 0
        """Frames of channels that were understood."""
        self.services: list[Service] = []
        """What it was told to do beside flying, one entry a frame."""
        self.heard_s: float | None = None
        """When the newest frame of channels was complete."""
        # The throttle's share of its throw is the motors' signal; what thrust that gives the airframe knows.
        self._channels = Channels(config.with_thrust_curve(0.0).map, count=codec.channels, thrust_max_n=1.0)
        self._has_switch = config.map.arm is not None
        self._may_arm = not self._has_switch
        self._airframe = airframe
        self._lose = lose

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes whose last one is complete now."""
        for heard in self.decoder.feed(data):
            self._take(heard, now_s)

    def watch(self, now_s: float) -> None:
        """Look whether frames have stopped."""
        if not self.failsafe and self.heard_s is not None and now_s - self.heard_s >= FAILSAFE_S - 1e-9:
            self.failsafe = True
            self._power(False, now_s)

    def _take(self, heard: RfFrame, now_s: float) -> None:
        if heard.service is not None:
            self.services.append(heard.service)
        if heard.positions is None or heard.service is Service.BIND:
            return
        self.frames += 1
        self.heard_s = now_s
        if self._lose():
            return
        self.failsafe = False
        sticks = self._channels.read(heard.positions)
        down = sticks.thrust_n <= THROTTLE_DOWN
        if not sticks.armed:
            self._may_arm = True
            self._power(False, now_s)
        elif not self.armed and self._may_arm and down:
            self._power(True, now_s)
        if self.armed:
            self._airframe.act(now_s, sticks.thrust_n, sticks.rates_rad_s)
            if not down:
                self._airframe.release(now_s)

    def _power(self, on: bool, now_s: float) -> None:
        if on != self.armed:
            self.armed = on
            self._airframe.power(now_s, on)
            if not on:
                self._may_arm = not self._has_switch


class RfPeer(asyncio.DatagramProtocol):
    """Brings bytes to a receiver as late as wire and air do; on the real and on the virtual loop alike."""

    def __init__(self, receiver: RfReceiver, config: RfLinkConfig, air_s: float = 0.0) -> None:
        """Silent until bytes arrive; ``air_s`` is what module and radio take beside the wire [s]."""
        self.receiver = receiver
        self._byte_s = 10.0 / config.baud
        self._gap_s = GAP_FRAMES * config.period_s
        self._free_s, self._air_s = 0.0, air_s
        self.overhear: Callable[[float, bytes], None] | None = None
        """Sees all bytes as they begin to come, and when [s]."""
        self._watch: asyncio.TimerHandle | None = None
        self._end: asyncio.Future[None] | None = None

    async def run(self) -> None:
        """Listen at :data:`sim.radio.inline_pacer.MODULE` on the network in memory, until cancelled."""
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(lambda: self, local_addr=MODULE)
        try:
            await self.last()
        finally:
            transport.abort()

    async def last(self) -> None:
        """Live until cancelled; raises what the vehicle raises."""
        self._end = asyncio.get_running_loop().create_future()
        try:
            await self._end
        finally:
            if self._watch is not None:
                self._watch.cancel()

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take bytes that begin to leave the other end now (called by the event loop)."""
        loop = asyncio.get_running_loop()
        now = loop.time()
        if self.overhear is not None:
            self.overhear(now, data)
        if now > self._free_s + self._gap_s:
            self.receiver.decoder.pause()
        self._free_s = max(self._free_s, now) + self._byte_s * len(data)
        loop.call_at(self._free_s + self._air_s, self._complete, data)

    def _complete(self, data: bytes) -> None:
        loop = asyncio.get_running_loop()
        try:
            self.receiver.receive(data, loop.time())
        except Exception as error:  # noqa: BLE001  # last() raises it
            self._fail(error)
        if self._watch is not None:
            self._watch.cancel()
        self._watch = loop.call_later(FAILSAFE_S, self._look)

    def _look(self) -> None:
        try:
            self.receiver.watch(asyncio.get_running_loop().time())
        except Exception as error:  # noqa: BLE001  # last() raises it
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        if self._end is not None and not self._end.done():
            self._end.set_exception(error)
