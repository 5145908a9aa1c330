"""Frames to a Spektrum DSM2/DSMX transmitter module (MLP4DSM, LP4DSM, DX5e class). Sans-IO.

    byte 0            0x80 bind, 0x20 range check; 0x10 DSM2, 0x18 DSMX, neither: a ready-to-fly transmitter's module
    byte 1            model (receivers obey the model they were bound to)
    byte 2+2i, 3+2i   i = 0..5: i << 2 | count >> 8, and the count's low byte

14 bytes, 125000 baud, 8N1, no checksum, every 22 ms. Counts are 10 bits; 96, 512, 928 are -100, 0, 100 % of EdgeTX.
An MLP4DSM transmitter was seen to send 86 to 938. On the air it becomes Spektrum's 1100 to 1900 µs.
Source: EdgeTX e2bcbd6c, radio/src/pulses/dsm2.cpp; captures on noisebridge.net, Blade_MLP4DSM_RC.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec

from links.rf.codec import RfFrame, RfLinkConfig, Service, counts, position

FRAME_BYTES = 14
CHANNELS = 6
_BIND, _RANGE_CHECK = 0x80, 0x20
_PROTOCOLS = {"rtf": 0x00, "dsm2": 0x10, "dsmx": 0x18}
_KNOWN_FLAGS = 0xB8
_LARGEST = 1023

Count = Annotated[int, msgspec.Meta(ge=0, le=_LARGEST)]


class DsmLinkConfig(RfLinkConfig, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="dsm"):
    """A DSM2/DSMX module on a serial port. Its polarity is set at the adapter, not here."""

    baud: Annotated[int, msgspec.Meta(ge=1200, le=6_000_000)] = 125000
    """Its speed [bit/s]."""
    protocol: Literal["rtf", "dsm2", "dsmx"] = "dsmx"
    """What the module shall speak on the air; ``rtf`` for the module of a ready-to-fly transmitter."""
    model_id: Annotated[int, msgspec.Meta(ge=0, le=255)] = 0
    """Receivers obey the model that they were bound to."""
    low: Count = 96
    """Count of position -1; 86 as the MLP4DSM transmitter."""
    high: Count = 928
    """Count of position 1; 938 as the MLP4DSM transmitter."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: see :class:`RfLinkConfig`, or the counts are no range.
        """
        if self.low >= self.high:
            raise ValueError("low must be smaller than high; reverse single channels in the map")
        super().__post_init__()

    def codec(self) -> "DsmCodec":
        """The codec that this configures."""
        return DsmCodec(self)


class DsmCodec:
    """Implements :class:`links.rf.codec.RfCodec`."""

    channels = CHANNELS
    services = frozenset((Service.BIND, Service.RANGE_CHECK))
    frame_bytes = FRAME_BYTES

    def __init__(self, config: DsmLinkConfig) -> None:
        """See the configuration."""
        self._config = config
        self._flags = _PROTOCOLS[config.protocol]

    def greeting(self) -> bytes:
        """Nothing: every frame says all."""
        return b""

    def encode(self, positions: Sequence[float], service: Service | None = None, nth: int = 0) -> bytes:
        """The frame for six positions; a service is a flag in every frame while it lasts."""
        config = self._config
        low, high = config.low, config.high
        flags = self._flags | (_BIND if service is Service.BIND else _RANGE_CHECK if service else 0)
        frame = bytearray((flags, config.model_id))
        for i in range(CHANNELS):
            count = counts(positions[i], low, high, _LARGEST)
            frame += bytes((i << 2 | count >> 8, count & 0xFF))
        return bytes(frame)

    def decoder(self) -> "DsmDecoder":
        """A decoder with the same range of counts."""
        return DsmDecoder(self._config.low, self._config.high)


class DsmDecoder:
    """Finds frames by their shape, as they have neither a first byte of their own nor a checksum."""

    def __init__(self, low: int = 96, high: int = 928) -> None:
        """``low`` and ``high`` are the counts of the positions -1 and 1."""
        self.dropped: dict[str, int] = Counter()
        self._low, self._high = low, high
        self._rest = b""

    def feed(self, data: bytes) -> list[RfFrame]:
        """Take the next bytes, however they were cut; returns the frames that they complete."""
        data = self._rest + data
        heard: list[RfFrame] = []
        at = 0
        while len(data) - at >= FRAME_BYTES:
            if _is_frame(data, at):
                heard.append(self._decode_frame(data, at))
                at += FRAME_BYTES
            else:
                self.dropped["not_a_frame"] += 1
                at += 1
        self._rest = data[at:]
        return heard

    def pause(self) -> None:
        """The wire was silent: whatever was begun will not be completed."""
        if self._rest:
            self.dropped["cut_short"] += len(self._rest)
            self._rest = b""

    def _decode_frame(self, data: bytes, at: int) -> RfFrame:
        low, high = self._low, self._high
        found = [(data[k] & 3) << 8 | data[k + 1] for k in range(at + 2, at + FRAME_BYTES, 2)]
        flags = data[at]
        service = Service.BIND if flags & _BIND else Service.RANGE_CHECK if flags & _RANGE_CHECK else None
        return RfFrame(tuple(position(count, low, high) for count in found), service, data[at + 1])


def _is_frame(data: bytes, at: int) -> bool:
    """Whether the flags are known ones and the channels are numbered 0 to 5."""
    return not data[at] & ~_KNOWN_FLAGS and all(data[at + 2 + 2 * i] >> 2 == i for i in range(CHANNELS))
