import pytest
from hypothesis import given, strategies as st

from links.rf import CrsfLinkConfig, DsmLinkConfig
from links.rf.codec import RfCodec
from tests.rf_table import CODECS, ROWS, of_kind

kind = pytest.mark.parametrize("kind", list(CODECS))
positions = st.lists(st.floats(-1.0, 1.0), min_size=16, max_size=16)
STEPS = {"dsm": 832, "crsf": 1639}
"""Counts from -1 to 1."""


def decoded(codec: RfCodec, frame: bytes) -> tuple[float, ...]:
    (heard,) = codec.decoder().feed(frame)
    assert heard.positions is not None
    return heard.positions


@kind
@given(positions)
def test_positions_come_back_within_half_a_count_and_are_written_again_to_the_last_bit(
    kind: str, positions: list[float]
) -> None:
    codec = CODECS[kind]
    frame = codec.encode(positions[: codec.channels])
    back = decoded(codec, frame)
    assert len(back) == codec.channels
    assert all(abs(a - b) <= 1.0001 / STEPS[kind] for a, b in zip(positions, back, strict=False))
    assert codec.encode(back) == frame


@given(
    st.lists(st.integers(0, 1023), min_size=6, max_size=6),
    st.integers(0, 1022),
    st.integers(1, 1023),
)
def test_every_dsm_count_is_reached_with_every_range(
    counts: list[int], low: int, span: int
) -> None:
    codec = DsmLinkConfig(low=low, high=min(low + span, 1023)).codec()
    raw = bytes((0x18, 0)) + b"".join(
        bytes((i << 2 | count >> 8, count & 255)) for i, count in enumerate(counts)
    )
    assert codec.encode(decoded(codec, raw)) == raw


@given(st.lists(st.integers(0, 1984), min_size=16, max_size=16))
def test_every_crsf_count_is_reached(counts: list[int]) -> None:
    codec = CrsfLinkConfig().codec()
    frame = codec.encode([(2 * count - 172 - 1811) / 1639 for count in counts])
    packed = int.from_bytes(frame[3:25], "little")
    assert [packed >> 11 * i & 2047 for i in range(16)] == counts


@kind
@given(st.data())
def test_a_damaged_frame_does_not_keep_the_next_ones_from_being_found(
    kind: str, draw: st.DataObject
) -> None:
    frames = [row.frame for row in of_kind(kind)]
    broken = bytearray(draw.draw(st.sampled_from(frames)))
    for at, value in draw.draw(
        st.lists(st.tuples(st.integers(0, 13), st.integers(0, 255)), min_size=1, max_size=4)
    ):
        broken[at % len(broken)] = value
    good = next(row for row in ROWS if row.codec is of_kind(kind)[0].codec)
    heard = CODECS[kind].decoder().feed(bytes(broken) + 4 * good.frame)
    assert good.positions in [h.positions for h in heard]
