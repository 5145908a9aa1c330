"""Files of recorded poses: CSV, and the .tlog of a MAVLink flight. Sans-IO.

CSV has one row a pose, in order of time:

    t,x,y,z,qw,qx,qy,qz          [s, m, -]
    t,x,y,z,qw,qx,qy,qz,arrival  as in a run's folder: also when its bytes came [s], by the same clock

A first row of names may stand above; empty rows and rows that begin with # are skipped.

A .tlog has every MAVLink frame of a flight, both ways, each behind the time that it was logged:

    8 bytes   microseconds since 1970, big-endian
    n bytes   the frame (links/mavlink/protocol/codec.py)

Who sent a frame tells its direction: the vehicle's system, or a ground station's.
Source: MAVProxy, Mission Planner and QGroundControl all write this form.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import msgspec

from groundstation.core.geometry import Quat, Vec3
from links.mavlink.protocol import MavlinkCodec, Message, frame_end

CSV_COLUMNS = "t,x,y,z,qw,qx,qy,qz,arrival"
LONGEST_ROW = 1000
"""A longer row is none [characters]."""


class CsvRow(NamedTuple):
    """One recorded pose, in the axes of the file."""

    t_s: float
    """When it was true, on the clock of the recording [s]."""
    arrival_s: float
    """When it came, on the same clock [s]; ``t_s`` where the file does not tell."""
    position: Vec3
    attitude: Quat


def encode_csv(row: CsvRow) -> str:
    """The row with its end of line; numbers read back to the last bit."""
    numbers = (row.t_s, *row.position, *row.attitude, row.arrival_s)
    text = msgspec.json.encode(numbers).decode()
    if "e" in text or "0.0000" in text or "null" in text:  # which JSON writes otherwise than Python
        text = f"[{','.join(map(repr, numbers))}]"
    return text[1:-1] + "\n"


def read_csv(lines: Iterable[str], dropped: Counter[str]) -> Iterator[CsvRow]:
    """The poses in ``lines``; what is none is counted in ``dropped``: malformed, not_finite."""
    first = True
    for line in lines:
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        heading, first = first and text[0].isalpha(), False
        if heading:
            continue
        fields = text.split(",") if len(text) <= LONGEST_ROW else []
        try:
            t, x, y, z, qw, qx, qy, qz, *more = map(float, fields)
            (arrival,) = more or [t]
        except ValueError:
            dropped["malformed"] += 1
            continue
        if math.isfinite(t + arrival + x + y + z + qw + qx + qy + qz):
            yield CsvRow(t, arrival, (x, y, z), (qw, qx, qy, qz))
        else:
            dropped["not_finite"] += 1


_STAMP_BYTES = 8


class TlogRecord(NamedTuple):
    """One logged message."""

    time_s: float
    """When it was logged [s since 1970]."""
    message: Message
    """``message.get_srcSystem()`` tells who sent it."""


class TlogReader:
    """Iterates over the records of a .tlog's bytes; what is no record is skipped and counted."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._codec = MavlinkCodec(255, 190)

    @property
    def dropped(self) -> Counter[str]:
        """By reason: truncated (a last record cut off), bad_crc, unknown (frames), garbage (bytes)."""
        return self._codec.dropped

    def __iter__(self) -> Iterator[TlogRecord]:
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
                yield TlogRecord(int.from_bytes(data[start:begin], "big") * 1e-6, message)
                lost = False
            elif fault != "unknown" or lost:
                if not fault:
                    codec.dropped["garbage"] += 1
                lost = True
                start += 1
                continue
            start = end
