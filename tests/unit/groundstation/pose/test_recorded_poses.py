"""Recordings as pose sources: CSV, run folders, pace."""

import asyncio
import math
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.core.messages import Pose, SourceError
from groundstation.pose import CsvRow, encode_csv, read_csv
from groundstation.pose.registry import CsvConfig
from sim.runs import fly
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from tests.loops import in_virtual_time

number = st.floats(allow_nan=False, allow_infinity=False, width=64)
LEVEL = (1.0, 0.0, 0.0, 0.0)


@given(st.builds(CsvRow, number, number, st.tuples(*[number] * 3), st.tuples(*[number] * 4)))
def test_every_number_survives_the_file_to_the_last_bit(row: CsvRow) -> None:
    dropped: Counter[str] = Counter()
    finite = math.isfinite(sum((row.t_s, row.arrival_s, *row.position, *row.attitude)))
    assert list(read_csv([encode_csv(row)], dropped)) == ([row] if finite else [])


def test_headings_remarks_and_bad_rows_are_passed_over() -> None:
    lines = [
        "t,x,y,z,qw,qx,qy,qz", "# from the second camera", "", "0,1,2,3,1,0,0,0", "1,1,2,3,1,0,0",
        "t,x,y,z,qw,qx,qy,qz", "2,1,2,nan,1,0,0,0", "3,1,2,3,1,0,0,0,3.5,9", "4,1,2,3,1,0,0,0,4.5", "5," * 1000,
    ]  # fmt: skip
    dropped: Counter[str] = Counter()
    assert list(read_csv(lines, dropped)) == [
        CsvRow(0.0, 0.0, (1.0, 2.0, 3.0), LEVEL),
        CsvRow(4.0, 4.5, (1.0, 2.0, 3.0), LEVEL),
    ]
    assert dropped == {"malformed": 4, "not_finite": 1}


def played(path: Path, until_s: float) -> tuple[list[tuple[float, Pose]], float]:
    poses: list[tuple[float, Pose]] = []

    async def main() -> float:
        loop = asyncio.get_running_loop()
        source = CsvConfig(path=str(path)).build()
        await source.start(lambda pose: poses.append((loop.time(), pose)))
        await asyncio.sleep(until_s)
        await source.close()
        return source.status.latency_s

    return poses, in_virtual_time(main)()


def test_a_recording_is_played_at_its_own_pace_and_stops_when_closed(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("".join(encode_csv(CsvRow(0.02 * n, 0.02 * n + 0.01, (0.0, 0.0, -1.0), LEVEL)) for n in range(50)))
    poses, latency_s = played(path, 0.81)
    assert [when for when, _ in poses] == pytest.approx([0.02 * n for n in range(41)], abs=1e-6)
    assert [pose.time_s - poses[0][1].time_s for _, pose in poses] == pytest.approx([0.02 * n for n in range(41)])
    assert latency_s == pytest.approx(0.01)


def test_a_runs_folder_plays_the_poses_that_were_flown_on(tmp_path: Path) -> None:
    world, config = prepare(SCENARIOS["paper"], [])
    folder, flown = RunFolder(tmp_path, config, world, scenario="paper", seed=0), []

    def both(pose: Pose) -> None:
        flown.append(pose)
        folder.pose(pose)

    fly(world, config, seed=0, duration_s=2.0, on_pose=both)
    folder.close({"completed": True, "why": ""})
    poses, _ = played(tmp_path, 10.0)
    assert len(flown) > 100
    assert [pose.position_ned for _, pose in poses] == [pose.position_ned for pose in flown]
    shift = poses[0][1].time_s - flown[0].time_s
    assert [pose.time_s - shift for _, pose in poses] == pytest.approx([pose.time_s for pose in flown], abs=1e-9)


def test_a_file_without_poses_says_what_was_expected(tmp_path: Path) -> None:
    path = tmp_path / "empty.csv"
    path.write_text("hello\n1,2\n")
    with pytest.raises(
        SourceError, match=r"^pose\.path: .* holds no poses \(found: 1 malformed\): expected rows t,x,y,z,qw"
    ):
        played(path, 0.1)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "cannot read .*: No such file"),
        (b"", "holds no poses"),
        (b"\x00\xff garbage" * 40, "holds no poses"),
        (b"\x89MCAP0\r\n and more", "`groundstation export .*flight --format poses` makes the file"),
    ],
    ids=["missing", "empty", "garbage", "mcap"],
)
def test_a_file_that_can_not_be_played_stops_the_start_with_what_is_wrong(
    tmp_path: Path, content: bytes | None, says: str
) -> None:
    path = tmp_path / "flight"
    if content is not None:
        path.write_bytes(content)

    async def main() -> None:
        await CsvConfig(path=str(path)).build().start(lambda _: None)

    with pytest.raises(SourceError, match=rf"^pose\.path: .*{says}"):
        in_virtual_time(main)()
