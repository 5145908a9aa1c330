"""What trackers' programs export as text: Motive, QTM, ROS, TUM, and CSV of any layout."""

import math
import re
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest

from groundstation.analysis.evidence import import_command
from groundstation.analysis.evidence.flight import MEASURED
from groundstation.analysis.evidence.imports import load_mapping, read_flight
from groundstation.analysis.evidence.text_tables import CsvLayout, read_csv_table
from groundstation.config import ConfigError
from groundstation.core.geometry import Quat, so3
from groundstation.recording import MeasuredMessage, Recording

ROWS = 300
TURN = math.radians(20.0)
QTM_TURN: Quat = so3.multiply(
    so3.from_euler_zyx(0.0, 0.0, TURN), so3.from_euler_zyx(math.radians(10.0), 0.0, 0.0)
)


def place(n: int) -> tuple[float, float, float]:
    """North, west, up [m] of a circle."""
    return math.cos(0.01 * n), math.sin(0.01 * n), 1.0 + 0.001 * n


def motive() -> str:
    """Bodies ``quad``, turned about up and not seen in row 7, and ``wand``; one marker, Y up."""
    head = 'Format Version,1.23,Take Name,"Take, 1",Capture Frame Rate,100.000000'
    types = ["Rigid Body"] * 8 + ["Rigid Body Marker"] * 3 + ["Rigid Body"] * 7
    names = ["quad"] * 8 + ["quad:Marker 001"] * 3 + ["wand"] * 7
    kinds = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"] + ["Position"] * 3
    kinds += ["Rotation"] * 4 + ["Position"] * 3
    axes = [*"XYZW", *"XYZ", "", *"XYZ", *"XYZW", *"XYZ"]
    lines = [head, "", f",Type,{','.join(types)}", f",Name,{','.join(names)}"]
    lines += [f",ID,{','.join(['1'] * 18)}"]
    lines += [f",,{','.join(kinds)}", f"Frame,Time (Seconds),{','.join(axes)},"]
    for n in range(ROWS):
        north, west, up = place(n)
        quad = [0.0, math.sin(TURN / 2), 0.0, math.cos(TURN / 2), north, up, -west, 0.0001]
        cells = [""] * 11 if n == 7 else [f"{value:.6f}" for value in (*quad, north, up, -west)]
        wand = [f"{value:.6f}" for value in (0.0, 0.0, 0.0, 1.0, 1.0 + 0.001 * n, 0.0, 0.0)]
        lines.append(",".join([str(n), f"{0.01 * n:.6f}", *cells, *wand]))
    return "\n".join(lines) + "\n"


def qtm() -> str:
    """Turned about up and rolled by 10°; not seen in row 7."""
    head = [f"NO_OF_FRAMES\t{ROWS}", "NO_OF_BODIES\t1", "FREQUENCY\t100", "BODY_NAMES\tquad"]
    columns = ["Frame", "Time", "quad X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual"]
    lines = [*head, "\t".join([*columns, *(f"Rot[{k}]" for k in range(9))])]
    matrix = np.array(so3.matrix(QTM_TURN)).T.ravel().tolist()
    for n in range(ROWS):
        values = [*(1e3 * part for part in place(n)), 10.0, 0.0, 20.0, 0.5, *matrix]
        cells = [f"{value:.5f}" for value in (0.01 * n, *(values if n != 7 else [0.0] * 16))]
        lines.append("\t".join([str(n + 1), *cells]))
    return "\r\n".join(lines) + "\r\n"


def assert_places(got: list[Any]) -> None:
    """Row 7 was not seen."""
    assert len(got) == ROWS - 1
    for n in (0, 100, 250):
        north, west, up = place(n if n < 7 else n + 1)
        at = got[n].position_ned
        assert (at.x, at.y, at.z) == pytest.approx((north, -west, -up), abs=2e-6)


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, "utf-8")
    return path


def poses(folder: Path, path: Path, mapping: str) -> list[Any]:
    out = folder / "flight.mcap"
    assert import_command([path], mapping, out) == 0
    entries = Recording(out).entries(("/measured",))
    return [msgspec.convert(entry.value(), MeasuredMessage) for entry in entries]


PAGE = (Path(__file__).parents[4] / "docs" / "how-to" / "recordings.md").read_text("utf-8")
MAPPED = {title: text for text in re.findall(r"```toml\n(title = .*?)```", PAGE, re.DOTALL)
          for title in re.findall(r'title = "(\w+)', text)}  # fmt: skip
"""The mappings on that page, by the first word of their titles."""


@pytest.mark.parametrize(
    ("program", "text", "turned"),
    # A turn to the left about Motive's up.
    [
        ("Motive", "\ufeff" + motive(), so3.from_euler_zyx(0.0, 0.0, -TURN)),
        ("QTM", qtm(), QTM_TURN),
    ],
)
def test_what_trackers_export_is_read_by_the_mappings_of_the_page(
    program: str, text: str, turned: Quat, tmp_path: Path
) -> None:
    mapping = write(tmp_path, "map.toml", MAPPED[program])
    got = poses(tmp_path, write(tmp_path, "take.txt", text), str(mapping))
    assert_places(got)
    assert got[-1].time_s - got[0].time_s == pytest.approx(0.01 * (ROWS - 1), abs=1e-6)
    w, x, y, z = turned
    q = got[0].attitude
    wanted = (w, x, -y, -z) if program == "QTM" else turned
    assert (q.w, q.x, q.y, q.z) == pytest.approx(wanted, abs=1e-6)


def ros2(between: str, behind: str) -> str:
    return "".join(
        f"{t // 10**9},{t % 10**9},{between},{','.join(f'{p:.9f}' for p in place(n))},"
        f"0.0,0.0,0.0,1.0{behind}\n"
        for n, t in enumerate(STAMPS_NS)
    )


STAMPS_NS = [1_700_000_000_990_000_000 + 10_000_000 * n for n in range(ROWS)]
POSE = ros2("map", "")
ODOMETRY = ros2("odom,base_link", "," + ",".join(["0.0"] * 78))
"""nav_msgs/Odometry: its fourth column is the body's frame, and covariances and a twist follow."""
TUM = "".join(
    f"{t // 10**9}.{t % 10**9:09d} {' '.join(f'{p:.9f}' for p in place(n))} 0 0 0 1\n"
    for n, t in enumerate(STAMPS_NS)
)
TUM_HEAD = "# timestamp tx ty tz qx qy qz qw\n"


@pytest.mark.parametrize(
    ("mapping", "text"),
    [("ros2-pose", POSE), ("ros2-pose", ODOMETRY), ("tum", TUM), ("tum", TUM_HEAD + TUM)],
    ids=["pose", "odometry", "tum", "tum with a remark"],
)
def test_ros_2_and_tum_have_no_head(mapping: str, text: str, tmp_path: Path) -> None:
    got = poses(tmp_path, write(tmp_path, "p.csv", text), mapping)
    assert len(got) == ROWS
    assert got[-1].time_s - got[0].time_s == pytest.approx(0.01 * (ROWS - 1), abs=1e-6)
    for n in (0, 100, ROWS - 1):
        north, west, up = place(n)
        at = got[n].position_ned
        assert (at.x, at.y, at.z) == pytest.approx((west, north, -up), abs=1e-8)


def columns(folder: Path, text: str, time: str = "t", **layout: Any) -> dict[str, Any]:
    path = write(folder, "any.csv", text)
    ((_, table),) = read_csv_table(path, CsvLayout(**layout), [time], Counter())
    return {name: column.tolist() for name, column in table.items()}


RIG = "Rig,A,,\nDate;3 May\n\nt,x,y\n0,1,2\n1,3,4\n"
QUOTED = '"t", "x"\n"0", "1"\n"1", "2"\n'
TELLING = "rig A\n,quad,quad,wand,wand\nt,x,y,x,y\n0,1,2,3,4\n1,5,6,7,8\n"
TOLD = {"t": [0, 1], "quad x": [1, 5], "quad y": [2, 6], "wand x": [3, 7], "wand y": [4, 8]}
NUMBERED = "t,of,another,thing\n0;1,5;map\n1;2,5;map\n"
WARNED = "WARNING: topic [/pose] does not appear to be published yet\n1,2,3\n2,2,4\n3,2,5\n"
"""As ``ros2 topic echo`` writes it into the file where nobody publishes yet."""


@pytest.mark.parametrize(
    ("text", "head_rows", "found"),
    [
        (RIG, 1, {"t": [0, 1], "x": [1, 3], "y": [2, 4]}),
        ("t;x\n0,5;1,5\n", 1, {"t": [0.5], "x": [1.5]}),
        ("t\tx\n0.5\t1.5\n", 1, {"t": [0.5], "x": [1.5]}),
        ("# flight of 3 May\n#t,x\n0.5,1.5\n", 1, {"t": [0.5], "x": [1.5]}),
        ("t,x\n0.5,1.5,\n", 1, {"t": [0.5], "x": [1.5]}),
        (QUOTED, 1, {"t": [0, 1], "x": [1, 2]}),
        (TELLING, 2, TOLD),
        (NUMBERED, 0, {"1": [0, 1], "2": [1.5, 2.5]}),
        (WARNED, 0, {"1": [1, 2, 3], "2": [2, 2, 2], "3": [3, 4, 5]}),
    ],
    ids=[
        "below other lines",
        "semicolons",
        "tabs",
        "comments",
        "comma at the end",
        "quoted",
        "several lines",
        "by number",
        "below a warning",
    ],
)
def test_the_columns_of_a_csv_are_found(
    text: str, head_rows: int, found: dict[str, list[float]], tmp_path: Path
) -> None:
    table = columns(tmp_path, text, next(iter(found)), head_rows=head_rows)
    assert {name: table[name] for name in found} == found


def test_a_head_of_one_line_that_does_not_tell_columns_apart_is_refused(tmp_path: Path) -> None:
    says = "several columns are called x: where the lines above tell them apart"
    with pytest.raises(ConfigError, match=says):
        columns(tmp_path, TELLING)


@pytest.mark.parametrize(
    "text",
    ["0.0,1,2\n0.1,1,2\n", "0.0,0.0,map\n0.1,0.0,map\n", "Exported by MyTracker 2\n\n0,0;1,5;2\n"],
)
def test_a_file_without_a_head_says_so(text: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no head line found"):
        columns(tmp_path, text)


MAPPING = """title = "a lab"
format = "csv"
source = "motion capture"
[[pose]]
position = ["x", "y", "z"]
"""


def refusal(folder: Path, data: bytes) -> str:
    """Why a file is not imported by ``MAPPING``."""
    run, mapping = folder / "run.csv", write(folder, "map.toml", MAPPING)
    run.write_bytes(data)
    with pytest.raises(ConfigError) as refused:
        import_command([run], str(mapping), folder / "out.mcap")
    assert not (folder / "out.mcap").exists()
    return str(refused.value)


BLANK, LATIN = b"", "t,x,y,z\n0,1,1,1\nä,2,2,2\n".encode("latin-1")
DATES = "t,x,y,z\n" + "".join(f"2026-03-05T10:00:0{n},1,1,1\n" for n in range(5))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (BLANK, "or damaged: empty"),
        (LATIN, "not UTF-8 text (byte 16): save it as UTF-8"),
        (DATES.encode(), "no number in column t of run.csv: check the columns"),
    ],
    ids=["empty", "latin-1", "dates"],
)
def test_a_file_that_can_not_be_imported_says_why_and_what_to_do(
    data: bytes, says: str, tmp_path: Path
) -> None:
    assert says in refusal(tmp_path, data)


ORDERED = [f"{0.01 * k:.2f},{0.001 * k},0,-1" for k in range(200)]


@pytest.mark.parametrize(
    "rows", [ORDERED[::-1], Random(1).sample(ORDERED, 200)], ids=["backwards", "mixed"]
)
def test_rows_in_no_order_of_time_are_refused(rows: list[str], tmp_path: Path) -> None:
    says = "of 200 poses are older than the one before, limit 60: sort its rows by their stamps"
    assert says in refusal(tmp_path, "\n".join(["t,x,y,z", *rows]).encode())


def test_a_restart_is_no_disorder(tmp_path: Path) -> None:
    twice = write(tmp_path, "twice.csv", "\n".join(["t,x,y,z", *ORDERED, *ORDERED]) + "\n")
    assert len(poses(tmp_path, twice, str(write(tmp_path, "map.toml", MAPPING)))) == 200


def test_attitudes_of_a_table_of_their_own_stand_between_quaternions_of_either_sign(
    tmp_path: Path,
) -> None:
    """A quaternion and its opposite are the same turn."""
    places = [f"{0.01 * n},{0.001 * n},0,-1" for n in range(1, 100)]
    turns = ["t,w,x,y,z"]
    for n in range(51):
        w, x, y, z = so3.from_euler_zyx(0.0, 0.0, 0.02 * n)
        sign = -1.0 if n % 3 == 0 else 1.0
        turns.append(",".join(map(str, (0.02 * n, sign * w, sign * x, sign * y, sign * z))))
    files = [
        write(tmp_path, "places.csv", "\n".join(["t,px,py,pz", *places])),
        write(tmp_path, "turns.csv", "\n".join(turns)),
    ]
    mapping = write(
        tmp_path,
        "two.toml",
        'title = "two tables"\nformat = "csv"\nsource = "autopilot"\n[[pose]]\n'
        'table = "places*"\nposition = ["px", "py", "pz"]\nattitude_table = "turns*"\n'
        'attitude = ["w", "x", "y", "z"]\n',
    )
    for pose in read_flight(load_mapping(str(mapping)), files).of(MEASURED):
        q = pose.attitude
        yaw_rad = so3.euler_zyx((q.w, q.x, q.y, q.z))[2]
        assert yaw_rad == pytest.approx(pose.time_s + 0.01, abs=1e-4)
