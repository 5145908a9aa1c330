"""Both codecs of serial RF modules on documented frames and on garbage."""

import pytest

from links.rf import RF_CODECS, CrsfLinkConfig, DsmLinkConfig, RfFrame, Service
from tests.rf_table import CODECS, ROWS, Row, of_kind

row = pytest.mark.parametrize("row", ROWS, ids=lambda row: row.about)
kind = pytest.mark.parametrize("kind", list(RF_CODECS))


def test_every_codec_has_golden_frames() -> None:
    assert CODECS.keys() == RF_CODECS.keys()
    assert all(of_kind(kind) for kind in RF_CODECS)


@row
def test_the_reader_finds_what_the_golden_frame_says(row: Row) -> None:
    decoder = row.codec.decoder()
    assert decoder.feed(row.frame) == [RfFrame(row.positions, row.service, row.model_id)]
    assert not decoder.dropped


@row
def test_the_writer_gives_the_golden_frame_byte_for_byte(row: Row) -> None:
    greets = row.positions is None and row.service is None
    written = (
        row.codec.greeting()
        if greets
        else row.codec.encode(row.positions or [0.0] * 16, row.service)
    )
    assert written.hex(" ") == row.frame.hex(" ")


@kind
def test_frames_in_garbage_are_found_whatever_the_cut(kind: str) -> None:
    rows = of_kind(kind)
    stream = b"\xff\x07garbage" + b"".join(b"\xf0\xf1" + row.frame for row in rows) + b"\xfe" * 80
    whole, cut = CODECS[kind].decoder(), CODECS[kind].decoder()
    expected = whole.feed(stream)
    assert [heard.positions for heard in expected] == [row.positions for row in rows]
    assert [heard for i in range(len(stream)) for heard in cut.feed(stream[i : i + 1])] == expected
    assert cut.dropped == whole.dropped
    assert sum(whole.dropped.values()) >= 9 + 2 * len(rows)


@kind
def test_a_half_frame_costs_only_itself(kind: str) -> None:
    first, second = of_kind(kind)[:2]
    decoder = CODECS[kind].decoder()
    assert decoder.feed(first.frame[:-5]) == []
    decoder.pause()
    assert decoder.dropped == {"cut_short": len(first.frame) - 5}
    assert [heard.positions for heard in decoder.feed(second.frame)] == [second.positions]


def test_a_crsf_frame_with_any_bit_turned_is_dropped() -> None:
    frame = of_kind("crsf")[0].frame
    for bit in range(8 * len(frame)):
        broken = bytearray(frame)
        broken[bit // 8] ^= 1 << bit % 8
        # Not zeros: a frame, its checksum and a zero are a frame again, one longer.
        heard = CODECS["crsf"].decoder().feed(bytes(broken) + b"\xff" * 80)
        # The first byte is outside the checksum: another address is another address.
        assert all(h.positions is None for h in heard) or bit < 8
    ping = bytes.fromhex("C8 04 28 EE EA 97")
    assert CODECS["crsf"].decoder().feed(ping) == [RfFrame(None)], "no channels, and no damage"


@kind
def test_positions_beyond_the_wire_stop_at_its_ends(kind: str) -> None:
    codec = CODECS[kind]
    (heard,) = codec.decoder().feed(codec.encode([9.0, -9.0] * (codec.channels // 2)))
    assert heard.positions is not None and heard.positions[0] > 1.0
    assert heard.positions[1] < -1.0


def test_a_dsm_service_is_in_every_frame_and_a_crsf_order_in_the_first() -> None:
    dsm, crsf = CODECS["dsm"], CODECS["crsf"]
    assert [dsm.encode([0.0] * 6, Service.BIND, nth)[0] for nth in range(3)] == [0x98] * 3
    frames = [crsf.encode([0.0] * 16, Service.BIND, nth)[2] for nth in range(3)]
    assert frames == [0x32, 0x16, 0x16]


@pytest.mark.parametrize(("model", "greets"), [(None, False), (7, True)])
def test_only_a_crsf_module_with_a_model_is_greeted(model: int | None, greets: bool) -> None:
    assert bool(CrsfLinkConfig(model_id=model).codec().greeting()) is greets
    assert DsmLinkConfig(model_id=7).codec().greeting() == b""
