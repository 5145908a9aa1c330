"""links/mavlink/protocol/procedures.py: an autopilot that is asked for its mode."""

import math

from links.mavlink.protocol import PX4, AskMode, AutopilotAddress, MavCommand, MavlinkCodec, Words
from tests.unit.links.mavlink.test_mavlink_link import D

HEARTBEAT = D.MAVLink_heartbeat_message(2, PX4, 128, 6 << 16, 3, 3)
ACK = D.MAVLink_command_ack_message(MavCommand.REQUEST_MESSAGE, 3, 0, 0, 245, 190)


def ask() -> AskMode:
    return AskMode(AutopilotAddress(MavlinkCodec(245, 190), Words(), 1, 1, PX4))


def test_it_is_asked_until_both_its_answer_and_its_heartbeat_have_come() -> None:
    step = ask()
    (frame,) = step.poll(0.0)
    (message,) = MavlinkCodec(1, 1).feed(frame)
    assert (message.command, message.param1) == (MavCommand.REQUEST_MESSAGE, D.MAVLINK_MSG_ID_HEARTBEAT)
    assert step.poll(0.5 * AskMode.period_s) == []
    step.hear(HEARTBEAT, 0.01)
    assert not step.done, "it may have left before the question"
    assert len(step.poll(AskMode.period_s)) == 1
    step.hear(ACK, 0.12)
    assert step.done, "also where it refuses: then the heartbeat that comes by itself has told"
    assert step.poll(math.inf) == []


def test_an_answer_to_another_station_s_question_is_none_to_ours() -> None:
    step = ask()
    step.poll(0.0)
    step.hear(HEARTBEAT, 0.01)
    step.hear(D.MAVLink_command_ack_message(MavCommand.REQUEST_MESSAGE, 0, 0, 0, 255, 190), 0.02)
    assert not step.done, "that heartbeat may have left before our question"
    assert len(step.poll(AskMode.period_s)) == 1
    step.hear(D.MAVLink_command_ack_message(MavCommand.REQUEST_MESSAGE, 0, 0, 0, 0, 0), 0.12)
    assert step.done, "one that names nobody is an old autopilot's, and for all"
