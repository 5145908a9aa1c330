"""links/mavlink/protocol/procedures.py: what is asked when, and what the operator is told."""

import math
import struct
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from hypothesis import given, strategies as st

from links.core import LinkError, LinkLost, LinkRejected
from links.mavlink.protocol import (
    ARDUPILOT,
    INTEGER_BITS,
    PX4,
    AskMode,
    AutopilotAddress,
    AutopilotParameter,
    AutopilotTexts,
    Handshake,
    HandshakeStep,
    Kill,
    MavCommand,
    MavlinkCodec,
    MavParamType,
    ReadParameters,
    ReadVersion,
    WriteParameter,
    decode_parameter,
    encode_parameter,
    make_arming,
    make_disarming,
    make_landing,
    make_landing_disarmed,
)
from links.mavlink.protocol.procedures import Wait, silence, stream
from tests.unit.links.mavlink.test_mavlink_link import D, accept, ack

Answer = Callable[[Any], list[Any]]


class Scene:
    """A handshake or a step of one, an autopilot played by a function, and a clock."""

    def __init__(
        self, kind: int, make: Callable[[AutopilotAddress], HandshakeStep], answer: Answer
    ) -> None:
        self.ours, self.theirs = MavlinkCodec(245, 190), MavlinkCodec(1, 1)
        self.words = AutopilotTexts()
        self.handshake = make(AutopilotAddress(self.ours, self.words, 1, 1, kind))
        self.answer = answer
        self.asked: list[tuple[float, Any]] = []
        self.now = 0.0

    @property
    def is_over(self) -> bool:
        return self.handshake.done or self.handshake.failure is not None

    def run(self, duration_s: float = 30.0, step_s: float = 0.0225) -> "Scene":
        begin, polls = self.now, 0
        while self.now < begin + duration_s and not self.is_over:
            for frame in self.handshake.poll(self.now):
                (request,) = self.theirs.feed(frame)
                self.asked.append((round(self.now, 3), request))
                for reply in self.answer(request):
                    self.take_message(reply)
            polls += 1
            self.now = begin + polls * step_s
        return self

    def take_message(self, message: Any) -> None:
        (heard,) = self.ours.feed(self.theirs.pack(message))
        if heard.get_type() == "STATUSTEXT":
            self.words.take_message(heard)
        self.handshake.take_message(heard, self.now)

    @property
    def commands(self) -> list[int]:
        return [m.command for _, m in self.asked if m.get_type() == "COMMAND_LONG"]


def says(text: str, severity: int = 2) -> Any:
    return D.MAVLink_statustext_message(severity, text.encode())


def refuse(command: int, *results: int, words: str = "") -> Answer:
    """Refuse ``command`` with ``results`` in turn, the last for ever; accept all else."""
    left = list(results)

    def answer(request: Any) -> list[Any]:
        if request.command != command:
            return accept(request)
        result = left.pop(0) if len(left) > 1 else left[0]
        return [ack(command, result), *([says(words)] if words else [])]

    return answer


def ardupilot_with(**parameters: float) -> Answer:
    def answer(request: Any) -> list[Any]:
        if request.get_type() == "PARAM_REQUEST_READ":
            name = request.param_id
            return [D.MAVLink_param_value_message(name.encode(), parameters[name], 6, 1000, 65535)]
        return accept(request)

    return answer


@pytest.mark.parametrize(("mode", "number"), [("GUIDED", 4.0), ("GUIDED_NOGPS", 20.0)])
def test_ardupilot_is_asked_for_guided_once_its_thrust_means_thrust(
    mode: str, number: float
) -> None:
    answer = ardupilot_with(GUID_OPTIONS=8.0, ATC_ANGLE_BOOST=0.0)
    scene = Scene(ARDUPILOT, lambda autopilot: make_arming(autopilot, mode), answer).run()
    assert scene.handshake.done
    assert [getattr(m, "param_id", getattr(m, "command", None)) for _, m in scene.asked] == [
        "GUID_OPTIONS", "ATC_ANGLE_BOOST", MavCommand.DO_SET_MODE, MavCommand.ARM_DISARM
    ]  # fmt: skip
    assert (scene.asked[2][1].param1, scene.asked[2][1].param2) == (1.0, number)
    armed_s, turns_s = scene.asked[3][0], 2.0  # ARMING_DELAY_SEC of ArduCopter's config.h
    assert armed_s + turns_s < scene.now < armed_s + turns_s + 0.6


def test_what_is_given_up_while_ardupilots_rotors_stand_has_been_ordered() -> None:
    answer = ardupilot_with(GUID_OPTIONS=8.0, ATC_ANGLE_BOOST=0.0)
    scene = Scene(ARDUPILOT, make_arming, answer)
    ordered = []
    while not scene.handshake.done:
        scene.run(0.02)
        assert isinstance(scene.handshake, Handshake)
        ordered.append((MavCommand.ARM_DISARM in scene.commands, scene.handshake.at_last_step))
    assert {orders for armed, orders in ordered if armed} == {True}
    assert not all(orders for _, orders in ordered)


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        (
            {"GUID_OPTIONS": 9.0, "ATC_ANGLE_BOOST": 1.0},
            ("ATC_ANGLE_BOOST is 1: it would raise our thrust", "Set ATC_ANGLE_BOOST to 0"),
        ),
        ({"GUID_OPTIONS": 0.0}, ("GUID_OPTIONS is 0", "climb rate", "Add 8 to GUID_OPTIONS")),
    ],
)
def test_ardupilot_that_would_misunderstand_our_thrust_is_not_armed(
    parameters: dict[str, float], says: tuple[str, ...]
) -> None:
    scene = Scene(ARDUPILOT, make_arming, ardupilot_with(**parameters)).run()
    assert isinstance(scene.handshake.failure, LinkRejected)
    assert all(words in str(scene.handshake.failure) for words in says)
    assert scene.commands == []


@pytest.mark.parametrize(
    ("vehicle", "name"),
    [
        (0, "MAV_TYPE_GENERIC"),
        (1, "MAV_TYPE_FIXED_WING"),
        (4, "MAV_TYPE_HELICOPTER"),
        (200, "MAV_TYPE 200"),
    ],
)
def test_a_vehicle_that_is_no_multirotor_is_not_armed(vehicle: int, name: str) -> None:
    with pytest.raises(LinkRejected, match=f"no multirotor .{name}"):
        make_arming(address(PX4, vehicle))


def test_a_refusal_to_arm_is_told_in_the_autopilots_words_with_what_to_do() -> None:
    words = "Arming denied: resolve health failures first\t"
    scene = Scene(PX4, make_arming, refuse(MavCommand.ARM_DISARM, 2, words=words)).run()
    failure = scene.handshake.failure
    assert scene.commands == [MavCommand.DO_SET_MODE, MavCommand.ARM_DISARM]
    assert isinstance(failure, LinkRejected)
    assert "MAV_RESULT_DENIED): “Arming denied: resolve health failures first”." in str(failure)
    assert str(failure).endswith("then arm again.")


def test_words_that_come_shortly_after_the_refusal_are_quoted() -> None:
    scene = Scene(PX4, make_arming, refuse(MavCommand.ARM_DISARM, 2))
    scene.run(1.3)
    assert scene.commands == [MavCommand.DO_SET_MODE, MavCommand.ARM_DISARM]
    assert scene.handshake.failure is None
    scene.take_message(says("Preflight Fail: no attitude"))
    scene.run()
    assert "“Preflight Fail: no attitude”" in str(scene.handshake.failure)


def heard(
    *parts: tuple[int, int, bytes], component: int = 1, words: AutopilotTexts | None = None
) -> AutopilotTexts:
    """Words after ``parts`` (STATUSTEXT.id, chunk_seq, text) of ``component`` have come."""
    words = AutopilotTexts() if words is None else words
    codec = MavlinkCodec(1, component)
    for number, part, text in parts:
        (message,) = codec.feed(codec.pack(D.MAVLink_statustext_message(2, text, number, part)))
        words.take_message(message)
    return words


FIRST = b"Preflight Fail: heading estimate not stable enough"
SECOND = b" to arm, as the magnetometer and the gyroscopes of"
LAST = b" the second IMU disagree"
WHOLE = (FIRST + SECOND + LAST).decode()


@pytest.mark.parametrize(
    ("parts", "shown"),
    [
        (((7, 0, FIRST), (7, 1, SECOND), (7, 2, LAST)), WHOLE),
        ((*[(7, 0, FIRST)] * 2, *[(7, 1, SECOND)] * 2, *[(7, 2, LAST)] * 2), WHOLE),
        (((7, 0, FIRST), (7, 1, SECOND), (7, 2, LAST), (7, 0, b"Armed")), "Armed"),
        (((7, 1, SECOND), (7, 2, LAST)), f"[…]{(SECOND + LAST).decode()}"),
        (((7, 0, FIRST), (7, 2, LAST)), f"{FIRST.decode()}[…]{LAST.decode()}"),
        (((7, 0, FIRST), (7, 1, SECOND)), f"{(FIRST + SECOND).decode()}[…]"),
        (((7, 2, LAST),), f"[…]{LAST.decode()}"),
    ],
)
def test_a_long_text_is_joined_and_a_piece_that_was_lost_is_marked(
    parts: tuple[tuple[int, int, bytes], ...], shown: str
) -> None:
    words = heard(*parts)
    assert words.newest == shown
    assert words.complaints().endswith(f"“{shown}”")
    assert words.complaints().count("; ") == (shown == "Armed"), "no part is a text of its own"


def test_a_text_in_utf_8_is_shown_as_it_is_also_where_a_letter_stands_in_two_pieces() -> None:
    text = "Akku schwach: bitte sofort landen, der Rückflug dauert für die Restkapazität zu lange"
    whole = text.encode()
    ends = whole.index("ü".encode()) + 1  # within a letter
    padded = b" " * (50 - ends) + whole
    assert heard((7, 0, padded[:50]), (7, 1, padded[50:])).newest == text


def test_the_newest_complaints_are_quoted_also_where_one_comes_again() -> None:
    words = heard(*((0, 0, text) for text in (b"A", b"B", b"C", b"D", b"A")))
    assert words.complaints() == "“C”; “D”; “A”"


def test_pieces_are_joined_by_their_sender_and_number_also_with_others_between() -> None:
    words = heard((7, 0, FIRST))
    heard((7, 0, b"Camera: lens dirty"), component=100, words=words)
    heard((8, 0, b"Battery low"), (0, 0, b"Armed"), (7, 1, b" to arm"), words=words)
    assert words.complaints() == "“Camera: lens dirty”; “Battery low”; “Armed”"
    assert FIRST.decode() + " to arm" in [text.show() for text in words._texts]


def test_a_lost_request_or_answer_is_made_up_for() -> None:
    lost = [True, True, False, True, False]
    scene = Scene(PX4, make_arming, lambda request: [] if lost.pop(0) else accept(request)).run()
    assert scene.handshake.done
    assert scene.commands == [MavCommand.DO_SET_MODE] * 3 + [MavCommand.ARM_DISARM] * 2
    assert [m.confirmation for _, m in scene.asked] == [0, 1, 2, 0, 1]


def killing(autopilot: AutopilotAddress) -> Handshake:
    return Handshake([Kill(autopilot)])


@pytest.mark.parametrize("result", [0, 2])
def test_motors_are_ordered_off_until_we_ourselves_are_answered(result: int) -> None:
    """Another station's disarming is acknowledged as often as it likes."""
    scene = Scene(PX4, killing, lambda request: [ack(request.command, result, 255)] * 2).run(1.0)
    assert not scene.handshake.done
    assert len(scene.asked) > 10
    scene.answer = accept
    assert scene.run(0.2).handshake.done


def test_an_answer_to_another_ground_station_is_not_ours() -> None:
    scene = Scene(PX4, make_arming, lambda request: [ack(request.command, 0, 255)]).run()
    assert isinstance(scene.handshake.failure, LinkLost)
    assert "no answer to the request to enter OFFBOARD" in str(scene.handshake.failure)


def test_an_answer_before_the_question_is_not_one() -> None:
    scene = Scene(PX4, make_disarming, lambda request: [])
    scene.take_message(ack(MavCommand.ARM_DISARM))
    assert not scene.handshake.done
    assert not scene.run(0.1).handshake.done


def test_disarming_waits_until_the_autopilot_believes_that_it_stands() -> None:
    refused = refuse(MavCommand.ARM_DISARM, 1, 1, 0, words="Disarming denied: not landed")
    scene = Scene(PX4, make_disarming, refused).run()
    assert scene.handshake.done
    assert [(m.param1, m.param2) for _, m in scene.asked] == [(0.0, 0.0)] * 3


def heartbeat(*, armed: bool) -> Any:
    return D.MAVLink_heartbeat_message(2, ARDUPILOT, 1 | (128 if armed else 0), 9, 4, 3)


def test_ardupilot_lands_to_disarm_and_its_heartbeat_ends_that() -> None:
    scene = Scene(ARDUPILOT, make_landing_disarmed, accept).run(1.0)
    assert (scene.asked[0][1].param1, scene.asked[0][1].param2) == (1.0, 9.0)
    scene.take_message(heartbeat(armed=True))
    assert not scene.run(1.0).handshake.done
    scene.take_message(heartbeat(armed=False))
    assert scene.run(0.1).handshake.done


@pytest.mark.parametrize(("rate_hz", "result", "interval_us"), [
    (100.0, 0, 10_000.0), (None, 0, -1.0), (None, 2, -1.0), (None, 4, -1.0)
])  # fmt: skip
def test_a_stream_is_asked_for_by_its_interval_and_stopped_whatever_the_answer(
    rate_hz: float | None, result: int, interval_us: float
) -> None:
    def ask(autopilot: AutopilotAddress) -> Any:
        if rate_hz is None:
            return silence(autopilot, "ODOMETRY")
        return stream(autopilot, "ODOMETRY", rate_hz)

    scene = Scene(PX4, ask, refuse(511, result)).run()
    assert scene.handshake.done
    ((_, request),) = scene.asked
    assert (request.command, request.param1, request.param2) == (511, 331.0, interval_us)


def test_a_stream_that_is_refused_is_not_asked_for_again() -> None:
    scene = Scene(ARDUPILOT, partial(stream, name="ODOMETRY", rate_hz=50.0), refuse(511, 4)).run()
    assert len(scene.asked) == 1
    says = "ArduPilot refused to send ODOMETRY at 50 Hz (it tried and failed, MAV_RESULT_FAILED)"
    assert says in str(scene.handshake.failure)


# ---- when each procedure asks and gives up, as the autopilots' times demand

STEP_S = 0.002
LIMIT_S = 11.0
"""Procedures that are not over by then go on."""
TEMPORARILY_REJECTED = 1
"""MAV_RESULT."""
DENIED = 2
"""MAV_RESULT."""
IN_PROGRESS = 5
"""MAV_RESULT."""

Make = Callable[[AutopilotAddress], Any]


def address(kind: int, vehicle: int = 2) -> AutopilotAddress:
    return AutopilotAddress(MavlinkCodec(245, 190), AutopilotTexts(), 1, 1, kind, vehicle)


def answered(make: Make, kind: int, result: int | None) -> Scene:
    """A procedure of which each command is answered with ``result``, with None not at all."""
    answers = (lambda _: []) if result is None else (lambda asked: [ack(asked.command, result)])
    return Scene(kind, make, answers).run(LIMIT_S, STEP_S)


def every(period_s: float, count: int, from_s: float = 0.0) -> list[float]:
    return [round(from_s + period_s * n, 3) for n in range(count)]


@pytest.mark.parametrize(
    ("make", "kind", "result", "asked_s", "over_s", "failure"),
    [
        # Nobody answers: half a second and six times, unless it must go faster or does not matter.
        (make_arming, PX4, None, every(0.5, 6, 1.2), 4.2, LinkLost),
        (make_arming, ARDUPILOT, None, every(0.5, 6, 1.2), 4.2, LinkLost),
        (make_disarming, PX4, None, every(0.5, 6), 3.0, LinkLost),
        (ReadVersion, PX4, None, every(0.5, 3), 1.5, None),
        (AskMode, PX4, None, every(0.1, 15), 1.5, LinkLost),
        (Kill, PX4, None, every(0.05, 100), 5.0, LinkLost),
        (lambda autopilot: ReadParameters(autopilot, ["A"]), PX4, None, every(0.5, 6), 3.0, None),
        # A refusal is final once the autopilot had 0.3 s for its words ...
        (make_disarming, PX4, DENIED, [0.0], 0.3, LinkRejected),
        (make_disarming, ARDUPILOT, TEMPORARILY_REJECTED, [0.0], 0.3, LinkRejected),
        (Kill, PX4, DENIED, every(0.05, 100), 5.0, LinkRejected),
        # ... but one that may pass is asked again every second, for 4 s.
        (make_disarming, PX4, TEMPORARILY_REJECTED, every(1.0, 5), 4.3, LinkRejected),
        # What is in progress is left alone for 3 s.
        (make_disarming, PX4, IN_PROGRESS, every(3.0, 4), math.inf, None),
        # Accepted: mode and arming at once; ArduCopter's rotors then take 2.5 s. A kill counts
        # twice.
        (make_arming, PX4, 0, [1.2, 1.2], 1.2, None),
        (Kill, PX4, 0, every(0.05, 2), 0.05, None),
        (make_landing_disarmed, ARDUPILOT, 0, [0.0], 10.0, LinkRejected),
        (lambda _: Wait(0.25), PX4, 0, [], 0.25, None),
    ],
)
def test_a_request_is_repeated_and_given_up_at_these_times(
    make: Make,
    kind: int,
    result: int | None,
    asked_s: list[float],
    over_s: float,
    failure: type[LinkError] | None,
) -> None:
    scene = answered(make, kind, result)
    # Each repetition may be one poll late, and the clock goes on by one poll after the last.
    end_s = scene.now - STEP_S if scene.is_over else math.inf
    assert [at_s for at_s, _ in scene.asked] == pytest.approx(asked_s, rel=0.04, abs=2.0 * STEP_S)
    assert end_s == pytest.approx(over_s, rel=0.04, abs=2.0 * STEP_S)
    assert type(scene.handshake.failure) is (type(None) if failure is None else failure)
    if make is not make_arming:
        counts = [m.confirmation for _, m in scene.asked if m.get_type() == "COMMAND_LONG"]
        assert counts == list(range(len(counts))), "repetitions are numbered"


@pytest.mark.parametrize(
    ("make", "kind", "requests"),
    [
        (make_arming, PX4, [(176, 1.0, 6.0, 0.0), (400, 1.0, 0.0, 0.0)]),
        (make_disarming, PX4, [(400, 0.0, 0.0, 0.0)]),
        (Kill, PX4, [(400, 0.0, 21196.0, 0.0)] * 2),
        (make_landing, PX4, [(176, 1.0, 4.0, 6.0)]),
        (make_landing, ARDUPILOT, [(176, 1.0, 9.0, 0.0)]),
        (make_landing_disarmed, ARDUPILOT, [(176, 1.0, 9.0, 0.0)]),
    ],
)
def test_an_autopilot_is_asked_for_these_commands(
    make: Make, kind: int, requests: list[tuple[float, ...]]
) -> None:
    asked = [(m.command, m.param1, m.param2, m.param3) for _, m in answered(make, kind, 0).asked]
    assert asked == requests


@pytest.mark.parametrize(
    ("kind", "name"), [(PX4, "PX4"), (ARDUPILOT, "ArduPilot"), (8, "the autopilot")]
)
@pytest.mark.parametrize("vehicle", [2, 3, 13, 14, 15, 29])
def test_every_multirotor_of_both_firmwares_may_be_armed(
    kind: int, name: str, vehicle: int
) -> None:
    autopilot = address(kind, vehicle)
    assert autopilot.name == name
    if kind == 8:
        with pytest.raises(LinkRejected, match="no PX4 and no ArduPilot"):
            make_arming(autopilot)
    else:
        assert not make_arming(autopilot).done


def test_of_many_parameters_eight_wait_at_once_and_those_that_were_asked_less_come_first() -> None:
    names = [f"P{n}" for n in range(12)]
    reads, theirs = ReadParameters(address(PX4), names), MavlinkCodec(1, 1)
    asked = [
        [one.param_id for frame in reads.poll(at_s) for one in theirs.feed(frame)]
        for at_s in (0.0, 0.4, 0.5)
    ]
    assert asked == [names[:8], [], names[8:] + names[:4]]


# ---- who has it, and what it runs


HEARTBEAT = D.MAVLink_heartbeat_message(2, PX4, 128, 6 << 16, 3, 3)


def test_it_is_asked_until_both_its_answer_and_its_heartbeat_have_come() -> None:
    step = AskMode(address(PX4))
    (message,) = MavlinkCodec(1, 1).feed(*step.poll(0.0))
    asked = (message.command, message.param1)
    assert asked == (MavCommand.REQUEST_MESSAGE, D.MAVLINK_MSG_ID_HEARTBEAT)
    assert step.poll(0.5 * AskMode.period_s) == []
    step.take_message(HEARTBEAT, 0.01)
    assert not step.done, "it may have left before the question"
    assert len(step.poll(AskMode.period_s)) == 1
    step.take_message(ack(MavCommand.REQUEST_MESSAGE, 3), 0.12)
    assert step.done, "also where it refuses: then the heartbeat that comes by itself has told"
    assert step.poll(math.inf) == []


def test_an_answer_to_another_station_s_question_is_none_to_ours() -> None:
    step = AskMode(address(PX4))
    step.poll(0.0)
    step.take_message(HEARTBEAT, 0.01)
    step.take_message(ack(MavCommand.REQUEST_MESSAGE, 0, 255), 0.02)
    assert not step.done, "that heartbeat may have left before our question"
    assert len(step.poll(AskMode.period_s)) == 1
    step.take_message(ack(MavCommand.REQUEST_MESSAGE, 0, 0, 0), 0.12)
    assert step.done, "one that names nobody is an old autopilot's, and for all"


def test_a_version_is_told_in_numbers_and_the_first_bytes_of_the_commit() -> None:
    step = ReadVersion(address(PX4))
    (question,) = MavlinkCodec(1, 1).feed(*step.poll(0.0))
    assert (question.command, question.param1) == (MavCommand.REQUEST_MESSAGE, 148.0)
    commit, none = list(bytes.fromhex("0a1b2c3d4e5f6071")), [0] * 8
    numbers = (0, 0x01_11_03_FF, 0, 0, 0, commit, none, none, 0, 0, 0)
    step.take_message(D.MAVLink_autopilot_version_message(*numbers), 0.1)
    assert step.done
    assert step.firmware == "PX4 1.17.3 release 0a1b2c3d4e5f6071"


# ---- parameters

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
    number = encode_parameter(autopilot, value, kind)
    if not math.isnan(number):  # a NaN's bits need not survive the way through a double
        assert struct.pack("<f", number).hex() == wire
    (read,) = struct.unpack("<f", bytes.fromhex(wire))
    assert decode_parameter(autopilot, read, kind) == value


@given(
    st.sampled_from([PX4, ARDUPILOT]),
    st.sampled_from(sorted(INTEGER_BITS)),
    st.integers(-(2**24), 2**24),
)
def test_every_whole_number_comes_back_or_is_refused(
    autopilot: int, kind: int, number: int
) -> None:
    bits, signed = INTEGER_BITS[kind]
    low = -(1 << bits - 1) if signed else 0
    if low <= number < low + (1 << bits):
        if autopilot == PX4 and number < 0 and bits == 32:
            return  # some are NaNs with a payload: see the table
        assert (
            decode_parameter(autopilot, encode_parameter(autopilot, number, kind), kind) == number
        )
    else:
        with pytest.raises(ValueError, match="expected a whole number"):
            encode_parameter(autopilot, number, kind)


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.5])
def test_what_a_whole_number_cannot_be_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match=r"is no value|whole number"):
        encode_parameter(PX4, value, INT32)


NAMES = [f"P{n}" for n in range(20)]


def value(autopilot: int, name: str, number: float, kind: int = REAL32) -> Any:
    return D.MAVLink_param_value_message(
        name.encode(), encode_parameter(autopilot, number, kind), kind, 9, 0
    )


def test_many_are_read_and_those_that_it_does_not_have_are_given_up() -> None:
    has = {name: float(n) for n, name in enumerate(NAMES) if n % 3}
    lost = iter([True] * 5)

    def answer(request: Any) -> list[Any]:
        name = request.param_id
        return [value(ARDUPILOT, name, has[name])] if not next(lost, False) and name in has else []

    reads: list[ReadParameters] = []

    def read(autopilot: AutopilotAddress) -> ReadParameters:
        reads.append(ReadParameters(autopilot, NAMES))
        return reads[0]

    scene = Scene(ARDUPILOT, read, answer).run()
    assert reads[0].done
    assert {name: p.value for name, p in reads[0].found.items()} == has
    assert [request.param_id for _, request in scene.asked].count("P0") == ASKED
    assert scene.now < 0.5 * ASKED + 1.0


def write(kind: int, parameter: AutopilotParameter, told: Any) -> Scene:
    return Scene(
        kind, lambda autopilot: WriteParameter(autopilot, parameter), lambda _: [told]
    ).run()


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
