"""When each procedure asks, what for, and when it gives up, as the autopilots' times demand."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from links.core import LinkError, LinkLost, LinkRejected
from links.mavlink.protocol import (
    ARDUPILOT,
    PX4,
    AskMode,
    AutopilotAddress,
    Kill,
    MavCommand,
    MavlinkCodec,
    ReadVersion,
    Words,
    arming,
    disarming,
    landing,
    landing_disarmed,
)
from links.mavlink.protocol.procedures import ReadAll, Wait
from tests.unit.links.mavlink.test_mavlink_link import D, ack

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
    return AutopilotAddress(MavlinkCodec(245, 190), Words(), 1, 1, kind, vehicle)


def run(
    make: Make, kind: int, result: int | None
) -> tuple[list[float], list[Any], float, LinkError | None]:
    """Go through a procedure; the autopilot answers commands with ``result``, with None not at all.

    Returns:
        When requests left [s], the requests, when it was over [s], inf where it goes on, and its
        failure.
    """
    theirs = MavlinkCodec(1, 1)
    step = make(address(kind))
    times_s, requests = list[float](), list[Any]()
    for n in range(round(LIMIT_S / STEP_S)):
        now_s = n * STEP_S
        for frame in step.poll(now_s):
            requests += theirs.feed(frame)
            times_s.append(round(now_s, 3))
            if result is not None:
                step.hear(ack(requests[-1].command, result), now_s)
        if step.done or step.failure is not None:
            return times_s, requests, round(now_s, 3), step.failure
    return times_s, requests, math.inf, None


def every(period_s: float, count: int, from_s: float = 0.0) -> list[float]:
    return [round(from_s + period_s * n, 3) for n in range(count)]


@pytest.mark.parametrize(
    ("make", "kind", "result", "asked_s", "over_s", "failure"),
    [
        # Nobody answers: half a second and six times, unless it must go faster or does not matter.
        (arming, PX4, None, every(0.5, 6, 1.2), 4.2, LinkLost),
        (arming, ARDUPILOT, None, every(0.5, 6, 1.2), 4.2, LinkLost),
        (disarming, PX4, None, every(0.5, 6), 3.0, LinkLost),
        (ReadVersion, PX4, None, every(0.5, 3), 1.5, None),
        (AskMode, PX4, None, every(0.1, 15), 1.5, LinkLost),
        (Kill, PX4, None, every(0.05, 100), 5.0, LinkLost),
        (lambda autopilot: ReadAll(autopilot, ["A"]), PX4, None, every(0.5, 6), 3.0, None),
        # A refusal is final once the autopilot had 0.3 s for its words ...
        (disarming, PX4, DENIED, [0.0], 0.3, LinkRejected),
        (disarming, ARDUPILOT, TEMPORARILY_REJECTED, [0.0], 0.3, LinkRejected),
        (Kill, PX4, DENIED, every(0.05, 100), 5.0, LinkRejected),
        # ... but one that may pass is asked again every second, for 4 s.
        (disarming, PX4, TEMPORARILY_REJECTED, every(1.0, 5), 4.3, LinkRejected),
        # What is in progress is left alone for 3 s.
        (disarming, PX4, IN_PROGRESS, every(3.0, 4), math.inf, None),
        # Accepted: mode and arming at once; ArduCopter's rotors then take 2.5 s. A kill counts
        # twice.
        (arming, PX4, 0, [1.2, 1.2], 1.2, None),
        (Kill, PX4, 0, every(0.05, 2), 0.05, None),
        (landing_disarmed, ARDUPILOT, 0, [0.0], 10.0, LinkRejected),
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
    times_s, requests, end_s, why = run(make, kind, result)
    # Each repetition may be one poll late.
    assert times_s == pytest.approx(asked_s, rel=0.04, abs=2.0 * STEP_S)
    assert end_s == pytest.approx(over_s, rel=0.04, abs=2.0 * STEP_S)
    assert type(why) is (type(None) if failure is None else failure)
    if make is not arming:
        counts = [one.confirmation for one in requests if one.get_type() == "COMMAND_LONG"]
        assert counts == list(range(len(counts))), "repetitions are numbered"


@pytest.mark.parametrize(
    ("make", "kind", "requests"),
    [
        (arming, PX4, [(176, 1.0, 6.0, 0.0), (400, 1.0, 0.0, 0.0)]),
        (disarming, PX4, [(400, 0.0, 0.0, 0.0)]),
        (Kill, PX4, [(400, 0.0, 21196.0, 0.0)] * 2),
        (landing, PX4, [(176, 1.0, 4.0, 6.0)]),
        (landing, ARDUPILOT, [(176, 1.0, 9.0, 0.0)]),
        (landing_disarmed, ARDUPILOT, [(176, 1.0, 9.0, 0.0)]),
    ],
)
def test_an_autopilot_is_asked_for_these_commands(
    make: Make, kind: int, requests: list[tuple[float, ...]]
) -> None:
    _, asked, _, _ = run(make, kind, 0)
    assert [(one.command, one.param1, one.param2, one.param3) for one in asked] == requests


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
            arming(autopilot)
    else:
        assert not arming(autopilot).done


def test_of_many_parameters_eight_wait_at_once_and_those_that_were_asked_less_come_first() -> None:
    names = [f"P{n}" for n in range(12)]
    reads, theirs = ReadAll(address(PX4), names), MavlinkCodec(1, 1)
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
    step.hear(HEARTBEAT, 0.01)
    assert not step.done, "it may have left before the question"
    assert len(step.poll(AskMode.period_s)) == 1
    step.hear(ack(MavCommand.REQUEST_MESSAGE, 3), 0.12)
    assert step.done, "also where it refuses: then the heartbeat that comes by itself has told"
    assert step.poll(math.inf) == []


def test_an_answer_to_another_station_s_question_is_none_to_ours() -> None:
    step = AskMode(address(PX4))
    step.poll(0.0)
    step.hear(HEARTBEAT, 0.01)
    step.hear(ack(MavCommand.REQUEST_MESSAGE, 0, 255), 0.02)
    assert not step.done, "that heartbeat may have left before our question"
    assert len(step.poll(AskMode.period_s)) == 1
    step.hear(ack(MavCommand.REQUEST_MESSAGE, 0, 0, 0), 0.12)
    assert step.done, "one that names nobody is an old autopilot's, and for all"


def test_a_version_is_told_in_numbers_and_the_first_bytes_of_the_commit() -> None:
    step = ReadVersion(address(PX4))
    (question,) = MavlinkCodec(1, 1).feed(*step.poll(0.0))
    assert (question.command, question.param1) == (MavCommand.REQUEST_MESSAGE, 148.0)
    commit, none = list(bytes.fromhex("0a1b2c3d4e5f6071")), [0] * 8
    numbers = (0, 0x01_11_03_FF, 0, 0, 0, commit, none, none, 0, 0, 0)
    step.hear(D.MAVLink_autopilot_version_message(*numbers), 0.1)
    assert step.done
    assert step.firmware == "PX4 1.17.3 release 0a1b2c3d4e5f6071"
