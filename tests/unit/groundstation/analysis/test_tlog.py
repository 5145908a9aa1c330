"""Flights as .tlog: made-up ones, fully known, and real ones (tests/golden/README.md)."""

import json
import random
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from groundstation.analysis.evidence.evidence import (
    describe_flight,
    drive_flight,
    examine_flight,
    judge_filter,
    load_flight,
)
from groundstation.analysis.evidence.flight import MEASURED, SETPOINT, ImportedFlight
from groundstation.analysis.evidence.tlog import read_tlog
from groundstation.config import ConfigError
from groundstation.core.messages import Pose
from groundstation.recording import read_pose
from links.mavlink.protocol import MavlinkCodec
from tests.tlog_flight import START_US, D, Flight

FLIGHT = Flight(duration_s=2.0)
COMPANION, BRIDGE, GIMBAL = (1, 191), (1, 197), (1, 154)


def read(folder: Path, data: bytes) -> ImportedFlight:
    file = folder / "flight.tlog"
    file.write_bytes(data)
    return read_tlog(file, 0.01)


@pytest.fixture
def usual(tmp_path: Path) -> ImportedFlight:
    return read(tmp_path, FLIGHT.tlog())


def stamped(frames: list[tuple[int, bytes]]) -> bytes:
    return b"".join(struct.pack(">Q", START_US + us) + frame for us, frame in frames)


def test_a_companion_with_the_vehicles_system_id_commands_it(
    tmp_path: Path, usual: ImportedFlight
) -> None:
    assert len(usual.of(SETPOINT)) == 500
    assert read(tmp_path, Flight(duration_s=2.0, ground=COMPANION).tlog()) == usual


@pytest.mark.parametrize("bridge", [BRIDGE, (7, 197)])
def test_the_odometry_of_a_bridge_is_no_pose_of_the_vehicle(
    tmp_path: Path, bridge: tuple[int, int], usual: ImportedFlight
) -> None:
    assert read(tmp_path, Flight(duration_s=2.0, bridge=bridge).tlog()) == usual


def test_a_bridge_alone_flies_nothing_and_the_sender_of_its_poses_is_named(tmp_path: Path) -> None:
    flight = Flight(duration_s=2.0, bridge=BRIDGE, poses=lambda _: False)
    says = r"ODOMETRY of system 1, component 197\): record its ODOMETRY"
    with pytest.raises(ConfigError, match=says):
        read(tmp_path, flight.tlog())


def test_a_companion_that_calls_itself_an_autopilot_does_not_come_first(
    tmp_path: Path, usual: ImportedFlight
) -> None:
    heart = MavlinkCodec(*BRIDGE).pack(D.MAVLink_heartbeat_message(18, 0, 0, 0, 4, 3))
    flight = Flight(duration_s=2.0, bridge=BRIDGE)
    found = read(tmp_path, stamped([(0, heart), *flight.frames()]))
    assert found.of(MEASURED) == usual.of(MEASURED)


def test_set_points_for_another_component_are_none_of_the_vehicles(tmp_path: Path) -> None:
    station = MavlinkCodec(255, 190)
    spins = (0.9, (1.0, 1.0, 1.0))
    aside = [(2_000_000 + n, station.attitude_target(2.0, *GIMBAL, *spins)) for n in range(100)]
    everybody = [(2_500_000 + n, station.attitude_target(2.5, 1, 0, *spins)) for n in range(10)]
    frames = sorted([*FLIGHT.frames(), *aside, *everybody], key=lambda one: one[0])
    found = read(tmp_path, stamped(frames))
    assert len(found.of(SETPOINT)) == 510


def test_frames_without_time_stamps_are_no_flight(tmp_path: Path) -> None:
    raw = b"".join(frame for _, frame in FLIGHT.frames())
    with pytest.raises(ConfigError, match="are no MAVLink record, limit 10%"):
        read(tmp_path, raw)
    with pytest.raises(ConfigError, match="8 bytes of time before each frame"):
        read(tmp_path, b"\x00" * 40 + raw)  # begun in the middle of something


def test_a_file_of_mostly_garbage_is_no_flight(tmp_path: Path) -> None:
    noise = random.Random(3).randbytes
    records = [stamped([one]) for one in FLIGHT.frames()]
    data = b"".join(record + noise(2 * len(record)) for record in records)
    with pytest.raises(ConfigError, match=f"of {len(data)} bytes are no MAVLink record, limit 10%"):
        read(tmp_path, data)


SAME = r"all \d+ records have the same log time"
LEAPS = "log times leap by more than 60 s, limit 50%"


@pytest.mark.parametrize(
    ("stamp", "says"),
    [
        (lambda _: bytes(8), SAME),
        (lambda _: struct.pack(">Q", START_US), SAME),
        (lambda us: struct.pack("<Q", us), LEAPS),  # the other end first
    ],
    ids=["zeros", "never changes", "leaps"],
)
def test_log_times_that_are_none_tell_no_flight(
    stamp: Callable[[int], bytes], says: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=says):
        read(tmp_path, b"".join(stamp(START_US + us) + frame for us, frame in FLIGHT.frames()))


@pytest.mark.parametrize("byte", [3, 5])
@pytest.mark.parametrize("at", [0, 200])
def test_a_damaged_log_time_does_not_hold_up_the_records_behind_it(
    at: int, byte: int, tmp_path: Path, usual: ImportedFlight
) -> None:
    """One bit: 17 s, which are no leap, and 13 days."""
    records = [bytearray(stamped([one])) for one in FLIGHT.frames()]
    records[at][7 - byte] ^= 1
    found = read(tmp_path, b"".join(records))
    assert len(found.of(MEASURED)) >= len(usual.of(MEASURED)) - 2


def test_poses_of_a_second_vehicle_are_counted_and_not_used(
    tmp_path: Path, usual: ImportedFlight
) -> None:
    heart = MavlinkCodec(2, 1).pack(D.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))
    found = read(tmp_path, stamped([(0, heart), *Flight(duration_s=2.0, bridge=(2, 1)).frames()]))
    assert found.messages == usual.messages
    strangers = Counter({"poses of system 2, component 1": len(usual.of(MEASURED))})
    assert found.notes == usual.notes + strangers


def test_damage_that_leaves_most_of_a_flight_is_only_counted(
    tmp_path: Path, usual: ImportedFlight
) -> None:
    found = read(tmp_path, FLIGHT.tlog() + bytes(4096))
    assert found.messages == usual.messages
    assert found.notes["garbage"] == 4096


NO_LAG = ("vehicle.thrust_lag_s=0.0", "vehicle.rate_lag_s=0.0")


def written(flight: Flight, folder: Path) -> Path:
    file = folder / "flight.tlog"
    file.write_bytes(flight.tlog())
    return file


@pytest.mark.parametrize(
    ("stamp_us", "left_out"),
    [
        (lambda us: us - 40_000 if us and us % 100_000 == 0 else us, {"out_of_order": 109}),
        (lambda us: us - 20_000 if us == 4_000_000 else us, {"same_stamp": 1}),
    ],
)
def test_stamps_that_repeat_or_run_back_are_counted(
    stamp_us: Callable[[int], int], left_out: dict[str, int], tmp_path: Path
) -> None:
    assert load_flight(written(Flight(stamp_us=stamp_us), tmp_path)).left_out == left_out


def test_a_jump_with_a_reset_is_not_taken_for_motion(tmp_path: Path) -> None:
    def judged(flight: Flight) -> float:
        driven = drive_flight(load_flight(written(flight, tmp_path)), NO_LAG)
        row = judge_filter(driven, driven.config.controller).prediction["60"]
        assert row is not None
        return row["rms_mm"]

    moved = Flight(moved=lambda t: (3.0, 7) if t >= 5.0 else (0.0, 6))
    assert judged(moved) < 1.5 * judged(Flight())


def test_a_velocity_that_is_not_that_of_the_positions_and_an_outage_are_found_out(
    tmp_path: Path,
) -> None:
    flight = Flight(velocity_error=(0.0, 0.05, 0.0), poses=lambda t: not 4.0 < t < 4.35)
    found = examine_flight(written(flight, tmp_path), None, NO_LAG)
    assert found["gap_max_ms"] == pytest.approx(350.0, abs=21.0)
    assert found["velocity_off_m_s"] == pytest.approx(0.05, abs=0.01)
    says = f"its own velocity is {found['velocity_off_m_s']:.3f} m/s RMS from"
    assert says in describe_flight(found)


SHORT = FLIGHT.tlog()


@given(st.data())
def test_no_damage_to_a_file_makes_a_replay_fail(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    damaged = bytearray(SHORT)
    for _ in range(data.draw(st.integers(1, 20))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("damaged") / "flight.tlog"
    file.write_bytes(damaged[: data.draw(st.integers(3 * len(damaged) // 4, len(damaged)))])
    found = examine_flight(file)
    json.dumps(found, allow_nan=False)
    assert describe_flight(found)


# ---- real flights

GOLDEN = Path(__file__).parents[3] / "golden"
PX4 = GOLDEN / "px4_takeoff.tlog"
ARDUPILOT = GOLDEN / "ardupilot_landing.tlog"
LATENCY_S = 0.01
ODOMETRY = D.MAVLINK_MSG_ID_ODOMETRY
LOCAL_POSITION_NED = D.MAVLINK_MSG_ID_LOCAL_POSITION_NED
ATTITUDE_QUATERNION = D.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
SET_ATTITUDE_TARGET = D.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET


@cache
def recording(path: Path) -> ImportedFlight:
    return read_tlog(path, LATENCY_S)


def payloads(path: Path, number: int, size: int) -> Iterator[bytes]:
    """The payloads of one message, from the bytes, with the zeros that MAVLink left out."""
    data = path.read_bytes()
    start = 0
    while start < len(data):
        length = data[start + 9]
        assert data[start + 8] == 0xFD and data[start + 10] == 0
        if int.from_bytes(data[start + 15 : start + 18], "little") == number:
            yield data[start + 18 : start + 18 + length].ljust(size, b"\0")
        start += 8 + 12 + length


def numbers(pose: Pose) -> tuple[object, ...]:
    return (pose.position_ned, pose.attitude, pose.velocity_ned, pose.reset_count)


def test_poses_of_px4_are_its_own_numbers_to_the_last_bit() -> None:
    expected = []
    for payload in payloads(PX4, ODOMETRY, 233):
        _, x, y, z, qw, qx, qy, qz, vx, vy, vz = struct.unpack_from("<Q10f", payload)
        frames = payload[228:230]
        assert frames == b"\1\1"  # both NED: its velocity is not in the body's frame
        expected.append(((x, y, z), (qw, qx, qy, qz), (vx, vy, vz), payload[230]))
    assert [numbers(read_pose(seen)) for seen in recording(PX4).of(MEASURED)] == expected
    assert len(expected) > 900


def test_poses_of_ardupilot_are_its_own_numbers_to_the_last_bit() -> None:
    attitudes = {}
    for payload in payloads(ARDUPILOT, ATTITUDE_QUATERNION, 48):
        boot_ms, *quaternion = struct.unpack_from("<I4f", payload)
        attitudes[boot_ms] = tuple(quaternion)
    expected = []
    for payload in payloads(ARDUPILOT, LOCAL_POSITION_NED, 28):
        boot_ms, x, y, z, vx, vy, vz = struct.unpack("<I6f", payload)
        expected.append(((x, y, z), attitudes[boot_ms], (vx, vy, vz), 0))
    assert [numbers(read_pose(seen)) for seen in recording(ARDUPILOT).of(MEASURED)] == expected
    assert len(expected) > 1700


@pytest.mark.parametrize("path", [PX4, ARDUPILOT], ids=lambda path: path.stem)
def test_set_points_are_those_that_were_sent(path: Path) -> None:
    expected = []
    for payload in payloads(path, SET_ATTITUDE_TARGET, 39):
        *rates, thrust = struct.unpack_from("<4f", payload, 20)
        expected.append((tuple(rates), thrust))
    sent = recording(path).of(SETPOINT)
    assert [
        ((one.rates_rad_s.x, one.rates_rad_s.y, one.rates_rad_s.z), one.thrust) for one in sent
    ] == expected
