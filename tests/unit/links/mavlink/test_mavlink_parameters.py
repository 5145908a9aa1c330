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
    MavParamType,
    ReadAll,
    Write,
    decode,
    encode,
)
from tests.unit.links.mavlink.test_mavlink_handshake import D, Scene

# By their numbers: a limit that the test took from the code would bear out any value.
ASKED = 6

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


@given(
    st.sampled_from([PX4, ARDUPILOT]),
    st.sampled_from(sorted(WHOLE_BITS)),
    st.integers(-(2**24), 2**24),
)
def test_every_whole_number_comes_back_or_is_refused(
    autopilot: int, kind: int, number: int
) -> None:
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


NAMES = [f"P{n}" for n in range(20)]


def value(autopilot: int, name: str, number: float, kind: int = REAL32) -> Any:
    return D.MAVLink_param_value_message(name.encode(), encode(autopilot, number, kind), kind, 9, 0)


def test_many_are_read_and_those_that_it_does_not_have_are_given_up() -> None:
    has = {name: float(n) for n, name in enumerate(NAMES) if n % 3}
    lost = iter([True] * 5)

    def answer(request: Any) -> list[Any]:
        name = request.param_id
        return [value(ARDUPILOT, name, has[name])] if not next(lost, False) and name in has else []

    reads: list[ReadAll] = []

    def read(autopilot: AutopilotAddress) -> ReadAll:
        reads.append(ReadAll(autopilot, NAMES))
        return reads[0]

    scene = Scene(ARDUPILOT, read, answer).run()
    assert reads[0].done
    assert {name: p.value for name, p in reads[0].found.items()} == has
    assert [request.param_id for _, request in scene.asked].count("P0") == ASKED
    assert scene.now - 100.0 < 0.5 * ASKED + 1.0


def write(kind: int, parameter: AutopilotParameter, told: Any) -> Scene:
    return Scene(kind, lambda autopilot: Write(autopilot, parameter), lambda _: [told]).run()


def test_a_value_is_set_until_it_is_told_back() -> None:
    told = value(PX4, "COM_OBL_RC_ACT", 4.0, INT32)
    scene = write(PX4, AutopilotParameter("COM_OBL_RC_ACT", 4.0, INT32), told)
    ((_, request),) = scene.asked
    assert (request.param_id, request.param_type) == ("COM_OBL_RC_ACT", INT32)
    assert struct.pack("<f", request.param_value) == b"\x04\0\0\0"
    assert scene.handshake.done


def test_a_value_that_it_does_not_take_is_told_of() -> None:
    told = value(ARDUPILOT, "GUID_TIMEOUT", 3.0)
    wanted = AutopilotParameter("GUID_TIMEOUT", 0.5, REAL32)
    failure = write(ARDUPILOT, wanted, told).handshake.failure
    assert isinstance(failure, LinkRejected)
    assert "keeps GUID_TIMEOUT at 3 instead of 0.5" in str(failure)
