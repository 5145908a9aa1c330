"""MAVLink 2 signing: which frames are ours to believe, and the proof that a frame is from us. Sans-IO.

A signed frame has bit 0 of its incompatible flags set and 13 more bytes behind the checksum:

    byte 0       link id
    byte 1..6    time stamp: units of 10 µs since 2015-01-01 UTC, little-endian; it grows with every frame
    byte 7..12   first 6 bytes of SHA-256 over the key and the whole frame up to here

Source: mavlink.io/en/guide/message_signing.html; the same bytes as pymavlink 2.4.50.
"""

from collections.abc import Callable
from hashlib import sha256
from hmac import compare_digest

from fastcrc.crc16 import mcrf4xx

KEY_BYTES = 32
SIGNED = 0x01
"""Bit of the incompatible flags of a frame that is signed."""
SIGNATURE_BYTES = 13
TICKS_PER_S = 100_000
"""Units of the time stamp in a second."""
MINUTE = 60 * TICKS_PER_S
"""A sender that nobody has heard yet may be this far behind our own time stamp."""

_V2 = 0xFD
_RADIO_STATUS = 109  # telemetry radios put it in by themselves, and know no key


class Signer:
    """Signs what leaves and judges what arrives, with one key."""

    def __init__(self, key: bytes, clock: Callable[[], int], link_id: int = 0) -> None:
        """``clock()`` tells the time in units of 10 µs since 2015-01-01 UTC.

        Raises:
            ValueError: the key has not 32 bytes.
        """
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key
        self._clock = clock
        self._link = bytes([link_id])
        self._streams: dict[bytes, int] = {}
        self.stamp = 0
        """The newest time stamp used or believed."""

    def sign(self, frame: bytes, crc_extra: int) -> bytes:
        """The unsigned MAVLink 2 ``frame``, signed; its definition's ``crc_extra`` makes the checksum anew."""
        body = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3:-2]
        body += mcrf4xx(body[1:] + bytes([crc_extra])).to_bytes(2, "little")
        self.stamp = max(self.stamp + 1, self._clock())
        body += self._link + self.stamp.to_bytes(6, "little")
        return body + self._proof(body)

    def refuse(self, frame: bytes) -> str:
        """Why the whole ``frame``, whose checksum is right, is not believed: unsigned, bad_signature or replayed.

        Empty where it is believed; its time stamp then can't be used again.
        """
        if frame[0] != _V2 or not frame[2] & SIGNED:
            radio = frame[0] == _V2 and int.from_bytes(frame[7:10], "little") == _RADIO_STATUS
            return "" if radio else "unsigned"
        if not compare_digest(self._proof(frame[:-6]), frame[-6:]):
            return "bad_signature"
        stream, stamp = frame[5:7] + frame[-13:-12], int.from_bytes(frame[-12:-6], "little")
        newest = self._streams.get(stream)
        if newest is None:
            newest = max(self.stamp, self._clock()) - MINUTE - 1
        if stamp <= newest:
            return "replayed"
        self._streams[stream] = stamp
        self.stamp = max(self.stamp, stamp)
        return ""

    def _proof(self, body: bytes) -> bytes:
        return sha256(self._key + body).digest()[:6]
