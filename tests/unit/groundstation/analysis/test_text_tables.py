"""What trackers' programs export as text: Motive, QTM, ROS, TUM, and CSV of any layout."""

import gzip
import math
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest

from groundstation.analysis.evidence import import_command
from groundstation.analysis.evidence.flight import MEASURED, SETPOINT
from groundstation.analysis.evidence.imports import load_mapping, read_flight
from groundstation.analysis.evidence.text_tables import CsvLayout, read_csv_table, read_qtm_tables
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


def motive(
    *, unit: str = "Meters", scale: float = 1.0, parent: bool = False, more: str = ""
) -> str:
    """Bodies ``quad`` and ``wand``, one marker, Y up.

    Quad is turned about up, and not seen in row 7.
    """
    keys = {
        "Format Version": "1.23", "Take Name": "Take, 1", "Capture Frame Rate": "100.000000",
        "Rotation Type": "Quaternion", "Length Units": unit, "Coordinate Space": "Global",
    }  # fmt: skip
    cells = [f'"{value}"' if "," in value else value for value in keys.values()]
    head = ",".join(f"{key},{cell}" for key, cell in zip(keys, cells, strict=True))
    types = ["Rigid Body"] * 8 + ["Rigid Body Marker"] * 3 + ["Rigid Body"] * 7
    names = ["quad"] * 8 + ["quad:Marker 001"] * 3 + ["wand"] * 7
    kinds = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"] + ["Position"] * 3
    kinds += ["Rotation"] * 4 + ["Position"] * 3
    axes = [*"XYZW", *"XYZ", "", *"XYZ", *"XYZW", *"XYZ"]
    lines = [head, "", f",Type,{','.join(types)}", f",Name,{','.join(names)}"]
    lines += [f",ID,{','.join(['1'] * 18)}"]
    lines += [f",Parent,{','.join([''] * 18)}"] if parent else []
    lines += [f",,{','.join(kinds)}", f"Frame,Time (Seconds),{','.join(axes)}{more}"]
    for n in range(ROWS):
        north, west, up = place(n)
        x, y, z = scale * north, scale * up, -scale * west
        quad = [0.0, math.sin(TURN / 2), 0.0, math.cos(TURN / 2), x, y, z, 0.0001]
        cells = [""] * 11 if n == 7 else [f"{value:.6f}" for value in (*quad, x, y, z)]
        east = scale * (1.0 + 0.001 * n)
        wand = [f"{value:.6f}" for value in (0.0, 0.0, 0.0, 1.0, east, 0.0, 0.0)]
        lines.append(",".join([str(n), f"{0.01 * n:.6f}", *cells, *wand]))
    return "\n".join(lines) + "\n"


def qtm(*, bodies: tuple[str, ...] = ("quad",), time: bool = True, included: str = "6D") -> str:
    """Turned about up and rolled by 10°; not seen in row 7."""
    head = [
        f"NO_OF_FRAMES\t{ROWS}", "NO_OF_CAMERAS\t8", f"NO_OF_BODIES\t{len(bodies)}",
        "FREQUENCY\t100", "DESCRIPTION\t--", "TIME_STAMP\t2026-11-02, 17:47:17\t22107.99",
        f"DATA_INCLUDED\t{included}", "BODY_NAMES\t" + "\t".join(bodies),
    ]  # fmt: skip
    columns = ["Frame", *(["Time"] if time else [])]
    for body in bodies:
        columns += [f"{body} X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual"]
        columns += [f"Rot[{k}]" for k in range(9)]
    lines = [*head, "\t".join(columns)]
    matrix = np.array(so3.matrix(QTM_TURN)).T.ravel().tolist()
    for n in range(ROWS):
        cells = [str(n + 1), *([f"{0.01 * n:.5f}"] if time else [])]
        for k in range(len(bodies)):
            values = [*(1e3 * part + k for part in place(n)), 10.0, 0.0, 20.0, 0.5, *matrix]
            cells += [f"{value:.5f}" for value in (values if n != 7 else [0.0] * 16)]
        lines.append("\t".join(cells))
    return "\n".join(lines) + "\n"


def assert_places(got: list[Any], off_m: float = 0.0) -> None:
    """Row 7 was not seen."""
    assert len(got) == ROWS - 1
    for n in (0, 100, 250):
        north, west, up = place(n if n < 7 else n + 1)
        at = got[n].position_ned
        assert (at.x, at.y, at.z) == pytest.approx(
            (north + off_m, -west - off_m, -up - off_m), abs=2e-6
        )


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, "utf-8")
    return path


def poses(folder: Path, path: Path, mapping: str, body: str = "") -> list[Any]:
    out = folder / "flight.mcap"
    assert import_command([path], mapping, out, body) == 0
    entries = Recording(out).entries(("/measured",))
    return [msgspec.convert(entry.value(), MeasuredMessage) for entry in entries]


UNITS = {"Meters": 1.0, "Centimeters": 100.0, "Millimeters": 1000.0}


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("parent", [False, True])
def test_motives_export_is_read_in_its_own_unit(unit: str, parent: bool, tmp_path: Path) -> None:
    text = motive(unit=unit, scale=UNITS[unit], parent=parent, more=",")
    path = write(tmp_path, "take.csv", "\ufeff" + text)
    got = poses(tmp_path, path, "motive", "quad")
    assert_places(got)
    q = got[0].attitude
    # A turn to the left about Motive's up.
    assert (q.w, q.x, q.y, q.z) == pytest.approx(
        (math.cos(TURN / 2), 0.0, 0.0, -math.sin(TURN / 2)), abs=1e-6
    )


def test_several_bodies_ask_for_a_name(tmp_path: Path) -> None:
    path = write(tmp_path, "take.csv", motive())
    with pytest.raises(
        ConfigError, match="holds 2 bodies, quad, wand: name the vehicle, --body NAME"
    ):
        poses(tmp_path, path, "motive")
    with pytest.raises(ConfigError, match=r"expected one of \['quad', 'wand'\], got 'Quad'"):
        poses(tmp_path, path, "motive", "Quad")
    assert len(poses(tmp_path, path, "motive", "wand")) == ROWS
    with pytest.raises(ConfigError, match="only files of Motive and QTM"):
        read_flight(load_mapping("nanobench"), [path], "quad")


@pytest.mark.parametrize(
    ("mapping", "text", "says"),
    [
        ("motive", motive(unit="Feet"), "is Feet, expected Meters, Centimeters or Millimeters"),
        (
            "motive",
            motive().replace("Quaternion", "XYZ"),
            "Rotation Type is XYZ, expected Quaternion",
        ),
        ("motive", motive().replace("Global", "Local"), "Space is Local, expected Global"),
        ("qtm", qtm(included="3D"), "DATA_INCLUDED is 3D, expected 6D"),
        ("motive", motive() + '"' + "x" * 200_000, "is no motive file, or damaged: field larger"),
    ],
    ids=["unit", "rotation", "space", "markers", "open quote"],
)
def test_what_a_program_states_and_is_not_read_is_refused(
    mapping: str, text: str, says: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=says):
        read_flight(load_mapping(mapping), [write(tmp_path, "take.txt", text)], "quad")


@pytest.mark.parametrize("bodies", [("quad",), ("wand", "quad"), ("quad", "wand")])
@pytest.mark.parametrize("time", [True, False])
def test_qtms_export_is_read(bodies: tuple[str, ...], time: bool, tmp_path: Path) -> None:
    path = write(tmp_path, "run.tsv", qtm(bodies=bodies, time=time).replace("\n", "\r\n"))
    got = poses(tmp_path, path, "qtm", "quad" if len(bodies) > 1 else "")
    assert_places(got, 1e-3 * bodies.index("quad"))
    assert got[-1].time_s - got[0].time_s == pytest.approx(0.01 * (ROWS - 1), abs=1e-6)
    w, x, y, z = QTM_TURN
    q = got[0].attitude
    assert (q.w, q.x, q.y, q.z) == pytest.approx((w, x, -y, -z), abs=1e-4)


def test_a_row_of_qtms_own_is_read_with_the_roll_that_it_states(tmp_path: Path) -> None:
    """Written by QTM: a roll of -0.65630° beside its matrix."""
    row = (
        "1 0.00000 -194.91974 2.24150 0.99661 -0.65630 0.09391 0.05772 4.98536 1.00000 0.00099 "
        "-0.00165 -0.00101 0.99993 -0.01145 0.00164 0.01145 0.99993"
    ).replace(" ", "\t")
    head = qtm().partition("\n1\t")[0]
    ((_, table),) = read_qtm_tables(write(tmp_path, "one.tsv", f"{head}\n{row}\n"))
    turned = so3.from_euler_zyx(*map(math.radians, (-0.65630, 0.09391, 0.05772)))
    attitude = tuple(table[key][0] for key in ("qw", "qx", "qy", "qz"))
    assert attitude == pytest.approx(turned, abs=2e-5)
    place = [table[key][0] for key in "xyz"]
    assert place == pytest.approx([-0.19491974, 0.0022415, 0.00099661], abs=1e-9)


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
    ("text", "hint"),
    [
        ("0.0,1,2\n0.1,1,2\n", ""),
        ("0.0,0.0,map\n0.1,0.0,map\n", ""),
        ("Exported by MyTracker 2\n\n0,0;1,5;2\n0,1;1,5;2\n", ""),
        (motive(), "--map motive"),
        (qtm(), "--map qtm"),
    ],
)
def test_a_file_without_a_head_says_so(text: str, hint: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no head line found") as told:
        columns(tmp_path, text)
    assert hint in str(told.value)


def test_qtms_export_with_decimal_commas_or_without_any_time_is_read(tmp_path: Path) -> None:
    plain, commas = (
        dict(read_qtm_tables(write(tmp_path, name, text)))["quad"]
        for name, text in (("plain.tsv", qtm()), ("commas.tsv", qtm().replace(".", ",")))
    )
    timeless = "\n".join(
        line if "\t" not in line or line.split("\t")[0].isupper() else line.split("\t", 2)[2]
        for line in qtm().splitlines()
    )
    bare = dict(read_qtm_tables(write(tmp_path, "bare.tsv", timeless)))["quad"]
    for other in (commas, bare):
        for name, column in plain.items():
            np.testing.assert_allclose(other[name], column, atol=1e-9)


MAPPING = """title = "a lab"
format = "csv"
source = "motion capture"
[[pose]]
position = ["x", "y", "z"]
"""


def refusal(folder: Path, data: bytes | Path) -> str:
    """Why a file, or the bytes of one, is not imported by ``MAPPING``."""
    run, mapping = folder / "run.csv", write(folder, "map.toml", MAPPING)
    if isinstance(data, Path):
        run = data
    else:
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
        (Path("/dev/zero"), "/dev/zero: FILE: it is a device, not a file"),
        (BLANK, "or damaged: empty"),
        (LATIN, "not UTF-8 text (byte 16): save it as UTF-8"),
        (DATES.encode(), "no number in column t of run.csv: check the columns"),
    ],
    ids=["endless", "empty", "latin-1", "dates"],
)
def test_a_file_that_can_not_be_imported_says_why_and_what_to_do(
    data: bytes | Path, says: str, tmp_path: Path
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


def test_what_is_imported_is_stamped_by_its_own_times(tmp_path: Path) -> None:
    file = write(tmp_path, "run.csv", "\n".join(["t,x,y,z", *ORDERED]))
    poses(tmp_path, file, str(write(tmp_path, "map.toml", MAPPING)))
    stamps = [entry.stamp_ns for entry in Recording(tmp_path / "flight.mcap").entries()]
    np.testing.assert_allclose(np.diff(stamps), 1e7, atol=1.0)


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


def test_thrust_is_a_share_of_the_full_signal_and_follows_the_hover_signal(tmp_path: Path) -> None:
    signals = [(1000.0, 800.0), (1000.0, 1000.0), (1200.0, 800.0)] * 99
    rows = [f'{0.01 * n},0,0,-1,{u},{h},"[[0],0.1]"' for n, (u, h) in enumerate(signals)]
    command = (
        '[[command]]\nthrust = ["u"]\nthrust_full = 2000\nhover = "h"\n'
        'rates = ["r.0", "r.1", "r.0"]\n'
    )
    mapping = write(tmp_path, "map.toml", MAPPING + command)
    file = write(tmp_path, "run.csv", "\n".join(["t,x,y,z,u,h,r", *rows]))
    told = read_flight(load_mapping(str(mapping)), [file]).of(SETPOINT)
    assert [one.thrust for one in told[:3]] == pytest.approx([0.5, 0.4, 0.6])


@pytest.mark.parametrize("kept", [10, 200, -1])
def test_a_packed_file_whose_end_is_missing_is_told_as_cut_off(kept: int, tmp_path: Path) -> None:
    text = "\n".join(["t,x,y,z", *(f"{0.01 * n},{n % 7},{n % 11},{n % 13}" for n in range(500))])
    (file := tmp_path / "run.csv.gz").write_bytes(gzip.compress(text.encode())[:kept])
    mapping = load_mapping(str(write(tmp_path, "map.toml", MAPPING)))
    with pytest.raises(ConfigError, match=r"its end is missing: copy it here anew$"):
        read_flight(mapping, [file])
