"""links/mavlink/protocol/procedures.py: the firmware's version, told, refused, or kept to itself."""

from links.mavlink.protocol import PX4, REQUEST_MESSAGE, AutopilotAddress, MavlinkCodec, ReadVersion, Words
from links.mavlink.protocol.procedures import VERSION_ASKED as ASKED

CODEC = MavlinkCodec(245, 190)
D = CODEC.dialect


def reading() -> ReadVersion:
    return ReadVersion(AutopilotAddress(CODEC, Words(), 1, 1, PX4))


def test_it_is_asked_for_and_told_in_numbers_and_the_first_bytes_of_the_commit() -> None:
    step, theirs = reading(), MavlinkCodec(1, 1)
    (frame,) = step.poll(0.0)
    (question,) = theirs.feed(frame)
    assert (question.command, question.param1) == (REQUEST_MESSAGE, 148.0)
    commit = list(bytes.fromhex("0a1b2c3d4e5f6071"))
    none = [0] * 8
    step.hear(D.MAVLink_autopilot_version_message(0, 0x01_10_02_40, 0, 0, 0, commit, none, none, 0, 0, 0), 0.1)
    assert step.done
    assert step.firmware == "PX4 1.16.2 alpha 0a1b2c3d4e5f6071"


def test_one_that_refuses_and_one_that_says_nothing_are_no_failure() -> None:
    refused = reading()
    refused.poll(0.0)
    refused.hear(D.MAVLink_command_ack_message(REQUEST_MESSAGE, 3), 0.1)
    assert refused.done
    silent, asked, now_s = reading(), 0, 0.0
    while not silent.done:
        asked += len(silent.poll(now_s))
        now_s += 0.1
    assert asked == ASKED
    assert now_s < 2.0
    for step in (refused, silent):
        assert (step.firmware, step.failure) == ("", None)


def test_an_acknowledgement_alone_is_waited_after() -> None:
    step = reading()
    step.poll(0.0)
    step.hear(D.MAVLink_command_ack_message(REQUEST_MESSAGE, 0), 0.1)
    assert not step.done


def test_a_refusal_of_another_station_s_question_leaves_ours_open() -> None:
    step = reading()
    step.poll(0.0)
    step.hear(D.MAVLink_command_ack_message(REQUEST_MESSAGE, 3, 0, 0, 255, 190), 0.1)
    assert not step.done
    step.hear(D.MAVLink_command_ack_message(REQUEST_MESSAGE, 3, 0, 0, 245, 190), 0.2)
    assert step.done
