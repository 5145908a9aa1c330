"""The MAVLink traffic of a flight as .tlog, for Mission Planner, MAVProxy and QGroundControl.

The form is in groundstation/pose/sources/tlog_codec.py: each frame behind the microseconds since 1970, big-endian.
"""

from links.mavlink.protocol.codec import frame_end

_LONGEST_FRAME = 293
"""A frame of MAVLink 2 with its signature; what waits longer for its end is none."""


class TlogCutter:
    """Cuts the bytes of one direction into the records of a .tlog. Sans-IO."""

    def __init__(self, *, datagrams: bool) -> None:
        """``datagrams``: bytes come in whole frames; on a stream they may be cut anywhere."""
        self._datagrams = datagrams
        self._pending = b""

    def records(self, data: bytes, stamp_ns: int) -> bytes:
        """The records of the frames that ``data`` brings to an end at ``stamp_ns`` [ns since 1970]."""
        data = self._pending + data
        stamp = (stamp_ns // 1000).to_bytes(8, "big")
        found = bytearray()
        start, size = 0, len(data)
        while start < size:
            end = frame_end(data, start)
            if end > size:
                break
            if end:
                found += stamp + data[start:end]
                start = end
            else:
                start += 1
        self._pending = b"" if self._datagrams else data[start : start + _LONGEST_FRAME]
        return bytes(found)
