"""MAVLink 2 signing: stamps for what leaves, and refusal of forged and old frames. Sans-IO.

A signed frame has bit 0 of its incompatible flags set and 13 more bytes behind the checksum:

    byte 0       link id
    byte 1..6    time stamp: units of 10 µs since 2015-01-01 UTC, little-endian; it grows with every
                 frame
    byte 7..12   first 6 bytes of SHA-256 over the key and the whole frame up to here

pymavlink signs what leaves. What arrives is judged here: pymavlink (2.4.50, check_signature) stores
a frame's stamp before it compares its signature, so that one forged frame with a stamp of the far
future locks the true sender out.

Source: mavlink.io/en/guide/message_signing.html.
"""

from collections.abc import Callable
from hashlib import sha256
from hmac import compare_digest

from pymavlink.dialects.v20 import minimal

TICKS_PER_S = 100_000
"""Units of the time stamp in a second."""
LAST_STAMP = 2**48 - 1
"""Largest time stamp of a signature: it has 48 bits (MAVLink 2)."""


class Signer:
    """Signing state of one link: its key, its stamps, and the newest stamp of each sender."""

    def __init__(self, key: bytes, clock: Callable[[], int]) -> None:
        """Sign with the 32 bytes of ``key``.

        ``clock()`` tells the time in units of 10 µs since 2015-01-01 UTC.
        """
        self.key = key
        self._clock = clock
        self._newest: dict[bytes, int] = {}
        self.stamp = 0
        """The newest time stamp used or accepted."""

    def next_stamp(self) -> int:
        """The time stamp for the next frame that leaves; none is given twice."""
        self.stamp = max(self.stamp + 1, self._clock())
        return self.stamp

    def refuse(self, frame: bytes, *, keep: bool = True) -> str:
        """Why ``frame``, whose checksum is right, is refused: unsigned, bad_signature, replayed.

        Empty where it is accepted; its time stamp then can't be used again. Senders are told apart
        by link id, system and component, not by address: a copy from another port is refused too.
        With ``keep`` false nothing is remembered: the frame comes from an address that is not used.
        """
        if frame[0] != minimal.PROTOCOL_MARKER_V2 or not frame[2] & minimal.MAVLINK_IFLAG_SIGNED:
            return "unsigned"
        if not compare_digest(sha256(self.key + frame[:-6]).digest()[:6], frame[-6:]):
            return "bad_signature"
        sender, stamp = frame[5:7] + frame[-13:-12], int.from_bytes(frame[-12:-6], "little")
        newest = self._newest.get(sender)
        if newest is None:
            # One that was not heard yet may be a minute behind us (rule of the guide).
            newest = max(self.stamp, self._clock()) - 60 * TICKS_PER_S - 1
        if stamp <= newest:
            return "replayed"
        if keep:
            self._newest[sender] = stamp
            self.stamp = max(self.stamp, stamp)
        return ""
