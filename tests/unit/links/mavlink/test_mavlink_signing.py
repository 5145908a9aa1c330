"""Signing: what is signed, what is accepted, and how the key is kept on disk."""

import base64
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from links.io import make_key, read_key
from links.mavlink import StampFile
from links.mavlink.protocol import MavlinkCodec, Signer
from tests.mavlink_table import golden

# By their numbers: a limit that the test took from the code would bear out any value.
TICKS_PER_S = 100000
MINUTE = 60 * TICKS_PER_S
KEY_BYTES = 32

KEY = bytes(range(32))
NOW = 375_000_000 * TICKS_PER_S


def signed(stamp: int = NOW, system: int = 1, key: bytes = KEY, component: int = 1) -> MavlinkCodec:
    codec = MavlinkCodec(system, component)
    codec.signer = Signer(key, lambda: stamp)
    return codec


def theirs(stamp: int = NOW) -> mavlink.MAVLink:
    """pymavlink's own signer: the independent one."""
    peer = mavlink.MAVLink(None, 1, 1)
    peer.signing.secret_key = KEY
    peer.signing.sign_outgoing = True
    peer.signing.timestamp = stamp
    peer.signing.link_id = 3
    return peer


def heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)


GOLDEN = (
    "fd27010000f5be520000dc0500000000803f0000000000000000"
    "00000000cdcccc3dcdcc4c3e9a99993e0000003f010180"
)
"""SET_ATTITUDE_TARGET as in test_mavlink_codec.py, but for the flag that says that it is signed."""


def test_a_signed_frame_has_these_bytes() -> None:
    codec = signed(0x010203040506, system=245, component=190)
    frame = codec.attitude_target(1.5, 1, 1, 0.5, (0.1, 0.2, 0.3)).hex()
    assert frame[: len(GOLDEN)] == GOLDEN
    assert frame[len(GOLDEN) :] == "cb3b" + "00" + "060504030201" + "fef9eb2d8a4a"
    assert len(frame) == 2 * 64


def test_what_we_sign_pymavlink_believes() -> None:
    peer = theirs(NOW - 1)
    peer.signing.sign_outgoing = False
    ours = signed()
    for n in range(3):
        frames = ours.attitude_target(n, 1, 1, 0.5, (0.0, 0.0, 0.0)), ours.command(1, 1, 400, 1.0)
        read = peer.parse_buffer(b"".join(frames))
        assert [message.get_signed() for message in read] == [True, True]


def test_what_pymavlink_signs_we_believe() -> None:
    peer, ours = theirs(), signed()
    for _ in range(3):
        assert len(ours.feed(heartbeat().pack(peer))) == 1
    assert ours.dropped == {}


@given(st.integers(1, 10_000_000), st.data())
def test_a_frame_with_any_bit_changed_is_not_believed(_: int, data: st.DataObject) -> None:
    frame = bytearray(heartbeat().pack(theirs()))
    bit = data.draw(st.integers(0, 8 * len(frame) - 1))
    frame[bit // 8] ^= 1 << bit % 8
    ours = signed()
    assert ours.feed(bytes(frame)) == []
    assert ours.received == 0


ATTITUDE = mavlink.MAVLink_attitude_message(7, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)


def unsigned(**form: Any) -> bytes:
    return bytes(heartbeat().pack(mavlink.MAVLink(None, 1, 1), **form))


@pytest.mark.parametrize(
    ("frames", "key", "accepted", "dropped"),
    [
        (golden("HEARTBEAT").frame + unsigned(force_mavlink1=True), KEY, 0, {"unsigned": 2}),
        (heartbeat().pack(theirs()), bytes(31) + b"\1", 0, {"bad_signature": 1}),
        (2 * heartbeat().pack(theirs()), KEY, 1, {"replayed": 1}),
        (heartbeat().pack(theirs()) + ATTITUDE.pack(theirs(NOW - 1)), KEY, 1, {"replayed": 1}),
        (heartbeat().pack(theirs(NOW - MINUTE)), KEY, 1, {}),
        (heartbeat().pack(theirs(NOW - MINUTE - 1)), KEY, 0, {"replayed": 1}),
    ],
    ids=[
        "not signed",
        "another key",
        "twice",
        "older than another message",
        "a minute behind",
        "more than a minute behind",
    ],
)
def test_what_is_not_believed_is_counted_by_its_reason(
    frames: bytes, key: bytes, accepted: int, dropped: dict[str, int]
) -> None:
    ours = signed(key=key)
    assert len(ours.feed(frames)) == accepted
    assert ours.dropped == dropped


def test_a_telemetry_radio_may_put_in_its_status_unsigned() -> None:
    status = mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7)
    frame = status.pack(mavlink.MAVLink(None, 51, 68))
    assert [m.get_type() for m in signed().feed(frame)] == ["RADIO_STATUS"]


def test_stamps_grow_also_where_the_clock_stands_still_or_the_other_is_ahead() -> None:
    ours = signed()
    stamps = [int.from_bytes(ours.heartbeat()[-12:-6], "little") for _ in range(3)]
    assert stamps == [NOW, NOW + 1, NOW + 2]
    ours.feed(heartbeat().pack(theirs(NOW + 1000)))
    assert int.from_bytes(ours.heartbeat()[-12:-6], "little") == NOW + 1001


def test_a_forged_frame_in_a_stream_is_skipped_whole() -> None:
    ours, peer = signed(), theirs()
    forged = bytearray(heartbeat().pack(peer))
    forged[-1] ^= 1
    assert len(ours.feed(bytes(forged) + heartbeat().pack(peer))) == 1
    assert ours.dropped == {"bad_signature": 1}


def test_a_forged_stamp_of_the_future_does_not_lock_the_true_sender_out() -> None:
    # pymavlink 2.4.50 stores a stamp before it compares the signature: it then hears nobody.
    ours, peer = signed(), theirs()
    forged = heartbeat().pack(theirs(NOW + MINUTE))
    forged = forged[:-6] + bytes(6)
    assert ours.feed(forged, ("10.0.0.66", 666)) == []
    assert len(ours.feed(heartbeat().pack(peer), ("10.0.0.1", 14550))) == 1
    assert ours.dropped == {"bad_signature": 1}
    assert ours.signer is not None and ours.signer.stamp < NOW + MINUTE


# ---- the key on disk


def key_file(folder: Path, data: bytes, mode: int = 0o600) -> Path:
    path = folder / "key"
    path.write_bytes(data)
    path.chmod(mode)
    return path


@pytest.mark.parametrize(
    "data", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n", base64.b64encode(KEY)]
)
def test_a_key_is_read_raw_or_as_text(tmp_path: Path, data: bytes) -> None:
    assert read_key(key_file(tmp_path, data)) == KEY


NO_KEYS = (b"", KEY[:31], KEY + b"1", b"secret", KEY.hex().encode()[:-2], b"\xff" * 64)


@pytest.mark.parametrize(
    ("data", "mode", "says"),
    [
        *((KEY, mode, f"has mode {mode:04o}") for mode in (0o644, 0o640, 0o606, 0o700, 0o400)),
        *((data, 0o600, "is no key") for data in NO_KEYS),
        (bytes(32), 0o600, "only zeros"),
    ],
)
def test_what_others_may_read_or_is_no_key_is_refused(
    tmp_path: Path, data: bytes, mode: int, says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        read_key(key_file(tmp_path, data, mode))


def test_a_key_that_is_not_there_or_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="No such file"):
        read_key(tmp_path / "key")
    with pytest.raises(ValueError, match="Is a directory"):
        read_key(tmp_path)


@pytest.mark.skipif(os.getuid() != 0, reason="left out: only root can give a file away")
def test_a_key_of_another_user_is_refused(tmp_path: Path) -> None:
    path = key_file(tmp_path, KEY)
    os.chown(path, 1234, 1234)
    with pytest.raises(ValueError, match="belongs to another user"):
        read_key(path)


def test_after_a_restart_no_stamp_is_used_again_even_if_the_clock_was_set_back(
    tmp_path: Path,
) -> None:
    stamps = StampFile(key_file(tmp_path, KEY))
    stamps.keep(5)
    now = stamps.first()
    assert now > 10 * 365 * 86400 * TICKS_PER_S, "a clock that went on counts: after 2025"
    stamps.keep(now + 1_000_000_000)
    assert stamps.first() == now + 1_000_000_001


@pytest.mark.parametrize("text", ["yesterday", "", "-1", "281474976710655"])
def test_a_damaged_stamp_is_told_of_also_one_that_no_stamp_of_48_bits_can_follow(
    tmp_path: Path, text: str
) -> None:
    path = key_file(tmp_path, KEY)
    (tmp_path / "key.stamp").write_text(text)
    with pytest.raises(ValueError, match="remove it"):
        StampFile(path).first()


def test_a_new_key_is_for_its_owner_alone_and_different_each_time(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    make_key(first)
    make_key(second)
    assert first.stat().st_mode & 0o777 == 0o600
    assert len(read_key(first)) == KEY_BYTES
    assert read_key(first) != read_key(second)


def test_a_key_is_never_written_over(tmp_path: Path) -> None:
    make_key(tmp_path / "key")
    before = read_key(tmp_path / "key")
    with pytest.raises(ValueError, match="File exists"):
        make_key(tmp_path / "key")
    assert read_key(tmp_path / "key") == before
