"""What leaves until when after the poses stop: docs/explanation/safety.md, the code and the bytes say the same."""

import asyncio
import struct
from pathlib import Path

import pytest

from groundstation.core.mission import State
from groundstation.core.safety import GuardsConfig
from groundstation.flight import Flight
from groundstation.flight.pacing import LAST_CHANCE_S
from groundstation.recording import make_flight
from groundstation.settings import FlightConfig
from links.core.deadman import BRING_DOWN_LIMIT_S
from links.rf.pacer import AFTERLIFE_S
from sim.runs import Stage, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from tests.loops import in_virtual_time

SAFETY = Path(__file__).parents[2] / "docs" / "explanation" / "safety.md"
SET_POINT = b"\x52\x00\x00"


def test_the_table_of_what_leaves_has_the_numbers_of_the_code() -> None:
    coast, level = 1e3 * FlightConfig().coast_s, 1e3 * GuardsConfig().level_s
    down, after = 1e3 * BRING_DOWN_LIMIT_S, 1e3 * AFTERLIFE_S
    rows = [line for line in SAFETY.read_text("utf-8").splitlines() if line.startswith("| ") and "T + " in line]
    (poses,) = [row for row in rows if row.startswith("| poses stop")]
    for ms in (coast - 1e3 * LAST_CHANCE_S, coast + level, coast + level + down):
        assert f"until T + {ms:.0f}" in poses
    (killed,) = [row for row in rows if row.startswith("| the process is killed")]
    for ms in (coast, coast + down, coast + down + after):
        assert f"until T + {ms:.0f}" in killed


@pytest.mark.parametrize(
    ("overrides", "fresh_ms"),
    [([], 500.0), (["guards.level_s=0"], 250.0), (["flight.coast_s=0.2", "guards.level_s=0.1"], 300.0)],
)
def test_nothing_lifts_later_than_the_table_says(overrides: list[str], fresh_ms: float) -> None:
    # From 2 m a bring-down is as long as one may be.
    world, config = from_floor(*prepare(SCENARIOS["paper"], ["takeoff.height_m=2", *overrides]), None)
    left: list[tuple[float, float]] = []

    async def main() -> float:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)

        async def confirm() -> bool:
            await asyncio.sleep(1.0)
            return True

        def tap(time_s: float, source: tuple[str, int], _: object, data: bytes) -> None:
            if source[1] == 14540 and data[7:10] == SET_POINT:
                left.append((time_s, struct.unpack_from("<4f", data.ljust(60, b"\0"), 30)[3]))

        stage = Stage(world, config, 0)
        flight: Flight = make_flight(config, confirm=confirm, wires=stage.wires)
        running = [asyncio.create_task(stage.run()), asyncio.create_task(flight.run())]
        while flight.state is not State.HOLD:
            await asyncio.sleep(0.01)
        await asyncio.sleep(1.0)
        loop.tap = tap
        assert stage.mocap is not None
        stage.mocap.cover(True)
        covered_s = loop.time()
        await asyncio.sleep(4.0)
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
        return covered_s

    covered_s = in_virtual_time(main())
    stamp_s = covered_s  # no pose is newer than the moment at which the cameras were covered
    lifting = max(time_s for time_s, thrust in left if thrust > 0.0)
    latest = max(time_s for time_s, _ in left)
    period_s, rest_s = 0.0225, world.pose_latency_s + 1.0 / 50.0
    assert lifting <= stamp_s + 1e-3 * fresh_ms + BRING_DOWN_LIMIT_S - 0.15
    assert latest <= stamp_s + 1e-3 * fresh_ms + BRING_DOWN_LIMIT_S
    assert latest > stamp_s - rest_s - period_s + 1e-3 * fresh_ms + BRING_DOWN_LIMIT_S - 0.15, "it is played to its end"
