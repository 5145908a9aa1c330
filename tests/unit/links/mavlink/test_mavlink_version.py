"""links/mavlink/protocol/procedures.py: the firmware's version, told, refused, or kept to itself."""

from links.mavlink.protocol import PX4, AutopilotAddress, MavCommand, MavlinkCodec, ReadVersion, Words

CODEC = MavlinkCodec(245, 190)
D = CODEC.dialect


def reading() -> ReadVersion:
    return ReadVersion(AutopilotAddress(CODEC, Words(), 1, 1, PX4))


def test_it_is_asked_for_and_told_in_numbers_and_the_first_bytes_of_the_commit() -> None:
    step, theirs = reading(), MavlinkCodec(1, 1)
    (frame,) = step.poll(0.0)
    (question,) = theirs.feed(frame)
    assert (question.command, question.param1) == (MavCommand.REQUEST_MESSAGE, 148.0)
    commit = list(bytes.fromhex("0a1b2c3d4e5f6071"))
    none = [0] * 8
    step.hear(D.MAVLink_autopilot_version_message(0, 0x01_11_03_FF, 0, 0, 0, commit, none, none, 0, 0, 0), 0.1)
    assert step.done
    assert step.firmware == "PX4 1.17.3 release 0a1b2c3d4e5f6071"
