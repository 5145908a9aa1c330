"""Evidence from PX4's and ArduPilot's recordings of real flights (tests/golden/README.md)."""

import struct
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from groundstation.analysis.evidence.flight import MEASURED, SETPOINT, ImportedFlight
from groundstation.analysis.evidence.tlog import read_tlog
from groundstation.core.messages import Pose
from groundstation.recording import read_pose

GOLDEN = Path(__file__).parents[3] / "golden"
PX4, ARDUPILOT = GOLDEN / "px4_takeoff.tlog", GOLDEN / "ardupilot_landing.tlog"
LATENCY_S = 0.01
ODOMETRY, LOCAL_POSITION_NED, ATTITUDE_QUATERNION, SET_ATTITUDE_TARGET = 331, 32, 31, 82


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
