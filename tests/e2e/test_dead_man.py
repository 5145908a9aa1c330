"""The flying program killed, frozen and slowed in real time, judged by its datagrams."""

import asyncio
import contextlib
import re
import signal
import struct
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from sim.runs import Stage
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.stations import EXAMPLE, Room
from tests.loops import until

ROOT = Path(__file__).parents[2]
SET_POINT, ORDER = b"\x52\x00\x00", b"\x4c\x00\x00"
ARM = struct.pack("<ff", 1.0, 0.0)
UNDER_WAY_S = 0.05
"""A loaded machine may take so long from one process to another [s]."""
KEPT_WAITING_S = 1.0
"""And a set-point so long from its stamp to whoever reads it [s]."""


@dataclass
class Lab:
    """A simulated vehicle in this process, and what came from the station."""

    station: asyncio.subprocess.Process
    stage: Stage
    datagrams: list[tuple[float, bytes]] = field(default_factory=list)
    log: list[str] = field(default_factory=list)

    def since(self, time_s: float) -> list[bytes]:
        return [data for t, data in self.datagrams if t > time_s]

    def set_points(self, since_s: float) -> list[tuple[float, float, tuple[float, float, float]]]:
        """When each that arrived since then left [s], its thrust as a share, its body rates.

        It left when its stamp says, if it arrives within ``KEPT_WAITING_S``.
        """
        found = []
        for t, data in self.datagrams:
            if t > since_s and data[7:10] == SET_POINT:
                stamp_ms, p, q, r, thrust = struct.unpack_from("<I16x4f", data.ljust(60, b"\0"), 10)
                under_way_s = 1e-3 * (int(1e3 * t) - stamp_ms & 0xFFFFFFFF)
                left_s = t - under_way_s if under_way_s < KEPT_WAITING_S else t
                found.append((left_s, thrust, (p, q, r)))
        return found

    def has_orders_to_arm(self, since_s: float) -> bool:
        return any(data[7:10] == ORDER and data[10:18] == ARM for data in self.since(since_s))

    async def says(self, word: str) -> None:
        await until(lambda: any(word in line for line in self.log))

    async def exit_code(self) -> int:
        async with asyncio.timeout(60.0):
            return await self.station.wait()


@contextlib.asynccontextmanager
async def lab(folder: Path, *arguments: str) -> AsyncIterator[Lab]:
    """A station that flies ``paper``."""
    room = Room(folder)
    world, config = prepare(SCENARIOS["paper"], [o.removeprefix("--set=") for o in room.wires])
    station = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "groundstation", "daemon", str(EXAMPLE), *room.wires, "--once"),
        *(f"--set=status.path={folder}.sock", "--set=flight.duration_s=30.0", *arguments),
        stdin=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        cwd=ROOT,
    )
    # Its own failsafe comes as late as it is delivered: what leaves the station is looked at.
    stage = Stage(world, config, 0, parameters={"COM_OF_LOSS_T": 1.0})
    here = Lab(station, stage)
    loop = asyncio.get_running_loop()
    receive = stage.autopilot.receive

    def heard(datagram: bytes, now_s: float) -> list[bytes]:
        here.datagrams.append((loop.time(), datagram))
        return receive(datagram, now_s)

    stage.autopilot.receive = heard  # type: ignore[method-assign]  # read along on the wire
    stage.plant.advance(loop.time())

    async def read() -> None:
        assert station.stderr is not None
        async for line in station.stderr:
            here.log.append(line.decode())

    tasks = [asyncio.create_task(stage.run()), asyncio.create_task(read())]
    try:
        yield here
    finally:
        if station.returncode is None:
            station.kill()
        await station.wait()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def ready(here: Lab) -> None:
    await here.says("ready: link and poses")


async def arming(here: Lab) -> None:
    await here.says("requesting offboard control")
    await asyncio.sleep(0.5)


async def tracking(here: Lab) -> None:
    await here.says("following the trajectory")
    await asyncio.sleep(1.0)


async def landing(here: Lab) -> None:
    await tracking(here)
    here.station.send_signal(signal.SIGTERM)
    await here.says("landing: requested by SIGTERM")
    await asyncio.sleep(0.3)


Reached = Callable[[Lab], Awaitable[None]]
ARMED = ("--arm", "mqx")


def together(*scenes: Awaitable[None]) -> None:
    """Play scenes side by side: each is mostly waiting."""

    async def main() -> None:
        await asyncio.gather(*scenes)

    asyncio.run(main())


async def killed(folder: Path, reached: Reached, *arguments: str) -> None:
    async with lab(folder, *arguments) as here:
        await reached(here)
        here.station.kill()
        await here.exit_code()  # what it sent before its death is under way
        when = asyncio.get_running_loop().time()
        await asyncio.sleep(1.2)  # the autopilot's own failsafe acts meanwhile
        assert here.since(when + UNDER_WAY_S) == [], reached


def test_nothing_leaves_a_station_that_was_killed(tmp_path: Path) -> None:
    together(
        killed(tmp_path / "a", ready),
        killed(tmp_path / "b", arming, *ARMED),
        killed(tmp_path / "c", tracking, *ARMED),
    )


async def frozen(folder: Path, reached: Reached, for_s: float) -> None:
    loop = asyncio.get_running_loop()
    async with lab(folder, *ARMED) as here:
        await reached(here)
        here.station.send_signal(signal.SIGSTOP)
        stopped = loop.time()
        await asyncio.sleep(for_s)
        assert here.since(stopped + UNDER_WAY_S) == []
        here.station.send_signal(signal.SIGCONT)
        woken = loop.time()
        what = f"{reached.__name__} frozen for {for_s} s: {here.log}"
        assert await here.exit_code() == 1, what
        await asyncio.sleep(1.0)
        after = here.set_points(woken)
        assert not here.has_orders_to_arm(woken), what
        over = 0.25 + (0.15 if reached is arming else 2.0)
        assert [t for t, _, _ in after if t > stopped + over + UNDER_WAY_S] == [], what
        # A bring-down has few parts, without yaw, the last with the motors off; commands differ.
        assert len({(thrust, rates) for _, thrust, rates in after}) <= 6, what
        assert all(rates[2] == 0.0 for _, _, rates in after), what
        if for_s > over + UNDER_WAY_S:
            assert after == [], what
        elif after:
            assert after[-1][1] == 0.0, what
            said = "".join(here.log)
            assert "this program stood still" in said or "bring-down" in said, what
        # It was woken in time, and the machine kept it waiting until nothing was owed any more.
        else:
            says = r"no command for (\d+) ms, as this program stood still"
            stood_ms = re.findall(says, "".join(here.log))
            assert stood_ms and float(stood_ms[-1]) > 1e3 * over, what


def test_a_station_that_was_frozen_brings_down_or_is_silent_and_never_flies_on(
    tmp_path: Path,
) -> None:
    together(
        frozen(tmp_path / "a", arming, 0.8),
        frozen(tmp_path / "b", tracking, 0.8),
        frozen(tmp_path / "c", tracking, 2.6),
        frozen(tmp_path / "d", landing, 0.8),
    )


async def told(folder: Path, *signals: signal.Signals) -> Lab:
    async with lab(folder, *ARMED) as here:
        await tracking(here)
        for number in signals:
            here.station.send_signal(number)
            await asyncio.sleep(1.2)
        await here.exit_code()
        return here


THRICE = (signal.SIGTERM, signal.SIGTERM, signal.SIGTERM)


@pytest.mark.tried(1)  # three times, by way of twice; test_output.py sends SIGQUIT
@pytest.mark.parametrize(
    "signals", [THRICE, (signal.SIGTERM, signal.SIGINT), (signal.SIGQUIT,)], ids=len
)
def test_told_twice_it_descends_told_three_times_or_told_by_sigquit_it_stops_the_motors(
    signals: tuple[signal.Signals, ...], tmp_path: Path
) -> None:
    here = asyncio.run(told(tmp_path / "told", *signals))
    if len(signals) > 1:
        for says in (
            "asked to land; once more: failsafe descent",
            f"requested by {signals[1].name}",
        ):
            assert any(says in line for line in here.log), here.log
    if len(signals) == 2:
        assert any("landed and disarmed" in line for line in here.log), here.log
        assert here.set_points(0.0)[-1][1] == 0.0
    else:
        assert any("motors off, acknowledged" in line for line in here.log), here.log
        assert not here.stage.autopilot.armed
