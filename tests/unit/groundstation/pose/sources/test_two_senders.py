"""Two trackers that send poses of one vehicle to one port: one of them is used, and both are named."""

from collections.abc import Callable

import pytest

from groundstation.core.messages import PoseStatus
from groundstation.pose.sources import Intake, JsonReader, ViconReader
from groundstation.pose.sources.intake import FEW_POSES, PoseReader
from groundstation.pose.sources.json_codec import encode as encode_json, json_pose
from groundstation.pose.sources.mavlink_codec import VisionEstimate, VisionReader, encode_vision
from groundstation.pose.sources.vicon_codec import ViconObject, encode
from links.mavlink.protocol import MavlinkCodec

# By their numbers: a limit that the test took from the code would bear out any value.
ALONE_S = 1.0
BOTH_S = 3.0

FIRST = ("10.0.0.5", 51001)
SECOND = ("10.0.0.7", 40123)
FRAME_S = 0.02
ASIDE_M = 1.5
"""How far aside the second tracker sees the vehicle [m]."""


def vicon(n: int, north_m: float) -> bytes:
    return encode(n, [ViconObject("quad", (1e3 * north_m + 0.1 * (n % 3), 0.0, 500.0), (0.0, 0.0, 0.1))])


def json_line(n: int, north_m: float) -> bytes:
    place = (north_m + 1e-4 * (n % 3), 0.0, 0.5)
    return encode_json([json_pose("quad", place, (1.0, 0.0, 0.0, 0.0), t=FRAME_S * n)])


def vision(n: int, north_m: float) -> bytes:
    place = (north_m + 1e-4 * (n % 3), 0.0, -0.5)
    return encode_vision(MavlinkCodec(1, 197), VisionEstimate(FRAME_S * n, place, (1.0, 0.0, 0.0, 0.0)))


def make_vicon() -> PoseReader:
    return ViconReader("quad", Intake(0.02, frame_s=FRAME_S))


def make_json() -> PoseReader:
    return JsonReader("quad", Intake(0.02), Intake(0.02, frame_s=FRAME_S))


def make_vision() -> PoseReader:
    return VisionReader(Intake(0.02))


SOURCES = [(make_vicon, vicon), (make_json, json_line), (make_vision, vision)]


def listen(reader: PoseReader, frames: range, line: Callable[[int, float], bytes], *senders: object) -> list[float]:
    """Read the frames of the first sender where the vehicle is, of each other aside; returns where poses put it."""
    norths = []
    for n in frames:
        for k, sender in enumerate(senders):
            reader.sender = sender
            # The second tracker's clock is ahead, as one's that was started later may be.
            data = line(n + 500 * k, ASIDE_M * k)
            norths += [pose.position_ned[0] for pose in reader.read(data, FRAME_S * n + 0.001 * k)]
    return norths


@pytest.mark.parametrize(("make", "line"), SOURCES, ids=["vicon", "json", "vision"])
def test_the_first_of_two_senders_is_used_and_both_are_named(
    make: Callable[[], PoseReader], line: Callable[[int, float], bytes]
) -> None:
    reader = make()
    alone = listen(reader, range(50), line, FIRST)
    both = listen(reader, range(50, 150), line, FIRST, SECOND)
    assert len(alone) == 50
    assert len(both) == 100
    assert all(abs(north) < 0.1 for north in both)
    status: PoseStatus = reader.status
    assert status.dropped == {"second_sender": 100}
    assert "come from two addresses, 10.0.0.5:51001 and 10.0.0.7:40123" in status.advice
    listen(reader, range(150, 151 + round(BOTH_S / FRAME_S)), line, FIRST)
    assert reader.status.advice == ""


@pytest.mark.parametrize(("make", "line"), SOURCES, ids=["vicon", "json", "vision"])
def test_two_senders_that_begin_at_once_are_told_within_a_few_poses(
    make: Callable[[], PoseReader], line: Callable[[int, float], bytes]
) -> None:
    reader = make()
    norths = listen(reader, range(50), line, FIRST, SECOND)
    assert sum(abs(north) < 0.1 for north in norths) >= 50 - FEW_POSES, "of two clocks none keeps the other's"
    assert reader.status.dropped["second_sender"] == 50 - FEW_POSES
    assert "come from two addresses, 10.0.0.5:51001 and 10.0.0.7:40123" in reader.status.advice


def test_a_tracker_that_takes_over_from_one_that_fell_silent_is_no_second_one() -> None:
    reader = make_json()
    listen(reader, range(50), json_line, FIRST)
    later = 51 + round(ALONE_S / FRAME_S)
    assert len(listen(reader, range(later, later + 50), json_line, SECOND)) == 50
    assert (reader.status.dropped, reader.status.advice) == ({}, "")


def test_a_program_that_sends_each_datagram_from_another_port_is_one_sender() -> None:
    reader = make_json()
    for n in range(300):
        reader.sender = ("10.0.0.5", 40000 + n)
        assert reader.read(json_line(n, 0.0), FRAME_S * n)
    assert (reader.status.dropped, reader.status.advice) == ({}, "")


def test_two_trackers_that_each_send_a_body_of_their_own_do_not_compete() -> None:
    reader = make_json()
    for n in range(100):
        reader.sender = FIRST
        assert reader.read(json_line(n, 0.0), FRAME_S * n)
        reader.sender = SECOND
        other = encode_json([json_pose("cart", (1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), t=FRAME_S * n)])
        assert not reader.read(other, FRAME_S * n)
    assert reader.status.dropped == {"no_such_body": 100}
    assert reader.status.advice == ""
