"""Simulator interfaces of PX4 and ArduPilot on any bytes, and on any state."""

import json

from hypothesis import given, strategies as st

from groundstation.core.geometry import Vec3
from links.mavlink.protocol import MavlinkCodec
from sim.autopilots.ardupilot import read_servos, write_state
from sim.autopilots.px4 import SimulatorCodec
from sim.world import TrueState

numbers = st.floats(-1e4, 1e4)
vectors = st.tuples(numbers, numbers, numbers)
any_float = st.floats(width=32)


def frame(controls: list[float]) -> bytes:
    codec = MavlinkCodec(1, 1)
    return codec.pack(codec.dialect.MAVLink_hil_actuator_controls_message(4000, controls, 129, 1))


outputs = st.lists(any_float, min_size=16, max_size=16).map(frame)


@given(st.lists(st.one_of(outputs, st.binary(max_size=100)), max_size=5), st.integers(1, 50))
def test_no_bytes_from_px4_turn_a_rotor_beyond_its_limits(chunks: list[bytes], cut: int) -> None:
    codec, data = SimulatorCodec(), b"".join(chunks)
    for at in range(0, len(data), cut):
        for one in codec.feed(data[at : at + cut]):
            assert all(0.0 <= motor <= 1.0 for motor in one.motors)


@given(
    st.one_of(
        st.binary(max_size=80),
        st.binary(min_size=38, max_size=38).map(lambda tail: b"\x1a\x48" + tail),
    )
)
def test_no_packet_from_ardupilot_turns_a_rotor_beyond_its_limits(packet: bytes) -> None:
    servos = read_servos(packet)
    if servos is not None:
        assert all(0.0 <= motor <= 1.0 for motor in servos.motors)
        assert len(servos.pulses_us) == (32 if packet[:2] == (29569).to_bytes(2, "little") else 16)


@given(st.floats(0.0, 1e6), vectors, vectors, vectors, vectors)
def test_a_state_for_ardupilot_loses_nothing(
    time_s: float, position: Vec3, velocity: Vec3, rates: Vec3, force: Vec3
) -> None:
    state = TrueState(time_s, position, velocity, (1.0, 0.0, 0.0, 0.0), rates, 0.0, on_ground=False)
    line = write_state(time_s, state, force)
    assert line.count(b"\n") == 2
    read = json.loads(line)
    assert read["timestamp"] == time_s
    assert [tuple(read[key]) for key in ("position", "velocity")] == [position, velocity]
    assert [tuple(read["imu"][key]) for key in ("gyro", "accel_body")] == [rates, force]
