"""links/mavlink/protocol/procedures.py: numbers in both encodings, reading many, setting one."""

import math
import struct
from typing import Any

import pytest
from hypothesis import given, strategies as st

from links.core import LinkRejected
from links.mavlink.protocol import (
    ARDUPILOT,
    PX4,
    WHOLE_BITS,
    AutopilotAddress,
    AutopilotParameter,
    MavlinkCodec,
    MavParamType,
    ReadAll,
    Words,
    Write,
    decode,
    encode,
)

# By their numbers: a limit that the test took from the code would bear out any value.
ASKED = 4
AT_ONCE = 8

INT8 = MavParamType.INT8
INT32 = MavParamType.INT32
REAL32 = MavParamType.REAL32


@pytest.mark.parametrize(
    ("autopilot", "value", "kind", "wire"),
    [
        (PX4, 8.0, INT32, "08000000"),
        (PX4, -1.0, INT32, "ffffffff"),
        (PX4, 4.0, 1, "04000000"),
        (PX4, 0.5, REAL32, "0000003f"),
        (ARDUPILOT, 8.0, INT32, "00000041"),
        (ARDUPILOT, -1.0, INT8, "000080bf"),
        (ARDUPILOT, 0.5, REAL32, "0000003f"),
    ],
)
def test_a_value_has_these_bytes(autopilot: int, value: float, kind: int, wire: str) -> None:
    number = encode(autopilot, value, kind)
    if not math.isnan(number):  # a NaN's bits need not survive the way through a double
        assert struct.pack("<f", number).hex() == wire
    (read,) = struct.unpack("<f", bytes.fromhex(wire))
    assert decode(autopilot, read, kind) == value


@given(st.sampled_from([PX4, ARDUPILOT]), st.sampled_from(sorted(WHOLE_BITS)), st.integers(-(2**24), 2**24))
def test_every_whole_number_comes_back_or_is_refused(autopilot: int, kind: int, number: int) -> None:
    bits, signed = WHOLE_BITS[kind]
    low = -(1 << bits - 1) if signed else 0
    if low <= number < low + (1 << bits):
        if autopilot == PX4 and number < 0 and bits == 32:
            return  # some are NaNs with a payload: see the table
        assert decode(autopilot, encode(autopilot, number, kind), kind) == number
    else:
        with pytest.raises(ValueError, match="expected a whole number"):
            encode(autopilot, number, kind)


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.5])
def test_what_a_whole_number_cannot_be_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match=r"is no value|whole number"):
        encode(PX4, value, INT32)


class Scene:
    def __init__(self, kind: int = ARDUPILOT) -> None:
        self.ours, self.theirs = MavlinkCodec(245, 190), MavlinkCodec(1, 1)
        self.autopilot = AutopilotAddress(self.ours, Words(), 1, 1, kind)
        self.now = 5.0
        self.asked: list[str] = []

    def tell(self, step: Any, name: str, value: float, kind: int = REAL32) -> None:
        number = encode(self.autopilot.kind, value, kind)
        message = self.ours.dialect.MAVLink_param_value_message(name.encode(), number, kind, 9, 0)
        (heard,) = self.ours.feed(self.theirs.pack(message))
        step.hear(heard, self.now)

    def run(self, step: Any, has: dict[str, float], lose: int = 0) -> None:
        for _ in range(400):
            for frame in step.poll(self.now):
                (request,) = self.theirs.feed(frame)
                self.asked.append(request.param_id)
                if lose > 0:
                    lose -= 1
                elif request.param_id in has:
                    self.tell(step, request.param_id, has[request.param_id])
            self.now += 0.05
            if step.done or step.failure is not None:
                return


NAMES = [f"P{n}" for n in range(20)]


def test_many_are_read_and_those_that_it_does_not_have_are_given_up() -> None:
    scene, has = Scene(), {name: float(n) for n, name in enumerate(NAMES) if n % 3}
    reads = ReadAll(scene.autopilot, NAMES)
    scene.run(reads, has, lose=5)
    assert reads.done
    assert {name: p.value for name, p in reads.found.items()} == has
    assert scene.asked.count("P0") == ASKED
    assert scene.now - 5.0 < 0.5 * ASKED + 1.0


def test_no_more_questions_wait_at_once_than_a_radio_can_take() -> None:
    scene = Scene()
    assert len(ReadAll(scene.autopilot, NAMES).poll(0.0)) == AT_ONCE


def test_a_value_is_set_until_it_is_told_back() -> None:
    scene = Scene(PX4)
    write = Write(scene.autopilot, AutopilotParameter("COM_OBL_RC_ACT", 4.0, INT32))
    (frame,) = write.poll(scene.now)
    (request,) = scene.theirs.feed(frame)
    assert (request.param_id, request.param_type) == ("COM_OBL_RC_ACT", INT32)
    assert struct.pack("<f", request.param_value) == b"\x04\0\0\0"
    scene.tell(write, "COM_OBL_RC_ACT", 4.0, INT32)
    assert write.done


def test_a_value_that_it_does_not_take_is_told_of() -> None:
    scene = Scene()
    write = Write(scene.autopilot, AutopilotParameter("GUID_TIMEOUT", 0.5, REAL32))
    write.poll(scene.now)
    scene.tell(write, "GUID_TIMEOUT", 3.0)
    assert isinstance(write.failure, LinkRejected)
    assert "keeps GUID_TIMEOUT at 3 instead of 0.5" in str(write.failure)
