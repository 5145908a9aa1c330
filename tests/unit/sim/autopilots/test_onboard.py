"""Firmware on the simulated vehicle: rotors, release and MAVLink, by a few lines of Python."""

import asyncio
import math
from pathlib import Path

import pytest

from groundstation.core.geometry import Vec3
from sim.autopilots import onboard
from sim.autopilots.onboard import Firmware, OnboardFirmware, take_number
from sim.runs import from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.world import FourRotors, Quadrotor, TrueState, Wind, generator, rows
from tests.loops import Inbox, in_virtual_time, running

STATION = ("127.0.0.1", 14540)


class Hoverer(Firmware):
    """Lifts off at once, and answers each datagram with the same one."""

    step_s = 0.004

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.seen: list[TrueState] = []
        self.felt: list[Vec3] = []
        self.booted = False
        self.ends_s = math.inf
        """When its rotors stop [s]."""
        self._answers: list[bytes] = []

    def boot(self, truth: TrueState, specific_force: Vec3) -> None:
        self.booted = True
        assert specific_force[2] == pytest.approx(-9.81, abs=0.01)

    def step(self, truth: TrueState, specific_force: Vec3) -> FourRotors:
        self.seen.append(truth)
        self.felt.append(specific_force)
        share = 0.6 if truth.time_s < self.ends_s else 0.0
        return (share, share, share, share)

    def say(self, datagram: bytes) -> None:
        self._answers.append(datagram)

    def hear(self) -> list[bytes]:
        heard, self._answers = self._answers, []
        return heard


def fly(
    folder: Path, seconds: float, *, passes: bool = True, ends_s: float = math.inf
) -> tuple[Hoverer, Quadrotor, Inbox]:
    world, _ = from_floor(*prepare(SCENARIOS["rotors_quad1kg"], []), None)
    plant = Quadrotor(world, Wind(world, rows(generator(0, "turbulence").standard_normal, 3)))
    firmware, station = Hoverer(folder), Inbox()
    firmware.ends_s = ends_s

    async def main() -> None:
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: station, local_addr=STATION)
        board = OnboardFirmware(plant, firmware, STATION)
        board.passes = lambda _: passes
        async with running(board):
            await asyncio.sleep(0.1)
            station.transport.sendto(b"set-point", ("127.0.0.1", 61000))
            await asyncio.sleep(seconds - 0.1)

    in_virtual_time(main)()
    return firmware, plant, station


def test_its_motor_outputs_drive_the_rotors_of_the_plant(tmp_path: Path) -> None:
    firmware, plant, _ = fly(tmp_path, 1.0)
    assert firmware.booted
    times = [0.004 * k for k in range(250)]
    assert [one.time_s for one in firmware.seen] == pytest.approx(times, abs=1e-9)
    assert plant.released_s == 0.0
    # 12 N on 1 kg, after the rotors' 40 ms, and with drag: most of 2.2 m/s² for a second.
    assert plant.velocity[2] == pytest.approx(-1.4, abs=0.2)


def test_a_datagram_reaches_it_in_its_next_step_and_its_answer_the_station(tmp_path: Path) -> None:
    _, _, station = fly(tmp_path, 0.2)
    ((when_s, data, _),) = station.got
    assert data == b"set-point"
    assert 0.1 <= when_s <= 0.105


def test_what_does_not_pass_is_lost(tmp_path: Path) -> None:
    _, _, station = fly(tmp_path, 0.2, passes=False)
    assert station.heard == []


def test_its_imu_feels_a_touchdown_whole_and_over_some_steps_as_legs_give(tmp_path: Path) -> None:
    firmware, plant, _ = fly(tmp_path, 2.5, ends_s=0.8)
    assert plant.floor.hardest_m_s is not None and plant.floor.hardest_m_s > 1.0
    down = next(one.time_s for one in firmware.seen if one.on_ground and one.time_s > 1.0)
    times = [one.time_s for one in firmware.seen]
    begin, end = times.index(down) - 2, times.index(down) + 40
    sunk_m_s = firmware.seen[begin - 1].velocity_ned[2]
    felt_m_s = sum(firmware.step_s * (force[2] + 9.81) for force in firmware.felt[begin:end])
    assert felt_m_s == pytest.approx(-sunk_m_s, abs=0.02)
    hardest = max(math.hypot(*force) for force in firmware.felt)
    assert hardest == pytest.approx(40.0, rel=1e-6)


def test_each_firmware_of_a_machine_takes_a_number_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(onboard, "MOST_AT_ONCE", 2)
    taken = [Hoverer(tmp_path) for _ in range(3)]
    first = 23710
    assert [take_number(one.mavlink, first) for one in taken[:2]] == [0, 1]
    says = "2 of them run on this machine: ports from 23710 on are taken"
    with pytest.raises(OSError, match=says):
        take_number(taken[2].mavlink, first)
    for one in taken:
        one.close()


def test_a_process_that_has_ended_says_so(tmp_path: Path) -> None:
    firmware = Hoverer(tmp_path)
    firmware.start(["true"], {"PATH": "/usr/bin:/bin"})
    assert firmware._process is not None
    firmware._process.wait()
    assert firmware.ended
    firmware.close()
    firmware.close()
