"""Simulated radio: a serial link's wire, pacer and bridge, and the receiver on board, at exact
instants.

- The pacer lets the very frames go of the process that paces in real time.
- The wire takes its time: a byte is there when its 10 bits have passed, and a frame counts when it
  is complete.
- The last frame is held. After ``FAILSAFE_S`` without one the motors stop, until it is armed anew.
- It arms when the arm channel goes up with the throttle down, having been seen down; it disarms
  when that goes down. Where the map has no such channel it is armed once the throttle was seen
  down.
- Frames that bind move nothing.
- Attitudes come back through a CRSF module as Betaflight tells them: in tenths of a degree, nose
  down counting up.
"""

import asyncio
import contextlib
import errno
import math
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import msgspec

from groundstation.config import from_dict, refuse_value
from groundstation.core.geometry import Quat, so3
from groundstation.core.vehicle import Vehicle
from groundstation.machine import sleep_until
from groundstation.settings import Config
from links.bridge import BridgeLinkConfig
from links.core import LOOK_S
from links.io import KEY_BYTES, NETWORK, read_key
from links.rf import (
    RF_CODECS,
    Channels,
    FramePacer,
    Give,
    OpenPacer,
    Order,
    PacerReport,
    RfConfig,
    RfLinkConfig,
    Service,
    StandbyWatch,
    describe_pulses,
    encode_attitude,
)
from sim.world import Airframe, World

if TYPE_CHECKING:
    from links.bridge import Bridge

MODULE = ("module", 1)
"""Where the simulated module listens, on the loop's network in memory."""
STATION = ("station", 1)
"""Where its frames come from."""


class WirePort(asyncio.DatagramProtocol):
    """Implements :class:`links.rf.pacer.Port`: a wire to :data:`MODULE`, a datagram a frame."""

    def __init__(self) -> None:
        """Nothing is opened yet; ``attach`` first."""
        self.cut = False
        """True while the plug is out."""
        self.pacer: InlinePacer | None = None
        """Whoever lets frames go here, or did last; None before the first."""
        self._transport: asyncio.DatagramTransport | None = None
        self._came = b""

    async def attach(self) -> None:
        """Get a place on the network in memory."""
        self._transport, _ = await NETWORK.get().open_datagram(lambda: self, STATION, MODULE)

    def detach(self) -> None:
        """Give it back."""
        if self._transport is not None:
            self._transport.abort()
            self._transport = None

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Take what the module says (called by the event loop)."""
        self._came += data

    def open(self) -> None:
        """Raises OSError while the plug is out."""
        self._wire()

    def write(self, frame: bytes) -> bool:
        """Send one frame."""
        self._wire().sendto(frame)
        return True

    def read(self, limit: int) -> bytes:
        """Bytes received since the last read, at most ``limit``."""
        self._wire()
        data, self._came = self._came[:limit], b""
        return data

    def close(self) -> None:
        """Nothing to do: the wire is the simulation's."""

    def _wire(self) -> asyncio.DatagramTransport:
        if self.cut or self._transport is None:
            raise OSError(errno.ENODEV, "cannot open the simulated port: it is unplugged")
        return self._transport


class InlinePacer:
    """Implements :class:`links.rf.pacer.Pacer`."""

    why_mute = "the simulated pacer has failed"

    def __init__(
        self,
        config: RfLinkConfig,
        thrust_max_n: float,
        port: WirePort,
        on_report: Callable[[PacerReport | None], None],
    ) -> None:
        self.manner = config.manner
        self._loop = asyncio.get_running_loop()
        self._period, self._frame_s = config.period_s, 1.01 * config.frame_s
        self._config, self._thrust_max = config, thrust_max_n
        self._port = port
        self._on_report = on_report
        self._pacer = FramePacer(config, thrust_max_n, port, self._loop.time())
        self._struck: tuple[float, str] | None = None
        self._waiting: list[Order] = []
        self._deserted = False
        self._task = asyncio.create_task(self._pace())

    def report(self) -> PacerReport:
        """As it is now."""
        return self._pacer.report(self._loop.time(), note="simulated")

    def give(self, order: Order) -> bool:
        """Hand over ``order``."""
        if self._task.done():
            return False
        if self._deserted:
            return True
        if self._struck is None:
            self._pacer.order(order, self._loop.time())
        elif not isinstance(order, Give):
            self._waiting.append(order)
        return True

    def strike(self, *, stopped: bool = False) -> None:
        """The pacer dies, or only stands still: its stand-by lets frames go as soon as it would
        know of it.
        """
        knows_s = self._loop.time() + (
            StandbyWatch(self._period).wait_s + LOOK_S if stopped else 0.0
        )
        self._struck = (
            knows_s,
            "the pacer stood still and was ended" if stopped else "the pacer was killed",
        )

    def lose_commander(self, *, stopped: bool = False) -> None:
        """Whoever commands dies, or only stands still: nothing more is heard of it."""
        self._deserted = True
        if not stopped:
            self._pacer.outlive_commander(self._loop.time())

    async def wait_for_end(self) -> None:
        """Wait until it has ended."""
        await asyncio.wait([self._task])

    def forget(self) -> None:
        """End at once: the simulation ends here too."""
        self._task.cancel()
        self._port.detach()

    async def _pace(self) -> None:
        pacer, loop = self._pacer, self._loop
        due = loop.time() + self._period
        pacer.prepare(due)
        held = pacer.make_estate()
        while not pacer.done(loop.time()):
            await sleep_until(due)
            if self._struck is not None:
                if due < self._struck[0]:
                    due += self._period
                    continue
                pacer = self._pacer = FramePacer(
                    self._config, self._thrust_max, self._port, loop.time()
                )
                pacer.inherit(held, self._struck[1], loop.time())
                self._struck = None
                for order in self._waiting:
                    pacer.order(order, loop.time())
            pacer.prepare(due)
            held = pacer.make_estate()
            pacer.leave(loop.time())
            pacer.count_frame(loop.time(), 0)
            pacer.tidy(loop.time())
            due += self._period + pacer.steer()
            if pacer.has_news(loop.time()):
                self._on_report(self.report())
        await sleep_until(loop.time() + self._frame_s)  # the last frame arrives whole
        pacer.close()
        self._port.detach()


def opened_on(port: WirePort) -> OpenPacer:
    """Return a function that opens pacers on ``port``, the wire of a simulation."""

    async def open_pacer(
        config: RfLinkConfig, thrust_max_n: float, on_report: Callable[[PacerReport | None], None]
    ) -> InlinePacer:
        await port.attach()
        pacer = port.pacer = InlinePacer(config, thrust_max_n, port, on_report)
        on_report(pacer.report())
        return pacer

    return open_pacer


class PtyWire:
    """The far end of a port; the near end's path is ``path``.

    The path is of its own, and leads to what this process holds open. The system's name for the
    terminal belongs to somebody else's soon after this one is closed, be it by a kill that leaves
    the path behind; a link that opens its port again and again, as all do, would take that and
    write into it.
    """

    def __init__(self, path: Path | None = None) -> None:
        """Stand at ``path``, in the place of one that is left there.

        Without it, in a new folder.
        """
        import tempfile
        import termios  # only where there is a terminal
        import tty

        self._far, self._near = os.openpty()
        tty.setraw(self._near, termios.TCSANOW)
        os.set_blocking(self._far, False)
        self._folder = (
            tempfile.TemporaryDirectory(prefix="groundstation-port-") if path is None else None
        )
        place = Path(self._folder.name) / "port" if self._folder is not None else path
        assert place is not None, "one of both"
        self.path = str(place)
        if place.is_symlink():
            place.unlink()
        place.symlink_to(f"/proc/{os.getpid()}/fd/{self._near}")

    def listen(self, take: Callable[[bytes], None]) -> None:
        """Call ``take`` with whatever is written to the port, until closed."""

        def readable() -> None:
            try:
                data = os.read(self._far, 4096)
            except OSError:
                return
            take(data)

        asyncio.get_running_loop().add_reader(self._far, readable)

    def fileno(self) -> int:
        """The far end's file descriptor."""
        return self._far

    def sendto(self, data: bytes) -> None:
        """Write to whoever has the port open; what does not fit is lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._far, data)

    def abort(self) -> None:
        """Stay: whoever has made it closes it."""

    def close(self) -> None:
        """Pull the plug; the path goes away."""
        if self._far >= 0:
            Path(self.path).unlink(missing_ok=True)
            if self._folder is not None:
                self._folder.cleanup()
            asyncio.get_running_loop().remove_reader(self._far)
            os.close(self._near)
            os.close(self._far)
            self._far = self._near = -1


KINDS = (*RF_CODECS, "rf_bridge")
"""Every link that ends at a radio's receiver."""
BEHIND_BRIDGE = "dsm"
"""The module that a simulated bridge has."""
FASTEST_STICK_DEG_S = 720.0
"""Body rate at full stick where the vehicle has no limit [deg/s]: a stick has few steps."""
KEY = bytes(range(KEY_BYTES))
"""Key shared by a simulated station and bridge."""


def section(kind: str, world: World, told: Vehicle, *, betaflight: bool = False) -> dict[str, Any]:
    """The link's section of a configuration; full stick is the vehicle's limit.

    For Betaflight a stick that is up means nose down, and its throttle begins at ``min_check``,
    1010 of 1000 to 2000.
    """
    if kind == "rf_bridge":
        return {"kind": kind}
    rates = dict(zip(("roll", "pitch", "yaw"), told.rate_limits_deg_s, strict=True))
    order = RF_CODECS[kind]().map
    sticks = {
        axis: {
            **msgspec.to_builtins(getattr(order, axis)),
            "full_rate_deg_s": min(rate, FASTEST_STICK_DEG_S),
        }
        for axis, rate in rates.items()
    }
    sticks["arm"] = {"channel": 5}
    if betaflight:
        sticks["pitch"]["reverse"] = True
        sticks["thrust"] = {"channel": order.thrust.channel, "low": -0.98}
    return {
        "kind": kind,
        "period_s": world.frame_period_s,
        "lead_s": min(0.005, 0.25 * world.frame_period_s),
        "map": sticks,
    }


def module(config: Config, world: World, *, betaflight: bool = False) -> RfConfig:
    """The module that the commands of ``config`` leave by in the end."""
    if isinstance(config.link, RfConfig):
        return config.link
    found = from_dict(
        {"link": section(BEHIND_BRIDGE, world, config.vehicle, betaflight=betaflight)}, Config
    ).link
    assert isinstance(found, RfConfig), "this section is a module's"
    return found


def wires(
    config: Config, radio: RfConfig, nonce: Callable[[int], bytes], port: WirePort
) -> tuple[dict[str, Any], "Bridge | None"]:
    """Return simulated hardware for the link of ``config``, and the bridge to run beside it, or
    None.

    ``port`` is the wire to the module.
    """
    open_pacer = opened_on(port)
    if not isinstance(config.link, BridgeLinkConfig):
        return {"open_pacer": open_pacer}, None
    from links.bridge import Bridge, BridgeConfig  # only where there is one

    bridge = Bridge(
        BridgeConfig(listen=config.link.remote, link=radio), KEY, open_pacer=open_pacer, nonce=nonce
    )
    return {"key": KEY, "nonce": nonce}, bridge


def bridge_to(link: BridgeLinkConfig, radio: RfConfig, pty: PtyWire) -> "Bridge":
    """The bridge that ``link`` looks for, in real time; its module is at ``pty``.

    Raises:
        ConfigError: the key can't be used.
    """
    from links.bridge import Bridge, BridgeConfig  # only where there is one

    with refuse_value("link.key_file"):
        key = read_key(Path(link.key_file))
    there = msgspec.structs.replace(radio, port=pty.path, simulated=True)
    return Bridge(BridgeConfig(listen=link.remote, key_file=link.key_file, link=there), key)


FAILSAFE_S = 1.0
"""Time for which the receiver holds the last frame [s]."""
THROTTLE_DOWN = 0.02
"""Thrust below this share counts as none."""
DOWNLINK_S = 0.03
"""Latency of the downlink [s]: telemetry waits for slots of the radio."""
GAP_FRAMES = 0.6
"""The wire silent for so many periods ends a frame that was begun."""


class Receiver:
    """Hears a module's frames on board.

    Sans-IO; times are on the event loop's clock [s] and never go backwards.
    """

    def __init__(self, config: RfLinkConfig, *, lose: Callable[[], bool] = lambda: False) -> None:
        """``lose`` tells of each frame whether it got lost on the air."""
        self.decoder = config.codec().decoder()
        self.failsafe = False
        """True from frames that stopped until the next one."""
        self.frames = 0
        """Frames of channels that were understood."""
        self.services: list[Service] = []
        """Services requested, one entry a frame."""
        self.heard_s: float | None = None
        """When the newest frame of channels was complete."""
        self._lose = lose

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes whose last one is complete now."""
        for heard in self.decoder.feed(data):
            if heard.service is not None:
                self.services.append(heard.service)
            if heard.positions is None or heard.service is Service.BIND:
                continue
            self.frames += 1
            self.heard_s = now_s
            if not self._lose():
                self.failsafe = False
                self._obey(heard.positions, now_s)

    def watch(self, now_s: float) -> None:
        """Look whether frames have stopped."""
        if (
            not self.failsafe
            and self.heard_s is not None
            and now_s - self.heard_s >= FAILSAFE_S - 1e-9
        ):
            self.failsafe = True
            self._fail(now_s)

    def _obey(self, positions: Sequence[float], now_s: float) -> None:
        raise NotImplementedError

    def _fail(self, now_s: float) -> None:
        raise NotImplementedError


class RfReceiver(Receiver):
    """With a flight controller in it: flies one ``airframe``."""

    def __init__(
        self, airframe: Airframe, config: RfLinkConfig, *, lose: Callable[[], bool] = lambda: False
    ) -> None:
        super().__init__(config, lose=lose)
        self.armed = False
        # The throttle's share of its throw is the motors' signal; what thrust that gives the
        # airframe knows.
        count = config.codec().channels
        self._channels = Channels(config.with_thrust_curve(0.0).map, count=count, thrust_max_n=1.0)
        self._has_switch = config.map.arm is not None
        self._may_arm = not self._has_switch
        self._airframe = airframe

    def _fail(self, now_s: float) -> None:
        self._power(False, now_s)

    def _obey(self, positions: Sequence[float], now_s: float) -> None:
        sticks = self._channels.read(positions)
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


Failsafe: TypeAlias = Literal["hold", "cut", "invalid"]
"""Output of a receiver once frames have stopped: its last pulses for ever, nothing, or pulses that
mean nothing."""


class PulseReceiver(Receiver):
    """Gives a flight controller pulses, as receivers do: CRSF's 988 to 2012 µs, DSM's 988 and a
    count of 0 to 1023.

    Sources: TBS crsf-spec 1285bbc5, TICKS_TO_US; Betaflight 4.6, src/main/rx/spektrum.c, for 1024
        steps in 22 ms.
    """

    def __init__(
        self,
        give: Callable[[Sequence[float] | None], None],
        config: RfLinkConfig,
        *,
        lose: Callable[[], bool] = lambda: False,
    ) -> None:
        """``give`` takes the pulses of all channels [µs] with each frame, and None where there are
        none any more.
        """
        super().__init__(config, lose=lose)
        self._give = give
        self.failsafe_gives: Failsafe = "cut"
        """Output once frames have stopped; may be changed in flight."""
        self._half_us, _ = describe_pulses(config)
        self._count = config.codec().channels

    def _obey(self, positions: Sequence[float], now_s: float) -> None:
        self._give([1500.0 + self._half_us * at for at in positions])

    def _fail(self, now_s: float) -> None:
        if self.failsafe_gives != "hold":
            self._give(None if self.failsafe_gives == "cut" else [0.0] * self._count)


def attitude_frame(attitude: Quat) -> bytes:
    """The frame by which a module hands on how the vehicle lies, body FRD to NED."""
    roll, pitch, yaw = (
        math.radians(round(math.degrees(angle), 1)) for angle in so3.euler_zyx(attitude)
    )
    return encode_attitude(-pitch, roll, yaw)


class RfPeer(asyncio.DatagramProtocol):
    """Brings bytes to a receiver as late as wire and air do.

    On the real and on the virtual loop alike.
    """

    def __init__(self, receiver: Receiver, config: RfLinkConfig, air_s: float = 0.0) -> None:
        """Silent until bytes arrive.

        ``air_s`` is what module and radio take beside the wire [s].
        """
        self.receiver = receiver
        self._byte_s = 10.0 / config.baud
        self._gap_s = GAP_FRAMES * config.period_s
        self._free_s, self._air_s = 0.0, air_s
        self.overhear: Callable[[float, bytes], None] | None = None
        """Sees all bytes as they begin to come, and when [s]."""
        self._watch: asyncio.TimerHandle | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._end: asyncio.Future[None] | None = None

    async def tell(
        self, say: Callable[[bytes], None], feel: Callable[[float], Quat], rate_hz: float
    ) -> None:
        """``say`` how the vehicle lies, so often [Hz], until cancelled."""
        loop, due = asyncio.get_running_loop(), asyncio.get_running_loop().time()
        while True:
            due += 1.0 / rate_hz
            await sleep_until(due)
            loop.call_later(DOWNLINK_S + self._air_s, say, attitude_frame(feel(due)))

    def answer(self, data: bytes) -> None:
        """Say something to the pacer, on the network in memory."""
        if self._transport is not None:
            self._transport.sendto(data, STATION)

    async def run(self) -> None:
        """Listen at :data:`sim.radio.radio.MODULE` on the network in memory, until cancelled."""
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=MODULE)
        self._transport = transport
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
        self._tell(partial(self.receiver.receive, data))
        if self._watch is not None:
            self._watch.cancel()
        self._watch = asyncio.get_running_loop().call_later(
            FAILSAFE_S, self._tell, self.receiver.watch
        )

    def _tell(self, take: Callable[[float], None]) -> None:
        """Have the receiver take something now."""
        try:
            take(asyncio.get_running_loop().time())
        except Exception as error:  # noqa: BLE001  # last() raises it
            if self._end is not None and not self._end.done():
                self._end.set_exception(error)
