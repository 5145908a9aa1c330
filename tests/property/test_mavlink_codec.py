"""The MAVLink reader on any bytes."""

from typing import Any

import pytest
from hypothesis import given, strategies as st

from groundstation.pose.sources import LocalPositionDecoder, OdometryDecoder
from links.mavlink.protocol import MavlinkCodec, Words
from sim.autopilots import AUTOPILOTS, SimulatedAutopilot
from tests.airframe_double import Brick
from tests.mavlink_table import FRAMES

frames = st.sampled_from([g.frame for g in FRAMES])


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """A real frame with some bytes changed, cut out or put in."""
    frame = bytearray(draw(frames))
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(frame)))
        frame[at : at + draw(st.integers(0, 4))] = draw(st.binary(max_size=4))
    return bytes(frame)


streams = st.lists(st.one_of(frames, damaged(), st.binary(max_size=60)), max_size=6).map(b"".join)


def told(messages: list[Any]) -> list[str]:
    return [repr((m.get_seq(), m.get_srcSystem(), str(m))) for m in messages]


@given(streams, st.lists(st.integers(0, 400), max_size=8))
def test_a_stream_cut_anywhere_reads_as_if_it_came_at_once(data: bytes, cuts: list[int]) -> None:
    whole, pieces, single = (MavlinkCodec(245, 190) for _ in range(3))
    expected = told(whole.feed(data))
    assert len(expected) == whole.received
    assert all(count > 0 for count in whole.dropped.values())
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    got = [m for a, b in zip(edges, edges[1:], strict=False) for m in pieces.feed(data[a:b])]
    assert told(got) == expected
    assert told([m for byte in data for m in single.feed(bytes([byte]))]) == expected
    assert whole.dropped == pieces.dropped == single.dropped


@given(st.lists(streams, max_size=20))
def test_the_reader_keeps_less_than_one_frame(chunks: list[bytes]) -> None:
    codec = MavlinkCodec(245, 190)
    for chunk in chunks:
        codec.feed(chunk)
        assert sum(map(len, codec._unfinished.values())) <= 293


@given(
    st.lists(frames, min_size=1, max_size=4),
    st.binary(max_size=20).filter(lambda b: not {0xFD, 0xFE} & set(b)),
)
def test_whole_frames_are_all_found_between_garbage(real: list[bytes], garbage: bytes) -> None:
    codec = MavlinkCodec(245, 190)
    assert len(codec.feed(garbage + garbage.join(real))) == len(real)
    assert codec.dropped["garbage"] == len(garbage) * len(real)


@given(st.lists(st.one_of(frames, damaged()), max_size=6), st.floats(0.0, 1e6))
def test_no_message_makes_a_pose_decoder_or_the_words_raise(
    datagrams: list[bytes], now_s: float
) -> None:
    codec, words = MavlinkCodec(245, 190), Words()
    decoders = (OdometryDecoder(0.0), LocalPositionDecoder(0.0))
    for data in datagrams:
        for message in codec.feed(data):
            if message.get_type() == "STATUSTEXT":
                words.hear(message)
            for decoder in decoders:
                decoder.decode(message, now_s)


numbers = st.floats(width=32)


@pytest.mark.parametrize("make", AUTOPILOTS.values(), ids=AUTOPILOTS)
@given(
    requests=st.lists(
        st.one_of(
            st.tuples(st.sampled_from([21, 176, 400, 511, 16]), numbers, numbers, numbers),
            st.tuples(st.integers(0, 255), numbers, numbers, numbers, numbers),
            st.tuples(st.sampled_from(["GUID_OPTIONS", "COM_RCL_EXCEPT", "GUID_TIMEOUT"]), numbers),
        ),
        max_size=8,
    )
)
def test_no_command_and_no_set_point_makes_the_simulated_autopilot_raise(
    make: type[SimulatedAutopilot], requests: list[tuple[Any, ...]]
) -> None:
    sender = MavlinkCodec(245, 190)
    autopilot = make(Brick())
    autopilot.poll(0.0)
    # Whatever else is asked of it happens in the air.
    for number, mode in ((176, (1.0, 4.0)), (400, (1.0,))):
        autopilot.receive(sender.command(1, 1, number, *mode), 0.0)
    for n, (first, *rest) in enumerate(requests):
        if len(rest) == 1:
            frame = sender.parameter_set(1, 1, first, rest[0], 6) + sender.parameter_request(
                1, 1, first
            )
        elif len(rest) == 3:
            frame = sender.command(1, 1, first, *rest)
        else:
            message = sender.dialect.MAVLink_set_attitude_target_message(
                0, 1, 1, first, [rest[3]] * 4, *rest
            )
            frame = sender.pack(message)
        autopilot.receive(frame, 0.1 * n)
        autopilot.poll(0.1 * n)
        assert autopilot.next_due_s > 0.1 * n
