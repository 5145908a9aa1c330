"""links/mavlink/protocol/procedures.py: what is asked when, and what the operator is told."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from links.core import LinkLost, LinkRejected
from links.mavlink.protocol import (
    ARDUPILOT,
    PX4,
    AutopilotAddress,
    Handshake,
    HandshakeStep,
    Kill,
    MavCommand,
    MavlinkCodec,
    Words,
    arming,
    disarming,
    landing_disarmed,
)
from links.mavlink.protocol.procedures import silence, stream
from tests.unit.links.mavlink.test_mavlink_link import D, accept, ack

Answer = Callable[[Any], list[Any]]


class Scene:
    """A handshake or a step of one, an autopilot played by a function, and a clock."""

    def __init__(
        self, kind: int, make: Callable[[AutopilotAddress], HandshakeStep], answer: Answer
    ) -> None:
        self.ours, self.theirs = MavlinkCodec(245, 190), MavlinkCodec(1, 1)
        self.words = Words()
        self.handshake = make(AutopilotAddress(self.ours, self.words, 1, 1, kind))
        self.answer = answer
        self.asked: list[tuple[float, Any]] = []
        self.now = 100.0

    def run(self, duration_s: float = 30.0) -> "Scene":
        end = self.now + duration_s
        while self.now < end and not self.handshake.done and self.handshake.failure is None:
            for frame in self.handshake.poll(self.now):
                (request,) = self.theirs.feed(frame)
                self.asked.append((round(self.now - 100.0, 3), request))
                for reply in self.answer(request):
                    self.hear(reply)
            self.now += 0.0225
        return self

    def hear(self, message: Any) -> None:
        (heard,) = self.ours.feed(self.theirs.pack(message))
        if heard.get_type() == "STATUSTEXT":
            self.words.hear(heard)
        self.handshake.hear(heard, self.now)

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
    scene = Scene(ARDUPILOT, lambda autopilot: arming(autopilot, mode), answer).run()
    assert scene.handshake.done
    assert [getattr(m, "param_id", getattr(m, "command", None)) for _, m in scene.asked] == [
        "GUID_OPTIONS", "ATC_ANGLE_BOOST", MavCommand.DO_SET_MODE, MavCommand.ARM_DISARM
    ]  # fmt: skip
    assert (scene.asked[2][1].param1, scene.asked[2][1].param2) == (1.0, number)
    armed_s, turns_s = scene.asked[3][0], 2.0  # ARMING_DELAY_SEC of ArduCopter's config.h
    assert armed_s + turns_s < scene.now - 100.0 < armed_s + turns_s + 0.6


def test_what_is_given_up_while_ardupilots_rotors_stand_has_been_ordered() -> None:
    answer = ardupilot_with(GUID_OPTIONS=8.0, ATC_ANGLE_BOOST=0.0)
    scene = Scene(ARDUPILOT, arming, answer)
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
    scene = Scene(ARDUPILOT, arming, ardupilot_with(**parameters)).run()
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
    autopilot = AutopilotAddress(MavlinkCodec(245, 190), Words(), 1, 1, PX4, vehicle)
    with pytest.raises(LinkRejected, match=f"no multirotor .{name}"):
        arming(autopilot)


def test_a_refusal_to_arm_is_told_in_the_autopilots_words_with_what_to_do() -> None:
    words = "Arming denied: resolve health failures first\t"
    scene = Scene(PX4, arming, refuse(MavCommand.ARM_DISARM, 2, words=words)).run()
    failure = scene.handshake.failure
    assert scene.commands == [MavCommand.DO_SET_MODE, MavCommand.ARM_DISARM]
    assert isinstance(failure, LinkRejected)
    assert "MAV_RESULT_DENIED): “Arming denied: resolve health failures first”." in str(failure)
    assert str(failure).endswith("then arm again.")


def test_words_that_come_shortly_after_the_refusal_are_quoted() -> None:
    scene = Scene(PX4, arming, refuse(MavCommand.ARM_DISARM, 2))
    scene.run(1.3)
    assert scene.commands == [MavCommand.DO_SET_MODE, MavCommand.ARM_DISARM]
    assert scene.handshake.failure is None
    scene.hear(says("Preflight Fail: no attitude"))
    scene.run()
    assert "“Preflight Fail: no attitude”" in str(scene.handshake.failure)


def heard(*parts: tuple[int, int, bytes], component: int = 1, words: Words | None = None) -> Words:
    """Words after ``parts`` (STATUSTEXT.id, chunk_seq, text) of ``component`` have come."""
    words = Words() if words is None else words
    codec = MavlinkCodec(1, component)
    for number, part, text in parts:
        (message,) = codec.feed(codec.pack(D.MAVLink_statustext_message(2, text, number, part)))
        words.hear(message)
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
    scene = Scene(PX4, arming, lambda request: [] if lost.pop(0) else accept(request)).run()
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
    scene = Scene(PX4, arming, lambda request: [ack(request.command, 0, 255)]).run()
    assert isinstance(scene.handshake.failure, LinkLost)
    assert "no answer to the request to enter OFFBOARD" in str(scene.handshake.failure)


def test_an_answer_before_the_question_is_not_one() -> None:
    scene = Scene(PX4, disarming, lambda request: [])
    scene.hear(ack(MavCommand.ARM_DISARM))
    assert not scene.handshake.done
    assert not scene.run(0.1).handshake.done


def test_disarming_waits_until_the_autopilot_believes_that_it_stands() -> None:
    refused = refuse(MavCommand.ARM_DISARM, 1, 1, 0, words="Disarming denied: not landed")
    scene = Scene(PX4, disarming, refused).run()
    assert scene.handshake.done
    assert [(m.param1, m.param2) for _, m in scene.asked] == [(0.0, 0.0)] * 3


def heartbeat(*, armed: bool) -> Any:
    return D.MAVLink_heartbeat_message(2, ARDUPILOT, 1 | (128 if armed else 0), 9, 4, 3)


def test_ardupilot_lands_to_disarm_and_its_heartbeat_ends_that() -> None:
    scene = Scene(ARDUPILOT, landing_disarmed, accept).run(1.0)
    assert (scene.asked[0][1].param1, scene.asked[0][1].param2) == (1.0, 9.0)
    scene.hear(heartbeat(armed=True))
    assert not scene.run(1.0).handshake.done
    scene.hear(heartbeat(armed=False))
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
