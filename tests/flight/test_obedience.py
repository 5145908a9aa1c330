"""The monitor that asks whether the vehicle obeys, in whole flights: who is convicted, how soon, and who never is."""

import asyncio
import math
from functools import cache
from pathlib import Path
from statistics import median
from typing import NamedTuple

import pytest

from groundstation.analysis.replay import replay_facts
from groundstation.core.messages import IdleRecord, SwitchRecord, TickRecord
from groundstation.core.mission import FINAL
from groundstation.recording import LineRecord, Record, SentRecord
from links.mavlink.protocol import DO_SET_MODE, MavlinkCodec
from sim.runs import RECORDING, fly_mission, from_floor
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from tests.proving.faults import Row, fly_here
from tests.proving.faults.cell import FIGURE_S, NEAR
from tests.proving.faults.faults import find_fault
from tests.proving.faults.judge import FASTEST_M_S, SIDEWAYS_M

EXCITED_MS, CALM_MS = 400.0, 1300.0
"""So soon a picture that stands still is found out: where a course excites the vehicle, and in a calm hold."""
FORWARDS = "link.forward.enabled=true"

CONVICTED = "convicted:"
ENDS = (CONVICTED, "suspicion: the position")
"""How the line begins by which people are told why poses end a flight."""


class Cell(NamedTuple):
    """One cell of the deck, with all that was recorded of it."""

    row: Row
    records: tuple[Record, ...]

    @property
    def reasons(self) -> list[str]:
        """What the operator read."""
        return [one.text for one in self.records if isinstance(one, LineRecord)]

    @property
    def ended_s(self) -> float:
        """When the poses ended the flight [s]."""
        return next(
            one.time_s
            for one in self.records
            if isinstance(one, LineRecord) and one.state in FINAL and one.text.startswith(ENDS)
        )


@cache
def flown(fault: str, state: str, *overrides: str, seed: int = 0) -> Cell:
    """One cell in ``paper``, flown once however many tests look at it."""
    records: list[Record] = []
    case = fault.removesuffix(", radio")
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        row = runner.run(
            fly_here(
                case,
                find_fault(case, state, "mavlink" if case == fault else "dsm"),
                state,
                seed=seed,
                scenario="paper",
                overrides=(*NEAR, *overrides),
                keep=records.append,
            )
        )
    return Cell(row, tuple(records))


def written(cell: Cell, folder: Path) -> Path:
    """The recording of a cell."""
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


@pytest.mark.parametrize(("state", "within_ms"), [("hold", CALM_MS), ("tracking", EXCITED_MS)])
@pytest.mark.parametrize("fault", ["frozen", "frozen, radio"])
def test_a_picture_that_stands_still_is_found_out_while_the_vehicle_is_near_and_slow(
    fault: str, state: str, within_ms: float
) -> None:
    rows = [flown(fault, state, seed=seed).row for seed in range(3)]
    assert median(math.inf if row.answer_ms is None else row.answer_ms for row in rows) <= 1000.0
    for row in rows:
        assert row.answer_ms is not None
        assert row.answer_ms <= within_ms
        assert row.why.startswith(ENDS)
        assert row.sideways_m < SIDEWAYS_M
        assert row.fastest_m_s < FASTEST_M_S
        assert row.safe, row.why


@pytest.mark.parametrize("fault", ["frozen", "frozen, radio"])
def test_no_command_follows_the_one_that_ends_a_flight_for_its_poses(fault: str) -> None:
    cell = flown(fault, "tracking")
    after = [one for one in cell.records if isinstance(one, TickRecord | IdleRecord | SwitchRecord)]
    last = next(i for i, one in enumerate(after) if isinstance(one, SwitchRecord) and one.what == "surrender")
    (command,) = after[last + 1 :]
    assert isinstance(command, IdleRecord)
    assert command.command.bring_down, "down on the model"
    assert any(one.state in FINAL and one.text.startswith(ENDS) for one in cell.records if isinstance(one, LineRecord))


@pytest.mark.parametrize("fault", ["frozen", "frozen, radio", "late: 200 ms, fresh stamps"])
def test_a_flight_that_ends_by_what_the_commands_did_is_flown_again_to_the_last_bit(fault: str, tmp_path: Path) -> None:
    cell = flown(fault, "hold")
    facts = replay_facts(written(cell, tmp_path))
    assert facts["first_difference"] is None
    assert facts["identical"] is True
    assert facts["differing"] == {"pose": 0, "idle": 0, "command": 0}
    assert facts["commands"] == sum(isinstance(one, TickRecord) for one in cell.records) > 100


@pytest.mark.parametrize(
    ("fault", "state"),
    [
        ("mass told wrong: +30 %", "start"),
        ("mass told wrong: -30 %", "start"),
        ("thrust told wrong: +30 %", "start"),
        ("thrust told wrong: -30 %, radio", "start"),
        ("push: 4 for 1 s", "hold"),
        ("push: 4 for 1 s", "tracking"),
        ("gust", "hold"),
        ("gust", "tracking"),
        ("gust: 25 Hz", "hold"),
        ("gust: 25 Hz", "tracking"),
        ("tether", "hold"),
        ("tether", "take-off"),
        ("ground effect", "start"),
        ("ground effect", "landing"),
        ("estimator reset", "hold"),
        ("estimator reset", "tracking"),
    ],
)
def test_a_vehicle_that_obeys_is_never_convicted(fault: str, state: str) -> None:
    cell = flown(fault, state)
    assert not [reason for reason in cell.reasons if reason.startswith(CONVICTED)]
    assert cell.row.safe, cell.row.why


@pytest.mark.parametrize("seed", [0, 4])
@pytest.mark.parametrize("link", ["mavlink", "dsm"])
def test_a_wind_across_that_turns_in_five_seconds_is_no_mirrored_picture(link: str, seed: int) -> None:
    wind = ["sim.wind_gust=[2.0, 0.0, 0.0]", "sim.wind_gust_hz=0.2"]
    world, config = from_floor(*prepare(SCENARIOS["paper"], wind, link=link), FIGURE_S)
    assert fly_mission(world, config, seed=seed).landed


@pytest.mark.parametrize(("speed_m_s", "acceleration_m_s2"), [(3.0, 10.0), (5.0, 6.0)])
def test_a_climb_that_is_told_to_be_hard_asks_for_no_more_thrust_than_it_may_have(
    speed_m_s: float, acceleration_m_s2: float
) -> None:
    hard = [f"takeoff.climb_m_s={speed_m_s}", f"takeoff.transit_m_s2={acceleration_m_s2}", "takeoff.height_m=2.5"]
    world, config = from_floor(*prepare(SCENARIOS["paper"], hard), 1.0)
    assert fly_mission(world, config, seed=0).landed


def test_poses_that_end_a_flight_end_what_the_autopilot_is_told_of_them_and_no_land_rests_on_them() -> None:
    cell = flown("frozen", "tracking", FORWARDS)
    codec = MavlinkCodec(1, 1)
    left = [
        (one.time_s, message) for one in cell.records if isinstance(one, SentRecord) for message in codec.feed(one.data)
    ]
    forwarded_s = [time_s for time_s, message in left if message.get_type() == "ODOMETRY"]
    assert cell.ended_s - 0.05 < forwarded_s[-1] <= cell.ended_s
    modes_s = [time_s for time_s, message in left if getattr(message, "command", None) == DO_SET_MODE]
    assert modes_s
    assert modes_s[-1] < cell.ended_s, "its position may come from those poses"
