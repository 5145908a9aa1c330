"""The CSV of recorded poses."""

from pathlib import Path

from hypothesis import given, strategies as st

from groundstation.core.messages import Pose
from groundstation.pose import CSV_COLUMNS, IN_RUN_FOLDER, CsvRow, encode_csv
from sim.runs import fly
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare

number = st.floats(allow_nan=False, allow_infinity=False, width=64)


@given(st.builds(CsvRow, number, number, st.tuples(*[number] * 3), st.tuples(*[number] * 4)))
def test_every_number_survives_the_file_to_the_last_bit(row: CsvRow) -> None:
    t, x, y, z, qw, qx, qy, qz, arrival = map(float, encode_csv(row).split(","))
    assert CsvRow(t, arrival, (x, y, z), (qw, qx, qy, qz)) == row


def test_a_runs_folder_has_the_poses_that_were_flown_on(tmp_path: Path) -> None:
    world, config = prepare(SCENARIOS["paper"], [])
    folder, flown = RunFolder(tmp_path, config, world, scenario="paper", seed=0), []

    def both(pose: Pose) -> None:
        flown.append(pose)
        folder.pose(pose)

    fly(world, config, seed=0, duration_s=2.0, on_pose=both)
    folder.close({"completed": True, "why": ""})
    head, *rows = (tmp_path / IN_RUN_FOLDER).read_text("utf-8").splitlines()
    assert head == CSV_COLUMNS
    assert len(flown) > 100
    assert [tuple(map(float, row.split(",")))[1:4] for row in rows] == [pose.position_ned for pose in flown]
    assert [float(row.split(",")[0]) for row in rows] == [pose.time_s for pose in flown]
