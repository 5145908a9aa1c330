"""A computer that sleeps: its monotonic clock stands still, and stale commands look fresh."""

import asyncio
import sys
import time

import pytest

import links.io.wires
from links.core import STALL_S, LinkError
from links.io import Sleep
from links.mavlink import MavlinkLink
from links.rf import Arm, FramePacer, pacer_child
from links.rf.pacer_child import Commander, MonotonicClock
from tests.unit.links.mavlink.test_mavlink_link import Endpoint, command, orders, scene
from tests.unit.links.rf.test_pacer import CONFIG, PERIOD_S, Bench, is_disarm, lifting

# By their numbers: a limit that the test took from the code would bear out any value.
OURS_S = 0.05


class Lid:
    """Puts the computer to sleep, as far as its clocks tell."""

    def __init__(self) -> None:
        self.slept_s = 1000.0  # it has slept before
        self.less_s: list[float] = []

    def ahead_s(self) -> float:
        return self.slept_s - (self.less_s.pop() if self.less_s else 0.0)


@pytest.fixture
def own_lid(monkeypatch: pytest.MonkeyPatch) -> Lid:
    """The lid of this machine, whose clock alone counts."""
    lid = Lid()
    monkeypatch.setattr(links.io.wires, "_ahead_s", lid.ahead_s)
    return lid


@pytest.fixture
def lid(own_lid: Lid, monkeypatch: pytest.MonkeyPatch) -> Lid:
    """In simulated time, too: there every clock counts as this machine's."""
    monkeypatch.setattr(links.io.wires, "OURS_S", float("inf"))
    return own_lid


@pytest.mark.skipif(sys.platform != "linux", reason="Linux tells of its sleep")
def test_a_computer_that_is_awake_has_not_slept_by_the_clock_that_goes_on_in_sleep() -> None:
    assert links.io.wires._AWAKE_OR_NOT == time.CLOCK_BOOTTIME
    sleep = Sleep(time.monotonic)
    time.sleep(1.1 * STALL_S)
    assert sleep.slept_s == 0.0


def test_it_is_told_how_long_the_computer_slept_since_the_watch_began(lid: Lid) -> None:
    sleep = Sleep(time.monotonic)
    lid.slept_s += 0.9 * STALL_S
    assert sleep.slept_s == 0.0
    lid.slept_s += 600.0
    assert sleep.slept_s == pytest.approx(600.0, abs=0.1)
    assert Sleep(time.monotonic).slept_s == 0.0


def test_a_program_that_stands_still_between_two_looks_at_the_clocks_has_not_slept(
    lid: Lid,
) -> None:
    lid.less_s = [5.0, 0.0]
    sleep = Sleep(time.monotonic)
    assert sleep.slept_s == 0.0
    lid.less_s = [5.0]
    assert sleep.slept_s == 0.0


def test_a_program_that_stands_still_as_the_watch_begins_is_watched(own_lid: Lid) -> None:
    def stuck() -> float:
        now = time.monotonic()
        time.sleep(2.0 * OURS_S)
        return now

    sleep = Sleep(stuck)
    own_lid.slept_s += 600.0
    assert sleep.slept_s > 0.0


def test_a_simulation_goes_on_where_it_was(own_lid: Lid) -> None:
    simulated, real = Sleep(lambda: time.monotonic() - 2.0 * OURS_S), Sleep(time.monotonic)
    own_lid.slept_s += 600.0
    assert simulated.slept_s == 0.0
    assert real.slept_s > 0.0


# ---- MAVLink


def set_points(autopilot: Endpoint) -> int:
    return len(autopilot.of("SET_ATTITUDE_TARGET"))


@scene()
async def test_nothing_more_leaves_over_mavlink_when_the_computer_wakes(
    link: MavlinkLink, autopilot: Endpoint, lid: Lid
) -> None:
    await link.arm(lambda: command(0.0))
    assert link.send(command())
    lid.slept_s += 600.0
    await asyncio.sleep(0.0)
    before = set_points(autopilot)
    assert not link.send(command()), "the pose looks fresh, and is ten minutes old"
    await asyncio.sleep(3.0)
    assert set_points(autopilot) == before, "neither the command again nor its bring-down"
    assert link.status.slept_s == pytest.approx(600.0, abs=0.1)
    assert link.status.phase == "over"
    await link.arm(lambda: command(0.0))
    assert link.send(command())
    assert link.status.slept_s == 0.0


@scene()
async def test_a_bring_down_that_was_slept_through_is_not_played_to_its_end(
    link: MavlinkLink, autopilot: Endpoint, lid: Lid
) -> None:
    await link.arm(lambda: command(0.0))
    link.send(command())
    await asyncio.sleep(0.1)
    lid.slept_s += 600.0
    await asyncio.sleep(0.05)
    before = set_points(autopilot)
    await asyncio.sleep(3.0)
    assert set_points(autopilot) == before
    async with asyncio.timeout(0.1):
        await link.silent()


@scene()
async def test_an_arming_that_was_slept_through_is_taken_back(
    link: MavlinkLink, autopilot: Endpoint, lid: Lid
) -> None:
    autopilot.answer = lambda message: []
    arming = asyncio.create_task(link.arm(lambda: command(0.0)))
    await asyncio.sleep(0.3)
    lid.slept_s += 600.0
    with pytest.raises(LinkError, match="arming was abandoned: this computer slept"):
        await arming
    assert 1.0 not in orders(autopilot)


# ---- RF


def test_the_pacer_disarms_with_the_very_frame_that_was_made_before_the_sleep() -> None:
    bench = Bench()
    bench.arm()
    bench.give()
    assert lifting(bench.flown(2 * PERIOD_S)[-1])
    bench.now += PERIOD_S
    bench.pacer.prepare(bench.now)
    bench.pacer.note_sleep(600.0, bench.now)
    bench.pacer.leave(bench.now)
    (heard,) = bench._decoder.feed(bench.port.frames[-1])
    assert heard.positions is not None and is_disarm(bench._channels.read(heard.positions))
    bench.give()
    assert all(map(is_disarm, bench.flown(3.0))), "nor does a command count that comes after"
    report = bench.pacer.report(bench.now)
    assert report.over and report.slept_s == 600.0
    bench.pacer.order(Arm(2, bench.now), bench.now)
    assert bench.pacer.report(bench.now).slept_s == 0.0


class Pilot(Commander):
    """Commands what looks fresh for two seconds, then dies."""

    def __init__(self, bench: Bench) -> None:
        self._bench, self._until_s = bench, 2.0

    def listen(self, pacer: FramePacer, now_s: float) -> None:
        self._bench.now = now_s
        if now_s < self._until_s:
            self._bench.give()
        elif self._until_s > 0.0:
            self._until_s = 0.0
            pacer.outlive_commander(now_s)

    def keep(self, pacer: FramePacer, now_s: float) -> None:
        pass

    def tell(self, pacer: FramePacer, now_s: float) -> None:
        pass


class Leap(MonotonicClock):
    """Time goes by when somebody sleeps until then, and once the computer sleeps, too."""

    def __init__(self, lid: Lid, lid_s: float) -> None:
        self._now_s, self._lid, self._lid_s = 0.0, lid, lid_s
        self.now = self._tick

    def _tick(self) -> float:
        self._now_s += 1e-6
        return self._now_s

    def sleep_until(self, when_s: float) -> None:
        self._now_s = max(self._now_s, when_s)
        if self._now_s >= self._lid_s:
            self._lid.slept_s += 600.0
            self._lid_s = float("inf")


def test_the_pacers_process_notices_that_it_slept(lid: Lid) -> None:
    bench, clock = Bench(), Leap(lid, lid_s=1.2)
    bench.pacer.order(Arm(1, 0.0), 0.0)
    pacer_child.pace(bench.pacer, PERIOD_S, CONFIG.frame_s, clock, Pilot(bench))
    heard = [frame.positions for frame in bench._decoder.feed(b"".join(bench.port.frames))]
    seen = [bench._channels.read(positions) for positions in heard if positions is not None]
    flew = [lifting(sticks) for sticks in seen]
    assert flew.index(True) == pytest.approx(0.5 / PERIOD_S, abs=2)
    assert flew.count(True) == pytest.approx((1.2 - 0.5) / PERIOD_S, abs=2)
    assert len(seen) > 2.0 / PERIOD_S
    assert all(map(is_disarm, seen[flew.index(True) + flew.count(True) :]))
    assert bench.pacer.report(clock.now()).slept_s == pytest.approx(600.0, abs=0.1)
