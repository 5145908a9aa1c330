"""Recordings in which the system id alone does not tell the sender, and files that are no .tlog."""

import random
import struct
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.analysis.evidence.flight import MEASURED, SETPOINT, ImportedFlight
from groundstation.analysis.evidence.tlog import read_tlog
from groundstation.config import ConfigError
from links.mavlink.protocol import MavlinkCodec
from tests.tlog_flight import START_US, D, Flight

FLIGHT = Flight(duration_s=2.0)
COMPANION, BRIDGE, GIMBAL = (1, 191), (1, 197), (1, 154)


def read(folder: Path, data: bytes) -> ImportedFlight:
    file = folder / "flight.tlog"
    file.write_bytes(data)
    return read_tlog(file, 0.01)


def stamped(frames: list[tuple[int, bytes]]) -> bytes:
    return b"".join(struct.pack(">Q", START_US + us) + frame for us, frame in frames)


def test_a_companion_with_the_vehicles_system_id_commands_it(tmp_path: Path) -> None:
    usual = read(tmp_path, FLIGHT.tlog())
    assert len(usual.of(SETPOINT)) == 500
    found = read(tmp_path, Flight(duration_s=2.0, ground=COMPANION).tlog())
    assert found == usual


@pytest.mark.parametrize("bridge", [BRIDGE, (7, 197)])
def test_the_odometry_of_a_bridge_is_no_pose_of_the_vehicle(tmp_path: Path, bridge: tuple[int, int]) -> None:
    found = read(tmp_path, Flight(duration_s=2.0, bridge=bridge).tlog())
    assert found == read(tmp_path, FLIGHT.tlog())


def test_a_bridge_alone_flies_nothing_and_the_sender_of_its_poses_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"ODOMETRY of system 1, component 197\): record its ODOMETRY"):
        read(tmp_path, Flight(duration_s=2.0, bridge=BRIDGE, poses=lambda _: False).tlog())


def test_a_companion_that_calls_itself_an_autopilot_does_not_come_first(tmp_path: Path) -> None:
    heart = MavlinkCodec(*BRIDGE).pack(D.MAVLink_heartbeat_message(18, 0, 0, 0, 4, 3))
    flight = Flight(duration_s=2.0, bridge=BRIDGE)
    found = read(tmp_path, stamped([(0, heart), *flight.frames()]))
    assert found.of(MEASURED) == read(tmp_path, FLIGHT.tlog()).of(MEASURED)


def test_set_points_for_another_component_are_none_of_the_vehicles(tmp_path: Path) -> None:
    station = MavlinkCodec(255, 190)
    aside = [(2_000_000 + n, station.attitude_target(2.0, *GIMBAL, 0.9, (1.0, 1.0, 1.0))) for n in range(100)]
    everybody = [(2_500_000 + n, station.attitude_target(2.5, 1, 0, 0.9, (1.0, 1.0, 1.0))) for n in range(10)]
    frames = sorted([*FLIGHT.frames(), *aside, *everybody], key=lambda one: one[0])
    found = read(tmp_path, stamped(frames))
    assert len(found.of(SETPOINT)) == 510


def test_frames_without_time_stamps_are_no_flight(tmp_path: Path) -> None:
    raw = b"".join(frame for _, frame in FLIGHT.frames())
    with pytest.raises(ConfigError, match="MAVLink frames follow each other without time stamps"):
        read(tmp_path, raw)
    with pytest.raises(ConfigError, match="8 bytes of time before each frame"):
        read(tmp_path, b"\x00" * 40 + raw)  # begun in the middle of something


def test_a_file_of_mostly_garbage_is_no_flight(tmp_path: Path) -> None:
    noise = random.Random(3).randbytes
    records = [stamped([one]) for one in FLIGHT.frames()]
    data = b"".join(record + noise(2 * len(record)) for record in records)
    with pytest.raises(ConfigError, match=f"of {len(data)} bytes are no MAVLink record, limit 50%"):
        read(tmp_path, data)


OTHER_UNIT = r"s pass by the log times while 4\.98 s pass by the autopilot's own stamps"


@pytest.mark.parametrize(
    ("stamp", "says"),
    [
        (lambda _: bytes(8), r"all \d+ records have the same log time"),
        (lambda _: struct.pack(">Q", START_US), r"all \d+ records have the same log time"),
        (lambda us: struct.pack("<Q", us), "log times leap by more than 60 s, limit 50%"),  # the other end first
        (lambda us: struct.pack(">Q", int(1e-3 * us)), OTHER_UNIT),
        (lambda us: struct.pack(">Q", int(1e3 * us)), OTHER_UNIT),
    ],
    ids=["zeros", "never changes", "leaps", "milliseconds", "nanoseconds"],
)
def test_log_times_that_are_none_tell_no_flight(stamp: Callable[[int], bytes], says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=says):
        read(tmp_path, b"".join(stamp(START_US + us) + frame for us, frame in FLIGHT.frames()))


def test_poses_of_a_second_vehicle_are_counted_and_not_used(tmp_path: Path) -> None:
    heart = MavlinkCodec(2, 1).pack(D.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))
    found = read(tmp_path, stamped([(0, heart), *Flight(duration_s=2.0, bridge=(2, 1)).frames()]))
    usual = read(tmp_path, FLIGHT.tlog())
    assert found.messages == usual.messages
    assert found.notes == usual.notes + Counter({"poses of system 2, component 1": len(usual.of(MEASURED))})


def test_damage_that_leaves_most_of_a_flight_is_only_counted(tmp_path: Path) -> None:
    data = FLIGHT.tlog()
    found = read(tmp_path, data + bytes(4096))
    assert found.messages == read(tmp_path, data).messages
    assert found.notes["garbage"] == 4096
