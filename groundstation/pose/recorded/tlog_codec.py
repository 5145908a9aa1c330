"""The .tlog file: every MAVLink frame of a flight, both ways, each behind the time that it was logged. Sans-IO.

    8 bytes   microseconds since 1970, big-endian
    n bytes   the frame (links/mavlink/protocol/codec.py)

Who sent a frame tells its direction: the vehicle's system, or a ground station's.
Source: MAVProxy, Mission Planner and QGroundControl all write this form.
"""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from links.mavlink.protocol import MavlinkCodec, Message, frame_end

_STAMP_BYTES = 8


class Record(NamedTuple):
    """One logged message."""

    time_s: float
    """When it was logged [s since 1970]."""
    message: Message
    """``message.get_srcSystem()`` tells who sent it."""


class TlogReader:
    """Iterates over the records of a .tlog's bytes; what is no record is skipped and counted."""

    def __init__(self, data: bytes) -> None:
        """Nothing is read before the iteration."""
        self._data = data
        self._codec = MavlinkCodec(255, 190)

    @property
    def dropped(self) -> Counter[str]:
        """By reason: truncated (a last record cut off), bad_crc, malformed, unknown (frames), garbage (bytes)."""
        return self._codec.dropped

    def __iter__(self) -> Iterator[Record]:
        """From the first record, counting anew."""
        data, codec = self._data, self._codec
        codec.dropped.clear()
        start, size = 0, len(data)
        lost = False  # behind damage, until a checksum holds again: stamps are full of bytes that look like frames
        while start < size:
            begin = start + _STAMP_BYTES
            end = frame_end(data, begin) if begin < size else size + 1
            if end > size and not lost:
                codec.dropped["truncated"] += 1
                return
            message, fault = codec.decode(data[begin:end]) if 0 < end <= size else (None, "")
            if message is not None:
                yield Record(int.from_bytes(data[start:begin], "big") * 1e-6, message)
                lost = False
            elif fault != "unknown" or lost:
                if not fault:
                    codec.dropped["garbage"] += 1
                lost = True
                start += 1
                continue
            start = end
