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

SIGNED = 0x01
"""Bit of the incompatible flags of a frame that is signed."""
SIGNATURE_BYTES = 13
"""Link id, time stamp and proof behind a signed frame's checksum."""
TICKS_PER_S = 100_000
"""Units of the time stamp in a second."""
MINUTE = 60 * TICKS_PER_S
"""A sender that was not heard yet may be this far behind our own time stamp (rule of the guide)."""

V2 = 0xFD
"""First byte of a frame of MAVLink 2."""
_RADIO_STATUS = 109
"""Telemetry radios insert RADIO_STATUS by themselves, and know no key."""


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
        if frame[0] != V2 or not frame[2] & SIGNED:
            is_radio = frame[0] == V2 and int.from_bytes(frame[7:10], "little") == _RADIO_STATUS
            return "" if is_radio else "unsigned"
        if not compare_digest(sha256(self.key + frame[:-6]).digest()[:6], frame[-6:]):
            return "bad_signature"
        sender, stamp = frame[5:7] + frame[-13:-12], int.from_bytes(frame[-12:-6], "little")
        newest = self._newest.get(sender)
        if newest is None:
            newest = max(self.stamp, self._clock()) - MINUTE - 1
        if stamp <= newest:
            return "replayed"
        if keep:
            self._newest[sender] = stamp
            self.stamp = max(self.stamp, stamp)
        return ""
