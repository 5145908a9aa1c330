"""Pacer and stand-by on pseudo-terminals: real processes killed and stopped, and their bytes."""

import asyncio
import contextlib
import os
import random
import signal
import sys
import tempfile
import termios
import time
import tty
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple, TypeVar

import pytest

from links.bridge import BridgeLink, BridgeLinkConfig
from links.core import Command, LinkLost, LinkMisuse, LinkStatus, Segment
from links.io import make_key
from links.rf import Channels, DsmLinkConfig, PacedLink, SerialRfLink
from links.rf.channel_map import ArmSwitch, ChannelMap, Sticks
from links.rf.pacer import AFTERLIFE_S
from links.rf.pacer_process import PacerProcess, open_process
from sim.radio import PtyWire
from tests.e2e.stamped_reader import StampedReader
from tests.e2e.stations import children_of, free_udp_port
from tests.loops import in_real_time, until

PERIOD_S = 0.02
COAST_S, DOWN_S = 0.25, 0.3
MAP = ChannelMap(arm=ArmSwitch(channel=5))
CHANNELS = Channels(MAP, count=6, thrust_max_n=2.0)
AT_ONCE_S = 0.002
"""No two frames of one writer, and no three of two, are so near [s]."""
GAP_S = 0.2
"""Longest time without a frame [s]: 60 ms, two looks, and what a busy machine adds."""


def is_gone(process: int) -> bool:
    return not Path(f"/proc/{process}").exists()


F = TypeVar("F", bound="Flight")


class Flight:
    """A link whose vehicle is flown by commands that are always fresh, and its frames."""

    def __init__(self) -> None:
        self.wire = PtyWire()
        self.seen: list[tuple[float, Sticks]] = []
        self._decoder = DsmLinkConfig().codec().decoder()
        config = DsmLinkConfig(
            port=self.wire.path, period_s=PERIOD_S, arm_low_s=0.0, arm_high_s=0.1, map=MAP
        )
        self.link: PacedLink = SerialRfLink(config, thrust_max_n=2.0)
        self.pacer = self.standby = 0
        self._sends: asyncio.Task[None] | None = None

    async def _read(self) -> None:
        while True:
            time_s, data = await self._reader.read()
            for heard in self._decoder.feed(data):
                assert heard.positions is not None
                self.seen.append((time_s, CHANNELS.read(heard.positions)))

    async def begin(self) -> None:
        self._reader = await StampedReader.start(self.wire.fileno())
        self._reads = asyncio.create_task(self._read())
        self.standby = await self._connect()
        (self.pacer,) = children_of(self.standby)
        await self.link.arm(command)
        self._sends = asyncio.create_task(self._send())

    async def _connect(self) -> int:
        """Connect; the stand-by."""
        await self.link.connect()
        pacer = self.link._watched.pacer
        assert isinstance(pacer, PacerProcess)
        return pacer._process.pid

    async def _send(self) -> None:
        while True:
            with contextlib.suppress(LinkMisuse):
                self.link.send(command(1.0))
            await asyncio.sleep(PERIOD_S)

    async def lost(self) -> None:
        await until(lambda: self.link.status.state == "lost")

    def fall_silent(self) -> None:
        """No more commands."""
        assert self._sends is not None
        self._sends.cancel()

    async def end(self) -> None:
        for each in (self.standby, self.pacer):
            with contextlib.suppress(ProcessLookupError):
                os.kill(each, signal.SIGCONT)
        if self._sends is not None:
            self._sends.cancel()
        await self.leave()
        await self._reader.close()
        await asyncio.gather(self._reads, return_exceptions=True)
        self.wire.close()

    async def leave(self) -> None:
        """Close the link."""
        await self.link.close()

    def sent(self, since_s: float) -> list[Sticks]:
        return [sticks for time_s, sticks in self.seen if time_s > since_s]

    def is_one_writers(self) -> None:
        """Every frame whole, never more than one a period, and no lift after one without it."""
        assert not self._decoder.dropped
        # Six frames of one writer take five periods, less what the first of them was late by; of
        # two, two and a half.
        times = [time_s for time_s, _ in self.seen]
        for k in range(len(times) - 5):
            six = times[k : k + 6]
            # Three that are read at once were held up on their way: when they left is not known.
            if all(sum(abs(one - other) < AT_ONCE_S for other in six) < 3 for one in six):
                assert six[-1] - six[0] > 2.75 * PERIOD_S, "six as quick as those of two writers"
        thrusts = [sticks.thrust_n for _, sticks in self.seen]
        flown = thrusts[next(k for k, thrust in enumerate(thrusts) if thrust > 0.9) :]
        ranks = [2 if thrust > 0.9 else 1 if thrust > 0.1 else 0 for thrust in flown]
        assert ranks == sorted(ranks, reverse=True), "a frame lifts more than the one before"

    def is_down(self) -> None:
        last = self.seen[-1][1]
        assert not last.armed
        assert last.thrust_n == 0.0


class Bridged(Flight):
    """The same by a bridge, a program of its own."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        key = folder / "bridge.key"
        make_key(key)
        self._config = folder / "bridge.toml"
        address = f"127.0.0.1:{free_udp_port()}"
        self._config.write_text(
            BRIDGE.format(address=address, key=key, port=self.wire.path, period_s=PERIOD_S)
        )
        config = BridgeLinkConfig(remote=address, key_file=str(key), connect_timeout_s=10.0)
        self.link = BridgeLink(config, thrust_max_n=2.0)
        self.said = ""

    async def _connect(self) -> int:
        self.bridge = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "groundstation", "radio", "bridge", str(self._config)),
            stdout=asyncio.subprocess.PIPE,
        )
        await self.link.connect()
        (standby,) = children_of(self.bridge.pid)
        return standby

    async def leave(self) -> None:
        await super().leave()
        with contextlib.suppress(ProcessLookupError):
            self.bridge.terminate()
        await self.lines()

    async def lines(self) -> str:
        """What the bridge has said, once it has ended."""
        async with asyncio.timeout(60.0):
            out, _ = await self.bridge.communicate()
        self.said += out.decode()
        return self.said


BRIDGE = """
listen = "{address}"
key_file = "{key}"
[link]
kind = "dsm"
port = "{port}"
period_s = {period_s}
simulated = true
arm_low_s = 0.0
arm_high_s = 0.1
map = {{ arm = {{ channel = 5 }} }}
"""


def command(thrust_n: float = 0.0) -> Command:
    now = asyncio.get_running_loop().time()
    down = (Segment(DOWN_S, 0.5, (0.0, 0.0, 0.0)),) if thrust_n > 0.0 else ()
    return Command(thrust_n, (0.0, 0.0, 0.0), 1, now, now + COAST_S, down)


@contextlib.asynccontextmanager
async def begun(it: F) -> AsyncIterator[F]:
    try:
        await it.begin()
        await asyncio.sleep(0.15)
        yield it
    finally:
        await it.end()


def gap_s(it: Flight, since_s: float) -> float:
    times = [since_s, *(time_s for time_s, _ in it.seen if time_s > since_s)]
    return max(second - first for first, second in zip(times, times[1:], strict=False))


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
@in_real_time
async def test_a_pacer_that_dies_or_stands_still_in_flight_is_replaced_by_what_it_held(
    number: signal.Signals,
) -> None:
    async with begun(Flight()) as it:
        struck = time.monotonic()
        os.kill(it.pacer, number)
        await it.lost()
        assert "its stand-by has taken over" in it.link.status.text
        assert not it.link.send(command(1.0))
        await asyncio.sleep(COAST_S + DOWN_S + 0.3)
        assert is_gone(it.pacer), "killed, and reaped"
        assert gap_s(it, struck) < GAP_S
        after = it.sent(struck)
        assert any(0.4 < sticks.thrust_n < 0.6 for sticks in after), "its bring-down"
        it.is_down()
        it.is_one_writers()
        with pytest.raises(LinkLost, match="its stand-by has taken over"):
            await it.link.arm(command)
        it.is_down()
        await it.link.close()
        await it.link.connect()
        assert it.link.status.state == "connected"
        await it.link.arm(command)


@pytest.mark.parametrize(
    ("number", "says"), [(signal.SIGKILL, "is gone"), (signal.SIGSTOP, "stands still")]
)
@in_real_time
async def test_a_stand_by_that_dies_or_stands_still_is_told_and_the_pacer_goes_on(
    number: signal.Signals, says: str
) -> None:
    async with begun(Flight()) as it:
        assert "stand-by" not in it.link.status.warning
        struck = time.monotonic()
        os.kill(it.standby, number)
        told = f"the pacer's stand-by {says}: should the pacer end too"
        await until(lambda: told in it.link.status.warning)
        assert it.link.status.state == "armed"
        assert gap_s(it, struck) < GAP_S
        assert all(sticks.thrust_n > 0.9 for sticks in it.sent(struck))
        os.kill(it.standby, signal.SIGCONT)


@pytest.mark.parametrize("first", ["pacer", "standby"])
@in_real_time
async def test_nothing_is_said_to_bring_down_where_the_pacer_and_its_stand_by_are_dead(
    first: str,
) -> None:
    async with begun(Flight()) as it:
        assert not it.link.status.unmet
        for process in (it.pacer, it.standby) if first == "pacer" else (it.standby, it.pacer):
            assert "and with them every frame" not in it.link.status.text
            os.kill(process, signal.SIGKILL)
            await asyncio.sleep(0.05)  # long enough for the stand-by to take over, and to say so
        await until(lambda: it.link.status.unmet)
        says = "the receiver's failsafe has to act: the pacer and its stand-by ended"
        assert it.link.status.unmet.startswith(says)
        assert "and with them every frame" in it.link.status.text, "not what was true before"
        assert it.link.status.phase == "over"


@in_real_time
async def test_a_bridge_whose_pacer_lost_its_stand_by_says_so_and_starts_both_anew(
    tmp_path: Path,
) -> None:
    async with begun(Bridged(tmp_path)) as it:
        struck = time.monotonic()
        os.kill(it.standby, signal.SIGKILL)
        await until(lambda: "on the bridge: the pacer's stand-by is gone" in it.link.status.warning)
        assert it.link.status.state == "armed"
        assert all(sticks.thrust_n > 0.9 for sticks in it.sent(struck)), "the flight goes on"
        it.fall_silent()
        await it.link.disarm()
        await until(
            lambda: it.link.status.state == "connected" and "stand-by" not in it.link.status.warning
        )
        (standby,) = children_of(it.bridge.pid)
        assert standby != it.standby
        await it.link.arm(command)
    assert "warning: the pacer's stand-by is gone" in it.said


@in_real_time
async def test_motors_that_were_killed_stay_off_when_the_pacer_dies_at_that_moment() -> None:
    async with begun(Flight()) as it:
        os.kill(it.pacer, signal.SIGSTOP)  # it will never read the order
        killed = asyncio.create_task(it.link.kill())
        await it.lost()
        told = time.monotonic()
        await killed
        assert not any(sticks.armed for sticks in it.sent(told + 0.05))
        it.is_down()


@in_real_time
async def test_a_station_that_dies_after_its_pacer_is_still_outlived() -> None:
    async with begun(Flight()) as it:
        os.kill(it.pacer, signal.SIGKILL)
        await it.lost()
        pacer = it.link._watched.pacer
        assert isinstance(pacer, PacerProcess)
        pacer.forget()  # as its death would: the other end of the wire closes
        await asyncio.sleep(COAST_S + DOWN_S + 0.3)
        it.is_down()
        it.is_one_writers()
        last = it.seen[-1][0]
        assert time.monotonic() - last < GAP_S, "disarm frames go on for a while"
        await until(lambda: pacer._process.poll() is not None)


@pytest.mark.tried(1)  # that it dies, or stands still, which the tests of a station have
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
@in_real_time
async def test_at_a_bridge_too_the_last_frame_is_never_a_flying_one(
    number: signal.Signals, tmp_path: Path
) -> None:
    async with begun(Bridged(tmp_path)) as it:
        struck = time.monotonic()
        os.kill(it.pacer, number)
        await it.lost()
        assert "on the bridge: the pacer" in it.link.status.text
        await until(lambda: it.link.status.state == "connected")  # another pacer is there
        assert not it.link.send(command(1.0))
        await asyncio.sleep(0.6)
        it.is_down()
        it.is_one_writers()
        lifted = [time_s for time_s, sticks in it.seen if sticks.armed]
        assert lifted[-1] < struck + COAST_S + DOWN_S + 0.1
        flown = [time_s for time_s, _ in it.seen if struck < time_s < lifted[-1] + 0.4]
        assert max(b - a for a, b in zip(flown, flown[1:], strict=False)) < GAP_S
    disarmed = [line for line in it.said.splitlines() if "the vehicle is disarmed" in line]
    assert float(disarmed[0].split()[0]) > lifted[-1] + 0.4, "disarm frames had left for disarm_s"


@pytest.mark.tried(1)  # signals
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@in_real_time
async def test_a_bridge_that_is_told_to_end_lets_nothing_go_but_the_bring_down(
    number: signal.Signals, tmp_path: Path
) -> None:
    async with begun(Bridged(tmp_path)) as it:
        ended = time.monotonic()
        it.bridge.send_signal(number)
        async with asyncio.timeout(60.0):
            await it.bridge.wait()
        assert it.seen[-1][0] < ended + COAST_S + DOWN_S + 0.5 + 1.0
        lifted = [time_s for time_s, sticks in it.seen if sticks.armed]
        assert ended + DOWN_S < lifted[-1] < ended + COAST_S + DOWN_S + 0.1
        it.is_down()
        it.is_one_writers()
        assert "the vehicle is disarmed" in await it.lines()


@pytest.mark.parametrize("turns", range(2))
@in_real_time
async def test_a_cancellation_that_comes_with_the_pacers_first_report_ends_it(turns: int) -> None:
    loop, wire, before = asyncio.get_running_loop(), PtyWire(), children_of(os.getpid())

    def cancel(turns: int) -> None:
        if turns:
            loop.call_soon(cancel, turns - 1)
        else:
            opening.cancel()

    config = DsmLinkConfig(port=wire.path, period_s=PERIOD_S, map=MAP)
    opening = asyncio.create_task(open_process(config, 2.0, lambda _: cancel(turns)))
    try:
        with pytest.raises(asyncio.CancelledError):
            await opening
        assert children_of(os.getpid()) == before
    finally:
        wire.close()


async def harass(seed: int) -> str:
    """Stop and wake either side at random moments, for random times; what came of it."""
    draw = random.Random(seed)
    async with begun(Flight()) as it:
        for _ in range(draw.randint(1, 4)):
            await asyncio.sleep(draw.uniform(0.0, 0.03))
            struck = draw.sample([it.pacer, it.standby], draw.choice([1, 1, 2]))
            for each in struck:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(each, signal.SIGSTOP)
                await asyncio.sleep(draw.choice([0.0, draw.uniform(0.0, 0.01)]))
            for_s = draw.choice([draw.uniform(0.0, 0.05), draw.uniform(0.05, 0.1), 0.15])
            await asyncio.sleep(for_s)
            for each in draw.sample(struck, len(struck)):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(each, signal.SIGCONT)
        await asyncio.sleep(0.2)
        taken = it.link.status.state == "lost"
        assert taken or it.link.status.state == "armed", it.link.status
        it.fall_silent()
        await asyncio.sleep(COAST_S + DOWN_S + 0.3)
        it.is_down()
        it.is_one_writers()
        return "taken over" if taken else "went on"


async def harassed(seeds: range) -> list[str]:
    found: list[str] = []
    for first in range(0, len(seeds), 4):
        found += await asyncio.gather(*map(harass, seeds[first : first + 4]))
    return found


def test_whichever_side_is_stopped_and_woken_there_are_never_two_writers() -> None:
    found = asyncio.run(harassed(range(12)))
    assert {"taken over", "went on"} == set(found)


# ---- a station that ends or freezes

STATION = """
import asyncio, sys
from links.rf.channel_map import ArmSwitch, ChannelMap
from links.rf.module_codec import DsmLinkConfig
from links.core.deadman import Command, Segment
from links.rf.link import SerialRfLink

async def main():
    loop = asyncio.get_running_loop()
    config = DsmLinkConfig(
        port=sys.argv[1], period_s=0.01, arm_low_s=0.3, arm_high_s=0.7,
        map=ChannelMap(arm=ArmSwitch(channel=5)),
    )
    link = SerialRfLink(config, thrust_max_n=2.0)

    def command(thrust_n):
        now, still = loop.time(), (0.0, 0.0, 0.0)
        return Command(thrust_n, still, 1, now, now + 0.25, (Segment(0.3, 0.8, still),))

    await link.connect()
    print("connected", flush=True)
    await asyncio.sleep(0.5)
    print("arming", flush=True)
    await link.arm(lambda: command(0.2))
    print("flying", flush=True)
    while True:
        link.send(command(1.0))
        await asyncio.sleep(0.01)

asyncio.run(main())
"""
CONFIG = DsmLinkConfig(map=ChannelMap(arm=ArmSwitch(channel=5)))


class Seen(NamedTuple):
    """One frame that left."""

    time_s: float
    sticks: Sticks

    @property
    def lifts(self) -> bool:
        return self.sticks.armed and self.sticks.thrust_n > 0.01


@dataclass
class Case:
    """A station that something happened to, and what left its module's port."""

    frames: list[Seen] = field(default_factory=list)
    struck_s: float = 0.0
    """When it happened."""
    died_s: float = 0.0
    """When the station was seen to have ended."""
    closed_s: float | None = None
    """When the pacer let go of the port, where it did."""

    def after(self, delay_s: float) -> list[Seen]:
        """The frames that left later than ``delay_s`` after it happened."""
        return [seen for seen in self.frames if seen.time_s > self.struck_s + delay_s]


async def strike(stage: str, number: signal.Signals) -> Case:
    """Start a station; 0.2 s after it has reached ``stage`` its group gets signal ``number``."""
    case = Case()
    far, near = os.openpty()
    tty.setraw(near, termios.TCSANOW)
    # By a path of its own: pacers that outlive this test must not find the next terminal there.
    folder = tempfile.TemporaryDirectory()
    port = Path(folder.name) / "port"
    port.symlink_to(os.ttyname(near))
    station = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", STATION, str(port)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
        start_new_session=True,
    )
    stamped = await StampedReader.start(far)
    reader = asyncio.create_task(read(stamped, near, case))
    end = asyncio.create_task(ended(station, case))
    try:
        assert station.stdout is not None
        async with asyncio.timeout(60.0):
            while (line := await station.stdout.readline()).decode().strip() != stage:
                assert line, f"the station ended before it was {stage}"
        await asyncio.sleep(0.2)
        case.struck_s = time.monotonic()
        os.killpg(station.pid, number)
        if number is signal.SIGSTOP:
            await asyncio.sleep(1.5)
            os.killpg(station.pid, signal.SIGCONT)
            await asyncio.sleep(0.6)
            # One that was frozen while arming has given up.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(station.pid, signal.SIGKILL)
        await end
        async with asyncio.timeout(60.0):
            await reader
    finally:
        reader.cancel()
        await stamped.close()
        with contextlib.suppress(ProcessLookupError):
            station.kill()
        await station.wait()
        folder.cleanup()
        os.close(far)
    return case


async def ended(station: asyncio.subprocess.Process, case: Case) -> None:
    """Wait for the end, which may come before that of what is done to it."""
    await station.wait()
    case.died_s = time.monotonic()


async def read(stamped: StampedReader, near: int, case: Case) -> None:
    """Decode what leaves until the last process closes the port; ours ends once it is taken."""
    decoder = CONFIG.codec().decoder()
    while True:
        try:
            time_s, data = await stamped.read()
        except EOFError:
            case.closed_s = time.monotonic()
            assert not decoder.dropped
            return
        if near >= 0:
            os.close(near)
            near = -1
        for heard in decoder.feed(data):
            assert heard.positions is not None
            case.frames.append(Seen(time_s, CHANNELS.read(heard.positions)))


STAGES = ("connected", "arming", "flying")
ENDS = (signal.SIGKILL, signal.SIGINT, signal.SIGSTOP)


@pytest.fixture(scope="module")
def cases() -> Iterator[dict[tuple[str, signal.Signals], Case]]:
    """Every stage with every end, all at once."""

    async def all_of_them() -> dict[tuple[str, signal.Signals], Case]:
        keys = [(stage, end) for stage in STAGES for end in ENDS]
        return dict(zip(keys, await asyncio.gather(*(strike(*key) for key in keys)), strict=True))

    yield asyncio.run(all_of_them())


ends = pytest.mark.parametrize("end", ENDS)


@ends
@pytest.mark.parametrize("stage", ["connected", "arming"])
def test_a_station_that_ends_or_freezes_on_the_ground_never_lifts(
    cases: dict[tuple[str, signal.Signals], Case], stage: str, end: signal.Signals
) -> None:
    case = cases[stage, end]
    assert len(case.frames) > 100
    assert not any(seen.lifts for seen in case.frames)
    # Whoever was frozen before it began to arm does so when it wakes up.
    asleep = [seen for seen in case.after(COAST_S + 0.05) if seen.time_s < case.struck_s + 1.4]
    assert len(asleep) > 50
    assert not any(seen.sticks.armed for seen in asleep)


@ends
def test_in_flight_its_last_command_is_repeated_then_brought_down_then_disarmed(
    cases: dict[tuple[str, signal.Signals], Case], end: signal.Signals
) -> None:
    case = cases["flying", end]
    slack = 0.06
    left = case.after(0.0)
    held = list(takewhile(lambda seen: abs(seen.sticks.thrust_n - 1.0) < 0.01, left))
    down = list(takewhile(lambda seen: abs(seen.sticks.thrust_n - 0.8) < 0.01, left[len(held) :]))
    over = left[len(held) + len(down) :]
    # A busy machine holds stations up: their last command is old, and the end comes sooner.
    assert len(held) > 5 and held[-1].time_s < case.struck_s + COAST_S + slack
    assert len(down) > 10 and down[-1].time_s < held[-1].time_s + DOWN_S + slack
    assert len(over) > 100
    assert not any(seen.sticks.armed or seen.lifts for seen in over), "nor after it woke up again"


@ends
def test_the_pacer_outlives_its_station_by_some_seconds_of_disarm_frames_and_then_ends(
    cases: dict[tuple[str, signal.Signals], Case], end: signal.Signals
) -> None:
    for stage in STAGES:
        case = cases[stage, end]
        assert case.closed_s is not None
        outlived_s = case.closed_s - case.died_s
        assert AFTERLIFE_S - 1.2 < outlived_s < AFTERLIFE_S + COAST_S + DOWN_S + 1.0
        # A busy machine may deny it real-time priority, so that some are late.
        assert len(case.after(0.0)) > 0.7 * (case.closed_s - case.struck_s) / 0.01


# ---- the port


@in_real_time
async def test_a_port_that_goes_away_is_told_and_one_that_comes_back_is_taken_up_disarmed(
    tmp_path: Path,
) -> None:
    port = tmp_path / "module"
    first = PtyWire()
    first.listen(lambda data: None)
    port.symlink_to(first.path)
    config = DsmLinkConfig(
        port=str(port), period_s=0.01, arm_low_s=0.0, arm_high_s=0.2, map=CONFIG.map
    )
    link = SerialRfLink(config, thrust_max_n=2.0)

    def commanded() -> LinkStatus:
        link.send(command(1.0))
        return link.status

    await link.connect()
    try:
        await link.arm(lambda: command(0.0))
        assert link.status.state == "armed"
        first.close()
        await until(lambda: commanded().state == "lost")
        assert "/module" in link.status.text or "port is gone" in link.status.text
        assert not link.send(command(1.0))
        came: list[bytes] = []
        second = PtyWire()
        second.listen(came.append)
        port.unlink()
        port.symlink_to(second.path)
        await until(lambda: commanded().state == "connected")
        for _ in range(30):
            assert not link.send(command(1.0))
            await asyncio.sleep(0.01)
        frames = config.codec().decoder().feed(b"".join(came))
        assert len(frames) > 10
        assert not any(CHANNELS.read(heard.positions or ()).armed for heard in frames)
    finally:
        await link.close()
    second.close()


@in_real_time
async def test_a_port_in_use_is_not_shared() -> None:
    wire = PtyWire()
    wire.listen(lambda data: None)
    config = DsmLinkConfig(port=wire.path)
    first, second = (SerialRfLink(config, thrust_max_n=2.0) for _ in range(2))
    await first.connect()
    with pytest.raises(LinkLost, match="another program uses it"):
        await second.connect()
    await first.close()
    wire.close()


def pacer_of(parent: int) -> int:
    """The pacer that the process ``parent`` has started, by its stand-by."""

    def runs(child: int, module: bytes) -> bool:
        return module in Path(f"/proc/{child}/cmdline").read_bytes()

    (standby,) = (c for c in children_of(parent) if runs(c, b"links.rf.pacer_standby"))
    (pacer,) = children_of(standby)
    assert runs(pacer, b"links.rf.pacer_child")
    return pacer


@in_real_time
async def test_pacer_and_stand_by_are_deaf_to_signals_and_their_death_is_told() -> None:
    wire = PtyWire()
    came: list[bytes] = []
    wire.listen(came.append)
    link = SerialRfLink(DsmLinkConfig(port=wire.path, period_s=0.01), thrust_max_n=2.0)
    await link.connect()
    pid = pacer_of(os.getpid())
    group = os.getsid(pid)
    assert group == os.getpgid(pid) != os.getsid(0)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        os.killpg(group, number)
    before = len(came)
    await asyncio.sleep(0.3)
    assert len(came) > before + 10
    assert link.status.state == "connected"
    os.killpg(group, signal.SIGKILL)
    await until(lambda: link.status.state == "lost")
    assert "and with them every frame" in link.status.text
    assert not link.send(command(1.0))
    await link.close()
    await link.connect()
    assert link.status.state == "connected"
    await link.close()
    wire.close()
