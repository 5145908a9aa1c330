"""Serial RF link on pseudo-terminals: real processes, real signals, and the bytes that left."""

import asyncio
import contextlib
import os
import signal
import sys
import tempfile
import termios
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

import pytest

from links.core import Command, LinkLost, LinkStatus
from links.rf import Channels, DsmLinkConfig, SerialRfLink
from links.rf.channel_map import ArmSwitch, ChannelMap, Sticks
from links.rf.pacer import AFTERLIFE_S
from sim.radio import PtyWire
from tests.e2e.stamped_reader import StampedReader
from tests.e2e.stations import children_of
from tests.loops import in_real_time, until

COAST_S, DOWN_S = 0.25, 0.3
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
CHANNELS = Channels(CONFIG.map, count=6, thrust_max_n=2.0)


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


def command(thrust_n: float = 1.0) -> Command:
    now = asyncio.get_running_loop().time()
    return Command(thrust_n, (0.0, 0.0, 0.0), 1, now, now + 0.25)


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
        link.send(command())
        return link.status

    await link.connect()
    try:
        await link.arm(lambda: command(0.0))
        assert link.status.state == "armed"
        first.close()
        await until(lambda: commanded().state == "lost")
        assert "/module" in link.status.text or "port is gone" in link.status.text
        assert not link.send(command())
        came: list[bytes] = []
        second = PtyWire()
        second.listen(came.append)
        port.unlink()
        port.symlink_to(second.path)
        await until(lambda: commanded().state == "connected")
        for _ in range(30):
            assert not link.send(command())
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
    assert not link.send(command())
    await link.close()
    await link.connect()
    assert link.status.state == "connected"
    await link.close()
    wire.close()
