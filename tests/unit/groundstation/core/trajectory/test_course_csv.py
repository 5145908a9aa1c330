"""Courses as CSV: what is read or refused in which words, and how it gets into a configuration."""

from pathlib import Path

import pytest

from groundstation.__main__ import main
from groundstation.config import ConfigError, dump, load
from groundstation.core.trajectory import parse_course
from groundstation.core.trajectory.shapes import SamplesConfig, WaypointsConfig
from groundstation.settings import Config
from tests.e2e.stations import run_here

GOOD = """# a comment
t_s, north_m, east_m, up_m, yaw_deg

0, 1, 2, 3, 90
2.5, -1, 0, 1.5, 80
"""


def test_names_tell_the_columns_and_heights_become_ned() -> None:
    assert parse_course(GOOD) == {
        "points_ned": [[1.0, 2.0, -3.0], [-1.0, 0.0, -1.5]],
        "times_s": [0.0, 2.5],
        "yaws_deg": [90.0, 80.0],
    }


def test_short_names_are_ned_and_columns_stand_in_any_order() -> None:
    text = "z,y,x,vz,vy,vx\r\n-1,2,3,4,5,6\r\n-2,0,0,0,0,0\r\n"
    assert parse_course(text) == {
        "points_ned": [[3.0, 2.0, -1.0], [0.0, 0.0, -2.0]],
        "velocities_ned": [[6.0, 5.0, 4.0], [0.0, 0.0, 0.0]],
    }


NAMES = "such as t_s,north_m,east_m,up_m,yaw_deg"
NO_LINES = f"expected a line of names, {NAMES}, and 2 or more lines of numbers"
NO_NAME = f"line 1: expected names of columns, {NAMES}, got"
NO_NUMBER = "expected a number from -100 to 100, got"
REFUSED = [
    ("", NO_LINES),
    ("x,y,z\n1,2,3\n", NO_LINES),
    ("1,2,3\n4,5,6\n", f"{NO_NAME} '1'"),
    ("x,y,height\n", f"{NO_NAME} 'height'"),
    ("x,y\n", "line 1: expected a column down_m or up_m: none of them is there"),
    ("x,y,z,up_m\n", "line 1: expected a column down_m or up_m: only one of them"),
    ("x,north_m,y,z\n", "line 1: the column north_m is there twice"),
    ("x,y,z,vx\n", "line 1: expected a column v_east_m_s: none of them is there"),
    ("x,y,z\n1,2,3\n1,2\n", "line 3: expected 3 values, got 2"),
    ("# a\nx,y,z\n1,2,3\n1,abc,3\n", f"line 4, column east_m: {NO_NUMBER} 'abc'"),
    ("x,y,z\n1,2,3\n1,nan,3\n", f"line 3, column east_m: {NO_NUMBER} 'nan'"),
    ("x,y,up_m\n1,2,3\n1,2,150\n", f"line 3, column up_m: {NO_NUMBER} '150'"),
    ("x,y,z\n1,2,3\n1,,3\n", f"line 3, column east_m: {NO_NUMBER} ''"),
    (
        "t,x,y,z\n1,1,2,3\n1,1,2,3\n",
        "line 3, column t_s: expected more than 1, as before it, got 1",
    ),
]


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_a_bad_line_is_refused_with_its_number_and_its_column(text: str, words: str) -> None:
    with pytest.raises(ValueError, match="line") as caught:
        parse_course(text)
    assert str(caught.value).startswith(words)


def configured(folder: Path, course: str, *lines: str, kind: str = "waypoints") -> Config:
    (folder / "course.csv").write_text(course, "utf-8")
    settings = "\n".join(("[trajectory]", f'kind = "{kind}"', 'file = "course.csv"', *lines))
    (folder / "lab.toml").write_text(settings, "utf-8")
    return load(folder / "lab.toml", Config)


def test_a_configuration_finds_its_course_beside_itself_and_needs_it_no_more(
    tmp_path: Path,
) -> None:
    config = configured(tmp_path, GOOD, 'method = "quintic"')
    expected = WaypointsConfig(
        points_ned=((1.0, 2.0, -3.0), (-1.0, 0.0, -1.5)),
        times_s=(0.0, 2.5),
        yaws_deg=(90.0, 80.0),
        method="quintic",
    )
    assert config.trajectory == expected
    (tmp_path / "course.csv").unlink()
    (tmp_path / "shown.toml").write_text(dump(config), "utf-8")
    assert load(tmp_path / "shown.toml", Config) == config


def test_a_course_with_a_byte_order_mark_is_read_and_samples_take_velocities(
    tmp_path: Path,
) -> None:
    course = "\ufefft,x,y,z,vx,vy,vz\n0,0,0,-1,0,0,0\n1,1,0,-1,2,0,0\n"
    config = configured(tmp_path, course, kind="samples")
    assert isinstance(config.trajectory, SamplesConfig)
    assert config.trajectory.velocities_ned == ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0))


BAD_COURSES = [
    ("waypoints", "x,y,z 1,2,3 4,b,6",
        "file: course.csv: line 3, column east_m: expected a number"),
    ("waypoints", "x,y,z 1,2,3 4,1_0,6",
        "file: course.csv: line 3, column east_m: expected a number from -100 to 100, got '1_0'"),
    ("samples", "x,y,z 1,2,3 4,5,6", "times_s: missing; expected an array of 2 to 50000 values"),
    ("waypoints", "x,y,z,vx,vy,vz 1,2,3,4,5,6 4,5,6,7,8,9",
     "file: course.csv: has velocities_ned, which trajectory.kind = 'waypoints' can't use"),
    ("waypoints", "t,x,y,z 0,0,0,-1 5000,1,0,-1 9000,1,2,-1",
     "times_s: 3 m in 9000 s is slower than 1 mm/s: times count in seconds"),
    ("samples", "t,x,y,z,vx,vy,vz 0,0,0,-1,0,0,0 1,1,0,-1,400,0,0",
     "file: course.csv: line 3, column v_north_m_s: expected a number from -50 to 50, got '400'"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "lines", "words"), BAD_COURSES, ids=[words for _, _, words in BAD_COURSES]
)
def test_a_bad_course_is_refused_as_part_of_its_configuration(
    kind: str, lines: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as caught:
        configured(tmp_path, lines.replace(" ", "\n"), kind=kind)
    assert str(caught.value).startswith(f"{tmp_path / 'lab.toml'}: trajectory.{words}")


def test_times_may_count_from_1970_and_a_course_may_stay_at_one_place_for_an_hour(
    tmp_path: Path,
) -> None:
    course = "t,x,y,z\n1764408600,0,0,-1\n1764408610.5,0.5,0,-1\n"
    assert configured(tmp_path, course).trajectory.build().duration_s == 10.5
    course = "t,x,y,z\n0,0,0,-1\n3600,0.01,0,-1\n"
    assert configured(tmp_path, course, kind="samples").trajectory.build().duration_s == 3600.0


def test_points_in_the_file_and_in_the_configuration_are_one_too_many(tmp_path: Path) -> None:
    says = r"course\.csv: has points_ned too: leave out trajectory\.points_ned"
    with pytest.raises(ConfigError, match=says):
        configured(tmp_path, GOOD, "points_ned = [[0, 0, -1], [1, 0, -1]]")


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("'gone.csv'", r"cannot read .*gone\.csv: No such file or directory$"),
        ("3", "expected a string, got 3$"),
    ],
)
def test_a_course_that_is_not_there_is_named(file: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(f"trajectory = {{ kind = 'waypoints', file = {file} }}")
    with pytest.raises(ConfigError, match=rf"trajectory\.file: {says}"):
        load(tmp_path / "lab.toml", Config)


@pytest.mark.parametrize(("words", "says"), [
    (["goto", "nan", "0", "-1"], "goto: north_m: expected a number from -100 to 100, got nan"),
    (["goto", "0", "0", "-1", "1e9"],
        "goto: yaw_deg: expected a number from -360 to 360, got 1000000000.0"),
    (["follow", "turned.csv"],
        "turned.csv: point 2: yaw_deg: expected a number from -360 to 360, got 400.0"),
    (["goto", "1", "2"], "goto: expected NORTH EAST DOWN [YAW], got 2 numbers"),
    (["goto", "1_0", "0", "-1"], "goto: expected NORTH EAST DOWN [YAW] in numbers, got '1_0 0 -1'"),
    (["goto", "1", "b", "-1"], "goto: expected NORTH EAST DOWN [YAW] in numbers, got '1 b -1'"),
    (["follow", "huge.csv"], "expected at most 64 points, got 50000"),
    (["follow", "empty.csv"], "yaw_deg, and 1 or more lines of numbers"),
    (["follow", "picture.csv"], "picture.csv: not UTF-8 text"),
    (["follow", "nan.csv"],
        "nan.csv: line 2, column north_m: expected a number from -100 to 100, got 'nan'"),
    (["follow", "many.csv"], "follow: expected at most 64 points, got 65"),
    (["land", "3"], "land: takes nothing behind it"),
])  # fmt: skip
def test_points_that_lead_nowhere_are_refused_before_anybody_is_asked(
    words: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    head = "north_m,east_m,down_m\n"
    Path("huge.csv").write_text(head + "0,0,-1\n" * 50_000)
    Path("empty.csv").touch()
    Path("picture.csv").write_bytes(bytes(range(256)))
    Path("nan.csv").write_text(head + "nan,0,-1\n0,0,-1\n")
    Path("turned.csv").write_text("north_m,east_m,down_m,yaw_deg\n0,0,-1,90\n0,0,-1,400\n")
    Path("many.csv").write_text(head + "".join(f"{0.1 * i},0,-1\n" for i in range(65)))
    done = run_here(main, "request", *words)
    assert done.returncode == 2 and says in done.stderr
