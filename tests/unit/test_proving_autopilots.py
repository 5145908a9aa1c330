"""What `groundstation-sim dev autopilots` makes of what it sees; the firmware is somebody's own."""

import asyncio
import math
from pathlib import Path

import numpy as np
import pytest

from groundstation.config import ConfigError
from groundstation.core.geometry import so3
from groundstation.flight import Flight
from links.mavlink.protocol import MavlinkCodec
from sim.runs import Stage, fly_mission, from_floor
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from tests.loops import in_virtual_time
from tests.proving.autopilots import FirmwareFlight, Flown, TruthReceiver, find, look

D = MavlinkCodec(1, 1).dialect
LEANS = so3.from_euler_zyx(math.radians(30.0), 0.0, 0.0)
QUADROTOR = tuple(
    (north, east, D.MAVLink_hil_state_quaternion_message(
        0, LEANS, 0.0, 0.0, 0.0, round(1e7 * (47.0 + north / 111_319.5)), round(1e7 * (8.0 + east / 75_920.2)),
        500_000 + round(1e3 * up), 10, 20, -30, 0, 0, 0, 0, 0,
    ), D.MAVLink_sim_state_message(
        *LEANS, *[0.0] * 11, 500.0 + up, 0.0, 0.0, 0.1, 0.2, -0.3,
        round(1e7 * (47.0 + north / 111_319.5)), round(1e7 * (8.0 + east / 75_920.2)),
    ))
    for north, east, up in ((0.0, 0.0, 0.0), (3.0, -4.0, 2.0))
)  # fmt: skip
"""Two places north and east of the first [m], the second 2 m higher, as PX4 tells them and as ArduPilot does."""


@pytest.mark.parametrize("which", [2, 3])
def test_both_simulators_truths_are_the_same_rows(which: int) -> None:
    async def main() -> list[tuple[float, ...]]:
        truth, codec = TruthReceiver(), MavlinkCodec(1, 1)
        for row in QUADROTOR:
            truth.datagram_received(codec.pack(row[which]), None)
        return truth.rows

    first, second = in_virtual_time(main)()
    assert first[1:4] == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    assert second[1:] == pytest.approx((3.0, -4.0, -2.0, 0.1, 0.2, -0.3, 30.0), abs=0.02)


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_a_folder_in_which_nothing_was_built_is_refused_in_a_sentence(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=f"--{name}: expected a folder in which it was built"):
        find(name, tmp_path)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> FirmwareFlight:
    folder = tmp_path_factory.mktemp("firmware")
    world, config = prepare(SCENARIOS["paper"], ["trajectory.kind=hold"])
    world, config = from_floor(world, config, 17.0)
    run, rows = RunFolder(folder, config, world, scenario="paper", seed=0), list[tuple[float, ...]]()

    async def script(_: Flight, stage: Stage) -> None:
        while True:
            now_s = asyncio.get_running_loop().time()
            truth = stage.plant.truth(now_s)
            lean = so3.angle_deg(so3.third_column(truth.attitude)[2])
            rows.append((now_s, *truth.position_ned, *truth.velocity_ned, lean))
            await asyncio.sleep(0.01)

    mission = fly_mission(world, config, seed=0, script=script, give=run.give)
    run.close({"completed": mission.landed, "why": mission.why})
    return look(Flown(folder, np.array(rows), config, mission.landed, mission.why))


@pytest.mark.matrix  # of the tool that flies firmware
def test_a_flight_is_looked_at_by_its_recording_and_the_truth(flown: FirmwareFlight) -> None:
    assert flown.landed
    assert flown.start.smooth, vars(flown.start)
    assert flown.rms_cm is not None
    assert flown.rms_cm < 0.3
    assert 0.1 < flown.touchdown_m_s < 0.4
    assert 0.1 < flown.lean_deg < 15.0
    assert flown.home_m < 0.05
