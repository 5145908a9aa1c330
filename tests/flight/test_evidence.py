"""Evidence: our own flights in the layouts of others, and the captures of two autopilots."""

import contextlib
import csv
import gc
import gzip
import json
import math
import random
import struct
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from groundstation.analysis.evidence import import_command
from groundstation.analysis.evidence.evidence import (
    DrivenFlight,
    describe_flight,
    doubt_attitude,
    drive_flight,
    examine_flight,
    judge_filter,
    load_flight,
    measure_pose_noise,
)
from groundstation.analysis.evidence.flight import MEASURED, SETPOINT, Column
from groundstation.analysis.evidence.imports import load_mapping, read_flight
from groundstation.analysis.replay import replay_facts
from groundstation.config import ConfigError, from_dict, shipped_texts
from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.recording import Recording
from groundstation.settings import Config
from tests.known import known
from tests.recordings import recorded

GOLDEN = Path(__file__).parents[1] / "golden"
SECONDS = 12.0
"""Of the flight of ours [s]."""
FULL_N = 1.37
"""Its full thrust [N]."""
ATTITUDE_P = {"nanobench": 6.0, "neural-fly": 7.0}


@cache
def flown() -> list[tuple[float, Vec3, Quat, float, Vec3]]:
    """Each pose of a flight of ours: time [s], place, attitude, newest command (share, rates)."""
    rows, newest = [], None
    for entry in Recording(recorded("paper", duration_s=SECONDS)[0]).entries(
        ("/measured", "/command")
    ):
        value = entry.value()
        if entry.topic == "/command":
            w = value["rates_rad_s"]
            newest = value["thrust_n"] / FULL_N, (w["x"], w["y"], w["z"])
        elif newest is not None:
            rows.append((value["time_s"], place_of(value), attitude_of(value), *newest))
    return rows


def place_of(value: dict[str, Any]) -> Vec3:
    x, y, z = (value["position_ned"][axis] for axis in "xyz")
    return (x, y, z)


def attitude_of(value: dict[str, Any]) -> Quat:
    w, x, y, z = (value["attitude"][part] for part in "wxyz")
    return (w, x, y, z)


def wanted(attitude: Quat, rates: Vec3, gain: float) -> Quat:
    """The set-point that an attitude loop of this gain turns into ``rates``."""
    x, y, z = rates
    return so3.rotate(attitude, (x / gain, y / gain, z / gain))


def write_csv(path: Path, rows: Iterable[dict[str, Any]]) -> Path:
    rows = list(rows)
    begin = gzip.open if path.suffix == ".gz" else open
    with begin(path, "wt", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def nanobench(folder: Path) -> Path:
    """North, west, up; x y z w; pitch of the set-point counted the other way; thrust of 65535."""

    def row(t: float, p: Vec3, q: Quat, share: float, rates: Vec3) -> dict[str, float]:
        (x, y, z), (w, i, j, k) = p, q
        a, b, c, d = wanted(q, rates, ATTITUDE_P["nanobench"])
        roll, pitch, yaw = (math.degrees(angle) for angle in so3.euler_zyx((a, b, -c, -d)))
        curve = 0.57
        signal = (math.sqrt((1.0 - curve) ** 2 + 4.0 * curve * share) - 1.0 + curve) / (2.0 * curve)
        return {
            "t": 1.77e9 + t, "px": x, "py": -y, "pz": -z, "qx": i, "qy": -j, "qz": -k, "qw": w,
            "pid_controller_roll": roll, "pid_controller_pitch": -pitch, "pid_controller_yaw": yaw,
            "pid_controller_cmd_thrust": 65535.0 * signal,
            **{f"motor_motor_m{n}": 65535.0 * signal for n in (1, 2, 3, 4)},
            "sp_ctrltarget_x": x, "sp_ctrltarget_y": -y, "sp_ctrltarget_z": -z,
        }  # fmt: skip

    return write_csv(folder / "ours.csv.gz", (row(*one) for one in flown()))


def neural_fly(folder: Path) -> Path:
    """The same axes, lists in cells, a column without a name, thrust beside the hover thrust."""
    hover = 0.6

    def row(n: int, t: float, p: Vec3, q: Quat, share: float, rates: Vec3) -> dict[str, Any]:
        (x, y, z), (w, i, j, k) = p, q
        a, b, c, d = wanted(q, rates, ATTITUDE_P["neural-fly"])
        signal = (math.sqrt(0.45**2 + 4.0 * 0.55 * share) - 0.45) / 1.1
        level = hover + 0.001 * (n % 2)
        return {
            "": n, "t": t, "p": [x, -y, -z], "p_d": [x, -y, -z], "v": [0, 0, 0], "v_d": [0, 0, 0],
            "q": [i, -j, -k, w], "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "w": [0, 0, 0],
            "T_sp": [signal * level / (hover + 0.0005)], "q_sp": [b, -c, -d, a],
            "hover_throttle": [level],
        }  # fmt: skip

    rows = (row(n, *one) for n, one in enumerate(flown()))
    return write_csv(folder / "custom_figure8_ours_nowind.csv", rows)


def ulog(folder: Path, grounded_s: float | None = None) -> Path:
    """PX4's form (docs.px4.io, dev_log/ulog_file_format), landed until ``grounded_s``."""
    forms = {
        "vehicle_odometry": "uint64_t timestamp;uint64_t timestamp_sample;float[3] "
        "position;float[4] q;float[3] velocity;uint8_t reset_counter;",
        "vehicle_rates_setpoint": "uint64_t timestamp;float roll;float pitch;float yaw;float[3] "
        "thrust_body;",
        "vehicle_land_detected": "uint64_t timestamp;bool landed;",
    }
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    for name, form in forms.items():
        data += message("F", f"{name}:{form}".encode())
    for number, name in enumerate(forms):
        data += message("A", struct.pack("<BH", 0, number) + name.encode())
    for t, p, q, share, rates in flown():
        us = round(1e6 * t)
        data += message("D", struct.pack("<HQQ3f4f3fB", 0, us, us, *p, *q, 0.0, 0.0, 0.0, 3))
        data += message("D", struct.pack("<HQ3f3f", 1, us, *rates, 0.0, 0.0, -share))
        if grounded_s is not None:
            data += message("D", struct.pack("<HQB", 2, us, t - flown()[0][0] < grounded_s))
    path = folder / "ours.ulg"
    path.write_bytes(data)
    return path


def dataflash(folder: Path) -> Path:
    """ArduPilot's form: messages behind A3 95 and their type, described by type 128 (FMT)."""
    forms = {
        128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "<BB4s16s64s"),
        20: ("XKF1", "QBfffffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD", "<QB9f"),
        21: ("RATE", "Qfffffff", "TimeUS,RDes,R,PDes,P,YDes,Y,AOut", "<Q7f"),
    }

    def message(kind: int, *values: Any) -> bytes:
        return b"\xa3\x95" + bytes([kind]) + struct.pack(forms[kind][3], *values)

    data = b""
    for kind, (name, form, labels, packing) in forms.items():
        length = 3 + struct.calcsize(packing)
        data += message(128, kind, length, name.encode(), form.encode(), labels.encode())
    for t, p, q, share, rates in flown():
        us = round(1e6 * t)
        angles = [math.degrees(angle) for angle in so3.euler_zyx(q)]
        for core in (0, 1):  # the second EKF is somewhere else
            data += message(20, us, core, *angles, 0.0, 0.0, 0.0, *(x + 5.0 * core for x in p))
        roll, pitch, yaw = (math.degrees(rate) for rate in rates)
        data += message(21, us, roll, 0.0, pitch, 0.0, yaw, 0.0, share)
    path = folder / "ours.bin"
    path.write_bytes(data)
    return path


LAYOUTS: dict[str, Callable[[Path], Path]] = {
    "nanobench": nanobench,
    "neural-fly": neural_fly,
    "px4-ulog": ulog,
    "ardupilot-bin": dataflash,
}


def imported(folder: Path, path: Path, name: str = "nanobench") -> Path:
    """Recording of ``path`` by the mapping of that name, in the place of an older one."""
    out = folder / f"{name}.mcap"
    out.unlink(missing_ok=True)
    assert import_command([path], name, out) == 0
    return out


@pytest.mark.tried(3)  # layouts
@pytest.mark.parametrize("name", LAYOUTS)
def test_a_flight_of_ours_in_the_layout_of_others_comes_back_as_it_was(
    name: str, tmp_path: Path
) -> None:
    if name == "px4-ulog":
        pytest.importorskip("pyulog")
    path = imported(tmp_path, LAYOUTS[name](tmp_path), name)
    poses = [entry.value() for entry in Recording(path).entries(("/measured",))]
    setpoints = [entry.value() for entry in Recording(path).entries((SETPOINT,))]
    begun, curve = flown()[0][0], load_mapping(name).vehicle.thrust_curve
    assert len(poses) == len(setpoints) == len(flown())
    for seen, told, row in zip(poses, setpoints, flown(), strict=True):
        t, place, attitude, share, rates = row
        assert abs(seen["time_s"] - (t - begun)) < 2e-6
        assert math.dist(place_of(seen), place) < 1e-6
        assert math.hypot(*so3.turn_between(attitude, attitude_of(seen))) < 1e-5
        assert abs(curve * told["thrust"] ** 2 + (1.0 - curve) * told["thrust"] - share) < 1e-6
        if "attitude" in told:
            turn = so3.turn_between(attitude, attitude_of(told))
            assert math.dist([ATTITUDE_P[name] * x for x in turn], rates) < 1e-4
        else:
            assert math.dist(told["rates_rad_s"].values(), rates) < 1e-5


@pytest.fixture(scope="module")
def eight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The flight of ours as NanoBench has it, imported."""
    folder = tmp_path_factory.mktemp("eight")
    return imported(folder, nanobench(folder))


def test_a_flight_of_others_is_not_flown_again_but_examined(eight: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"no command of ours: `groundstation replay evidence .*nanobench\.mcap`"
    ):
        replay_facts(eight)


def test_an_autopilot_that_tells_when_it_flies_is_judged_there_alone(tmp_path: Path) -> None:
    pytest.importorskip("pyulog")
    facts = examine_flight(imported(tmp_path, ulog(tmp_path, grounded_s=3.0), "px4-ulog"))
    assert facts["flown_s"] == pytest.approx(flown()[-1][0] - flown()[0][0] - 3.0, abs=0.1)
    nothing_flies = "on the ground all the time: nothing flies in it"
    for grounded_s, why in ((99.0, nothing_flies), (10.5, "it flies for 1.5 s, limit 3 s")):
        facts = examine_flight(imported(tmp_path, ulog(tmp_path, grounded_s), "px4-ulog"))
        assert why in facts["note"] and why in describe_flight(facts)
        assert facts["prediction"] == {}
    with pytest.raises(ConfigError, match=r"holds \d+ poses of a flight, limit 50"):
        examine_flight(imported(tmp_path, ulog(tmp_path, 11.5), "px4-ulog"))


def test_a_recording_that_was_cut_off_says_so_with_its_figures(tmp_path: Path) -> None:
    whole, path = recorded("paper", duration_s=SECONDS)[0].read_bytes(), tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    assert "the recording was cut off. This is from" in describe_flight(examine_flight(path))
    path.write_bytes(whole[: len(whole) // 40])
    with pytest.raises(ConfigError, match=r"holds \d+ poses, limit 50; the recording was cut off"):
        examine_flight(path)


FIGURES = "name pose_hz gap_max_ms jitter_ms noise_across_mm noise_along_mm nis3"
KEYS = {*FIGURES.split(), "prediction", "identified", "told", "untold"}


@pytest.mark.parametrize("own", [True, False])
def test_prediction_of_a_flight_of_ours_beats_constant_velocity(own: bool, eight: Path) -> None:
    path = recorded("paper", duration_s=SECONDS)[0] if own else eight
    facts = json.loads(json.dumps(examine_flight(path)))
    assert set(facts) >= KEYS
    assert set(facts["prediction"]) == {"20", "40", "60", "100"}
    at_60 = facts["prediction"]["60"]
    assert at_60["rms_mm"] < 0.5 * at_60["pvt_rms_mm"]
    assert at_60["rms_mm"] < 2.0
    assert 0.7 < facts["nis3"] < 1.4
    assert facts["noise_across_mm"] == pytest.approx(0.3, rel=0.15)
    assert facts["pose_hz"] == pytest.approx(50.0, rel=0.01)
    assert "thrust_scale" in facts["identified"]
    # Of set-points of the attitude the rates are made here.
    assert ("rate_lag" in facts["identified"]) == own
    if own:
        return
    # What was told flies the filter that was judged.
    config = from_dict({"controller": facts["told"]}, Config)
    judged = judge_filter(drive_flight(load_flight(eight)), config.controller)
    assert judged.nis3 == facts["nis3"]
    assert judged.prediction == facts["prediction"]
    said = describe_flight(facts)
    assert all(f"{key} = {value:g}" in said for key, value in facts["told"].items())
    untold = facts["untold"]["prediction"]["60"]
    assert untold["rms_mm"] < 0.5 * untold["pvt_rms_mm"]
    assert f"60 ms, told nothing   {untold['rms_mm']:>9.2f}" in said


CAPTURES = [
    # Its simulated GPS wanders; the distance sensor leaves at 8.4 s.
    ("px4_takeoff", (0.15, 0.3), 25.5 - 8.3),
    ("ardupilot_landing", (0.0, 0.1), 88.8 - 58.0),  # "SIM Hit ground" at 88.8 s
]


@pytest.mark.tried(1)  # autopilots
@pytest.mark.parametrize(("name", "velocity_off_m_s", "flown_s"), CAPTURES)
def test_prediction_of_an_autopilots_flight_is_no_worse_than_constant_velocity(
    name: str, velocity_off_m_s: tuple[float, float], flown_s: float, tmp_path: Path
) -> None:
    facts = examine_flight(imported(tmp_path, GOLDEN / f"{name}.tlog", "ardupilot-tlog"))
    assert velocity_off_m_s[0] < facts["velocity_off_m_s"] < velocity_off_m_s[1]
    assert facts["flown_s"] == pytest.approx(flown_s, abs=0.5)
    at_60 = facts["prediction"]["60"]
    assert at_60["rms_mm"] <= at_60["pvt_rms_mm"]
    assert 0.7 < facts["nis3"] < 1.4
    assert facts["identified"]["rate_lag"]["value"] == pytest.approx(0.05, abs=0.015)
    found = [facts["identified"][which] for which in ("rate_lag", "rate_delay")]
    assert all(one["interval"][0] < one["value"] < one["interval"][1] for one in found)
    said = describe_flight(facts)
    assert all(f"{one['value']:.3g} (" in said for one in found)


def circle(hz: float, jitter_s: float, noise_m: float, count: int = 3000) -> tuple[Column, Column]:
    """Stamps, and places at 1.6 m/s about a point, seen at instants that are off the stamps."""
    draw = np.random.default_rng(1)
    stamps = np.arange(count) / hz
    phase = 1.6 * (stamps + jitter_s * draw.standard_normal(count))
    place = np.stack([np.cos(phase), np.sin(phase), 0.2 * np.sin(0.5 * phase) - 1.0], axis=1)
    return stamps, place + noise_m * draw.standard_normal(place.shape)


@pytest.mark.parametrize("jitter_s", [0.0, 0.4e-3, 1.8e-3])
def test_noise_across_the_motion_and_jitter_of_stamps_are_told_apart(jitter_s: float) -> None:
    noise = measure_pose_noise(*circle(100.0, jitter_s, 5e-5))
    assert noise.across_m == pytest.approx(5e-5, rel=0.15)
    assert noise.jitter_s == pytest.approx(jitter_s, rel=0.1, abs=2e-5)


def test_every_mapping_that_comes_along_is_one() -> None:
    assert all(load_mapping(name).title for name in shipped_texts("mappings"))


def test_what_is_wrong_with_an_import_is_said_by_its_key(tmp_path: Path) -> None:
    path = nanobench(tmp_path)
    out, bad, there = (tmp_path / name for name in ("out.mcap", "bad.toml", "there.mcap"))
    bad.write_text(
        'title = ""\nformat = "csv"\nsource = "autopilot"\n[[pose]]\nposition = ["x", "y"]\n'
    )
    there.write_bytes(b"")
    short = write_csv(tmp_path / "short.csv", [{"t": 0.0, "px": 0.0, "py": 0.0, "pz": 0.0}])
    for file, mapping, target, says in (
        (path, "nanobunch", out, r"--map.*nanobench"),
        (path, str(bad), out, "position"),
        (path, "neural-fly", out, r"holds no poses as the mapping has them.*ours.csv"),
        (short, "nanobench", out, "no column qx, qy, qz, qw"),
        (path, "nanobench", there, "is there already"),
        (path, "px4-ulog", out, "no ulog file"),
    ):
        with pytest.raises(ConfigError, match=says):
            import_command([file], mapping, target)


Row = dict[str, float]
Change = Callable[[int, Row], list[Row]]
"""The rows that stand in the place of one, by its number."""
QUATERNION = ("qx", "qy", "qz", "qw")


def poses_only(folder: Path, change: Change) -> Path:
    """NanoBench's columns of time and pose alone, of our flight, their rows changed."""
    names = ("t", "px", "py", "pz", *QUATERNION)
    with gzip.open(nanobench(folder), "rt", newline="") as file:
        rows = [{name: float(row[name]) for name in names} for row in csv.DictReader(file)]
    changed = [made for n, row in enumerate(rows) for made in change(n, row)]
    return write_csv(folder / "poses.csv", changed)


def driven(folder: Path, change: Change) -> DrivenFlight:
    """The flight with its rows changed."""
    return drive_flight(load_flight(imported(folder, poses_only(folder, change))))


LOGS: dict[str, Change] = {
    "a second is missing": lambda n, row: [] if 400 < n < 450 else [row],
    "the clock leaps": lambda n, row: [row | {"t": row["t"] + (1e6 if n > 500 else 0.0)}],
    "holes": lambda n, row: [row | ({"px": math.nan} if n % 25 == 3 else {})],
    "each thrice": lambda _, row: [row | {"t": row["t"] + 0.003 * k} for k in range(3)],
    # A quaternion and its negative are one attitude.
    "signs turned": lambda n, row: [row | {name: (-1) ** n * row[name] for name in QUATERNION}],
}


@pytest.mark.parametrize("change", LOGS.values(), ids=LOGS)
def test_faults_of_others_logs_leave_the_prediction_as_good(change: Change, tmp_path: Path) -> None:
    flight = driven(tmp_path, change)
    row = known(judge_filter(flight, flight.config.controller).prediction["60"])
    assert row["rms_mm"] < 0.7 * row["pvt_rms_mm"]


OTHER_TIME = r"time_unit: by 's' a pose comes every .* of another unit"
OTHER_PLACE = r"its positions move at .* m/s, limit 50 m/s: they are of no room.* position_unit"


@pytest.mark.parametrize(
    ("names", "factor", "says"),
    [
        *((["t"], factor, OTHER_TIME) for factor in (1e3, 1e-3)),
        (["px", "py", "pz"], 1e3, OTHER_PLACE),
    ],
)
def test_stamps_and_positions_of_another_unit_are_refused(
    names: list[str], factor: float, says: str, tmp_path: Path
) -> None:
    path = poses_only(tmp_path, lambda _, row: [row | {name: factor * row[name] for name in names}])
    with pytest.raises(ConfigError, match=says):
        import_command([path], "nanobench", tmp_path / "out.mcap")


def test_a_file_of_vicon_counts_frames_below_three_lines_of_names(tmp_path: Path) -> None:
    """As Vicon Tracker exports: the rate on a line of its own, objects, columns, units."""
    top = (
        "Objects\n100\n,,Global Angle quad:quad,,,Global Position,,\n"
        "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n,,deg,deg,deg,mm,mm,mm\n"
    )
    rows = [f"{n},0,0,0,0,{5 * n},{1000 - n},{n % 7}\n" for n in range(200)]
    (tmp_path / "take.csv").write_text(top + "".join(rows), "utf-8")
    (tmp_path / "vicon.toml").write_text(
        'title = "Vicon"\nformat = "csv"\nsource = "motion capture"\ntime = "Frame"\nframes_hz = '
        '100\nworld = "nwu"\n[[pose]]\nposition = ["TX", "TY", "TZ"]\nposition_unit = "mm"\n',
        "utf-8",
    )
    flight = read_flight(load_mapping(str(tmp_path / "vicon.toml")), [tmp_path / "take.csv"])
    pose = flight.of(MEASURED)[100]
    assert pose.time_s == pytest.approx(1.0)
    assert msgspec.structs.astuple(pose.position_ned) == pytest.approx((0.5, -0.9, -0.002))


def test_leaps_are_left_out_and_an_origin_that_moves_is_no_motion(tmp_path: Path) -> None:
    """Trackers that lose their body send zeros, a ghost, or the whole room moved aside."""

    def leap(n: int, row: Row) -> list[Row]:
        if n % 100 < 5:
            row = row | {"px": 0.0, "py": 0.0, "pz": 0.0}
        if n % 97 == 30:
            row = row | {"px": row["px"] + 5.0}
        if n > 450 and row["py"]:
            row = row | {"py": row["py"] + 1.0}
        return [row]

    facts = examine_flight(imported(tmp_path, poses_only(tmp_path, leap)))
    json.dumps(facts, allow_nan=False)
    assert facts["identified"] == {}  # there are no commands
    assert facts["left_out"]["poses that repeat the one before"] == 24
    assert facts["left_out"]["poses dropped by the gate, jump"] > 12
    assert facts["noise_across_mm"] == pytest.approx(0.3, rel=0.15)
    row = facts["prediction"]["60"]
    # 2.7: the gate wants a second to agree.
    assert row["rms_mm"] < min(3.0, 0.5 * row["pvt_rms_mm"])
    assert 0.7 < facts["nis3"] < 1.4


@pytest.mark.parametrize(
    "turned",
    [
        {},
        {"qx": "qw", "qy": "qx", "qz": "qy", "qw": "qz"},
        {"px": "py", "py": "px"},
        {"px": "10px", "py": "10py", "pz": "10pz"},
        {"qx": "-qx", "qy": "-qy", "qz": "-qz"},
    ],
    ids=["as it is", "order", "axes", "units", "direction"],
)
def test_attitudes_that_do_not_lean_as_the_vehicle_accelerates_are_told(
    turned: dict[str, str], tmp_path: Path
) -> None:
    """Nothing else shows that a mapping has the wrong order, axes or units."""

    def turn(_: int, row: Row) -> list[Row]:
        factors = {"10": 10.0, "-": -1.0, "": 1.0}
        return [row | {to: factors[of[:-2]] * row[of[-2:]] for to, of in turned.items()}]

    doubt = doubt_attitude(driven(tmp_path, turn))
    assert ("not as its attitude leans" in doubt) == bool(turned)


# pymavlink leaves open what it refuses.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", ["px4-ulog", "ardupilot-bin"])
def test_a_log_that_is_damaged_is_refused_or_read_as_far_as_it_goes_without_a_word_of_its_reader(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    if name == "px4-ulog":
        pytest.importorskip("pyulog")
    path, out, draw = LAYOUTS[name](tmp_path), tmp_path / "out.mcap", random.Random(8)
    whole = path.read_bytes()
    for damage in (0, 5, 12, 300, *(10 * [1]), *(4 * [300])):
        data = bytearray(whole if damage in (1, 300) else whole[:damage])
        for _ in range(8 * damage if len(data) == len(whole) else 0):
            data[draw.randrange(len(data))] = draw.randrange(256)
        path.write_bytes(data)
        out.unlink(missing_ok=True)
        with contextlib.suppress(ConfigError):
            import_command([path], name, out)
        said = capfd.readouterr()
        assert not said.err
        assert all(":" in line for line in said.out.splitlines())
    gc.collect()  # here, and not in the midst of another test
