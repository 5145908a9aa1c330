"""Poses that fail in whole flights: no command rests on them, and the replay is identical."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from groundstation.analysis.replay import replay_facts
from groundstation.core.messages import IdleRecord, SwitchRecord, TickRecord
from groundstation.core.mission import FINAL
from groundstation.recording import LineRecord, Record, SentRecord
from links.mavlink.protocol import MavCommand, MavlinkCodec
from sim.runs import RECORDING, from_floor
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import fly_fault, mission
from tests.proving.faults import Row
from tests.proving.faults.cell import FIGURE_S, NEAR
from tests.proving.faults.faults import find_fault

FORWARDS = "link.forward.enabled=true"


class Cell(NamedTuple):
    """One cell of the deck, with all that was recorded of it."""

    row: Row
    records: tuple[Record, ...]

    @property
    def ended_s(self) -> float:
        """When commands ended [s]."""
        lines = (one for one in self.records if isinstance(one, LineRecord))
        return next(one.time_s for one in lines if one.state in FINAL and one.text)


@cache
def flown(case: str, state: str, link: str, *overrides: str) -> Cell:
    """Return one cell in ``paper``, flown once however many tests look at it."""
    records: list[Record] = []
    fault, overrides = find_fault(case, state, link), (*NEAR, *overrides)
    row = fly_fault(case, fault, state, overrides=overrides, keep=records.append)
    return Cell(row, tuple(records))


def written(cell: Cell, folder: Path) -> Path:
    """Return the recording of a cell."""
    case = ": ".join(filter(None, (cell.row.fault, cell.row.variant)))
    fault = find_fault(case, cell.row.state, cell.row.link)
    asked = [*fault.overrides, *NEAR]
    world, config = prepare(SCENARIOS["paper"], asked, source=fault.source, link=fault.link)
    world, config = from_floor(world, config, FIGURE_S)
    run = RunFolder(folder, config, world, scenario="paper", seed=0)
    for record in cell.records:
        run.give(record)
    run.close({"why": cell.row.why})
    return folder / RECORDING


def test_after_the_last_command_only_its_bring_down_is_left() -> None:
    cell = flown("attitude frozen", "tracking", "mavlink")
    kinds = TickRecord | IdleRecord | SwitchRecord
    after = [one for one in cell.records if isinstance(one, kinds)]
    switches = [i for i, one in enumerate(after) if isinstance(one, SwitchRecord)]
    last = next(i for i in switches if getattr(after[i], "what", "") == "surrender")
    (command,) = after[last + 1 :]
    assert isinstance(command, IdleRecord)
    assert command.command.bring_down, "down on the model"


@pytest.mark.tried(1)  # lies
@pytest.mark.parametrize(
    ("case", "link"),
    [("frozen", "mavlink"), ("frozen", "dsm"), ("late: 200 ms, fresh stamps", "mavlink")],
)
def test_a_flight_whose_poses_fail_is_flown_again_to_the_last_bit(
    case: str, link: str, tmp_path: Path
) -> None:
    cell = flown(case, "hold", link)
    assert cell.row.answer_ms is not None, "the poses failed"
    facts = replay_facts(written(cell, tmp_path))
    assert facts["first_difference"] is None
    assert facts["identical"] is True
    assert facts["differing"] == {"pose": 0, "idle": 0, "command": 0}
    ticks = sum(isinstance(one, TickRecord) for one in cell.records)
    assert facts["commands"] == ticks > 100


@pytest.mark.tried(2)  # links, seeds
@pytest.mark.parametrize(
    ("link", "seed", "gust_hz"),
    [("dsm", 0, 0.1), ("mavlink", 4, 0.2), ("mavlink", 0, 0.2), ("dsm", 4, 0.2), ("dsm", 10, 0.2)],
)
def test_a_wind_across_that_turns_slowly_ends_no_flight(
    link: str, seed: int, gust_hz: float
) -> None:
    wind = ["sim.wind_gust=[2.0, 0.0, 0.0]", f"sim.wind_gust_hz={gust_hz}"]
    assert mission("paper", *wind, figure_s=FIGURE_S, seed=seed, link=link).landed


@pytest.mark.tried(1)  # speeds
@pytest.mark.parametrize(("speed_m_s", "acceleration_m_s2"), [(3.0, 10.0), (5.0, 6.0)])
def test_a_hard_climb_asks_for_no_more_thrust_than_allowed(
    speed_m_s: float, acceleration_m_s2: float
) -> None:
    motion = (f"takeoff.climb_m_s={speed_m_s}", f"takeoff.transit_m_s2={acceleration_m_s2}")
    hard = [*motion, "takeoff.height_m=2.5"]
    assert mission("paper", *hard, figure_s=1.0).landed


def test_poses_that_fail_are_forwarded_no_more_and_no_land_rests_on_them() -> None:
    cell = flown("attitude frozen", "tracking", "mavlink", FORWARDS)
    codec = MavlinkCodec(1, 1)
    sent = (one for one in cell.records if isinstance(one, SentRecord))
    left = [(one.time_s, message) for one in sent for message in codec.feed(one.data)]
    forwarded_s = [time_s for time_s, message in left if message.get_type() == "ODOMETRY"]
    assert cell.row.struck_s is not None and cell.row.answer_ms is not None
    failed_s = cell.row.struck_s + 1e-3 * cell.row.answer_ms
    assert failed_s - 0.05 < forwarded_s[-1] <= failed_s
    orders = [(time_s, getattr(one, "command", None)) for time_s, one in left]
    modes = (time_s for time_s, order in orders if order == MavCommand.DO_SET_MODE)
    assert max(modes) < failed_s, "its position may come from those poses"
