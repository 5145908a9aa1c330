"""Simulator interfaces of PX4 and ArduPilot: golden bytes, noise of sensors, parameter files."""

import math
import statistics
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from groundstation.config import ConfigError
from groundstation.core.geometry import ZERO, Vec3, so3
from links.mavlink.protocol import MavlinkCodec
from sim.autopilots import Px4, ardupilot, px4
from sim.autopilots.onboard import read_parameters
from sim.autopilots.px4 import Outputs, SimulatorCodec
from sim.world import TrueState, generator, rows

PLACE = (1.0, -2.0, -1.5)
SPEED = (0.25, 0.5, -0.125)
RATES = (0.5, -0.25, 0.125)
STATE = TrueState(2.5, PLACE, SPEED, so3.IDENTITY, RATES, 9.81, on_ground=False)
FORCE: Vec3 = (0.5, -0.25, -9.75)
QUIET = (0.0,) * 10


def test_hil_sensor_has_its_golden_bytes() -> None:
    frame = SimulatorCodec().pack_sensors(1_004_000, STATE, FORCE, QUIET, 0)
    assert frame.hex() == (
        "fd3e000000f5be6b0000e0510f00000000000000003f000080be00001cc10000003f000080be0000003e"
        "f6285c3ea69b443c9a99d93e7b447d44000000000000c03f0000a041ff1b4ed6"
    )


def test_motor_outputs_are_read_from_golden_bytes() -> None:
    frame = bytes.fromhex(
        "fd5100000001015d0000e0510f000000000001000000000000000000003f0000803e0000403f0000803f"
        + "00" * 48
        + "81d1be"
    )
    assert list(SimulatorCodec().feed(frame)) == [Outputs(1_004_000, True, (0.5, 0.25, 0.75, 1.0))]


def test_servo_outputs_are_read_from_golden_bytes() -> None:
    few = bytes.fromhex("1a48900107000000e803e204dc05d007" + "00" * 24)
    servos = ardupilot.read_servos(few)
    assert servos is not None
    assert (servos.rate_hz, servos.frame) == (400, 7)
    assert servos.pulses_us[:4] == (1000, 1250, 1500, 2000)
    assert servos.motors == (0.0, 0.25, 0.5, 1.0)
    many = bytes.fromhex("8173900107000000e803e204dc05d007" + "00" * 56)
    assert ardupilot.read_servos(many) == servos._replace(pulses_us=(*servos.pulses_us, *[0] * 16))


@pytest.mark.parametrize(
    "packet", [b"", b"\x1a\x48", bytes.fromhex("1b48900107000000") + bytes(32), bytes(40)]
)
def test_what_is_no_servo_packet_is_none(packet: bytes) -> None:
    assert ardupilot.read_servos(packet) is None


def test_the_state_for_ardupilot_has_its_golden_bytes() -> None:
    assert ardupilot.write_state(2.5, STATE, FORCE) == (
        b'\n{"timestamp":2.5, "imu":{"gyro":[0.5, -0.25, 0.125], "accel_body":[0.5, -0.25, '
        b'-9.75]}, "position":[1.0, -2.0, -1.5], "quaternion":[1.0, 0.0, 0.0, 0.0], '
        b'"velocity":[0.25, 0.5, -0.125], "no_time_sync":1}\n'
    )


@pytest.mark.parametrize("thrust_n", [0.0, 9.81])
def test_sensors_of_px4_have_the_noise_of_its_own_simulator(thrust_n: float) -> None:
    codec, reader = SimulatorCodec(), MavlinkCodec(1, 1)
    state = TrueState(0.0, ZERO, ZERO, so3.IDENTITY, ZERO, thrust_n, on_ground=True)
    noise, weight = rows(generator(0, "test").standard_normal, 10), (0.0, 0.0, -9.81)
    frames = (codec.pack_sensors(4000 * k, state, weight, next(noise), k) for k in range(2000))
    seen = [message for frame in frames for message in reader.feed(frame)]
    rests = {"xacc": 0.1, "yacc": 0.1, "zacc": 0.1, "xgyro": 0.01, "ygyro": 0.01, "zgyro": 0.01}
    turns = {"xacc": 0.5, "yacc": 1.7, "zacc": 1.4, "xgyro": 0.14, "ygyro": 0.07, "zgyro": 0.03}
    ever = {"xmag": 0.02, "ymag": 0.02, "zmag": 0.03, "abs_pressure": 0.01}
    expected = ever | (turns if thrust_n else rests)
    found = {name: statistics.stdev(getattr(one, name) for one in seen) for name in expected}
    assert found == pytest.approx(expected, rel=0.06)
    assert statistics.mean(one.zacc for one in seen) == pytest.approx(-9.81, abs=0.1), "gravity"


def test_slower_sensors_are_new_at_their_own_rates() -> None:
    codec, reader = SimulatorCodec(), MavlinkCodec(1, 1)
    fields = [
        reader.feed(codec.pack_sensors(4000 * k, STATE, FORCE, QUIET, k))[0].fields_updated
        for k in range(250)
    ]
    assert sum(bool(one & 0b111111) for one in fields) == 250, "accelerometer and gyro"
    assert sum(bool(one & 0b111000000) for one in fields) == 125, "magnetometer"
    assert sum(bool(one & 0b1101000000000) for one in fields) == 50, "barometer"


@pytest.mark.parametrize("name", ["px4.params", "ardupilot.parm"])
def test_every_parameter_has_a_number_and_a_reason_and_is_told_once(name: str) -> None:
    told = read_parameters(name)
    assert len({one.name for one in told}) == len(told) > 20
    assert all(math.isfinite(float(one.value)) for one in told)
    assert all(len(one.name) <= 16 and one.reason for one in told)


@pytest.mark.parametrize(
    ("find", "key"), [(px4.find_program, "--px4"), (ardupilot.find_program, "--ardupilot")]
)
def test_a_folder_in_which_nothing_was_built_is_one_sentence(
    find: Callable[[Path], Path], key: str, tmp_path: Path
) -> None:
    says = f"{key}: expected a folder in which .* there is no {tmp_path}"
    with pytest.raises(ConfigError, match=says):
        find(tmp_path)


# ---- PX4's MAVLink port in lockstep: what was said has been taken before the next step

THEIRS = ("127.0.0.1", 14580)


class Port:
    """The firmware's port; PX4 behind it ``answers`` a TIMESYNC after some telemetry."""

    def __init__(self) -> None:
        self.answers = True
        self.said: list[bytes] = []
        self.waits: deque[bytes] = deque()
        self._codec = MavlinkCodec(1, 1)

    def sendto(self, data: bytes, to: tuple[str, int]) -> None:
        assert to == THEIRS
        self.said.append(data)
        for question in self._codec.feed(data):
            if self.answers:
                self.waits.extend((b"telemetry", self._codec.timesync_reply(question, 3.0)))

    def recv(self, size: int) -> bytes:
        del size
        return self.waits.popleft()

    def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
        if not self.waits:
            raise BlockingIOError
        return self.recv(size), THEIRS

    def close(self) -> None:
        pass


@pytest.fixture
def port() -> Port:
    return Port()


@pytest.fixture
def firmware(tmp_path: Path, port: Port, monkeypatch: pytest.MonkeyPatch) -> Px4:
    one = Px4(tmp_path / "px4", tmp_path, iter(()))
    one.mavlink.close()
    one.mavlink = port  # type: ignore[assignment]  # what it needs of one

    def select(reads: list[Any], *_: object) -> tuple[list[Any], list[Any], list[Any]]:
        return (reads if port.waits else []), [], []

    monkeypatch.setattr(px4, "select", select)
    return one


def test_the_plant_waits_until_its_thread_has_taken_what_was_said(
    firmware: Px4, port: Port
) -> None:
    port.waits.append(b"first")
    assert firmware.hear() == [b"first"]
    firmware.say_all([b"one", b"two"])
    assert port.said[:2] == [b"one", b"two"]
    assert not port.waits, "it was waited for"
    assert firmware.hear() == [b"telemetry"], "the answer is ours alone"


def test_a_thread_that_sleeps_in_the_plants_time_is_not_waited_for(
    firmware: Px4, port: Port
) -> None:
    port.waits.append(b"first")
    firmware.hear()
    port.answers = False
    firmware.say_all([b"one"])
    (question,) = MavlinkCodec(1, 1).feed(port.said[-1])
    port.waits.extend((MavlinkCodec(1, 1).timesync_reply(question, 3.0), b"telemetry"))
    assert firmware.hear() == [b"telemetry"], "an answer that comes later is ours, too"


def test_before_it_has_spoken_nothing_is_said(firmware: Px4, port: Port) -> None:
    firmware.say_all([b"one"])
    assert port.said == []
