"""The .tlog of a MAVLink flight. Sans-IO.

It has every MAVLink frame of a flight, both ways, each behind the time that it was logged:

    8 bytes   microseconds since 1970, big-endian
    n bytes   the frame (links/mavlink/protocol/codec.py)

System and component of its sender give a frame's direction. The system alone does not: a companion
computer and a motion-capture bridge often have the vehicle's own.
Source: MAVProxy, Mission Planner and QGroundControl all write this form.
"""

import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from pymavlink.dialects.v20 import minimal

from groundstation.core.messages import notice
from groundstation.pose.sources import POSE_MESSAGES
from links.mavlink.protocol import MavlinkCodec, Message, find_frame_end, is_autopilot

_STAMP = struct.Struct(">Q")
"""Time stamp of a record [µs since 1970]."""
RECORDS_SHARE = 0.9
"""Least share of records in a .tlog [-]; of frames without stamps half look like records."""


class Sender(NamedTuple):
    """Sender of a MAVLink message."""

    system: int
    component: int

    def __str__(self) -> str:
        return f"system {self.system}, component {self.component}"

    def is_addressed(self, message: Message) -> bool:
        """Whether ``message`` is addressed to it; 0 addresses all."""
        system = getattr(message, "target_system", None)
        component = getattr(message, "target_component", None)
        return system in (0, self.system) and component in (0, self.component)


class TlogRecord(NamedTuple):
    """One logged message."""

    time_s: float
    """Time of logging [s since 1970]."""
    message: Message

    @property
    def sender(self) -> Sender:
        """The sender of the message."""
        return Sender(self.message.get_srcSystem(), self.message.get_srcComponent())


class TlogReader:
    """Iterator over the records of a .tlog's bytes; other bytes are skipped and counted."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._codec = MavlinkCodec()
        self._used = 0

    def find_fault(self) -> str:
        """Return why these bytes are no .tlog; empty where most of them are records.

        To be called after an iteration.
        """
        size = len(self._data)
        if self._used >= RECORDS_SHARE * size:
            return ""
        return notice(
            "tlog.garbage", garbage=size - self._used, size=size, limit=1.0 - RECORDS_SHARE
        ).text

    @property
    def dropped(self) -> Counter[str]:
        """Counts by reason: truncated (last record), bad_crc, unknown (frames), garbage (bytes)."""
        return self._codec.dropped

    def __iter__(self) -> Iterator[TlogRecord]:
        data, codec = self._data, self._codec
        codec.dropped.clear()
        self._used = 0
        start, size = 0, len(data)
        # Behind damage, until the next valid checksum: bytes of stamps look like frames.
        lost = False
        while start < size:
            begin = start + _STAMP.size
            end = find_frame_end(data, begin) if begin < size else size + 1
            if end > size and not lost:
                codec.dropped["truncated"] += 1
                self._used += size - start
                return
            message, fault = codec.decode(data[begin:end]) if 0 < end <= size else (None, "")
            if message is None and (fault != "unknown" or lost):
                if not fault:
                    codec.dropped["garbage"] += 1
                lost = True
                start += 1
                continue
            self._used += end - start
            if message is not None:
                yield TlogRecord(_STAMP.unpack_from(data, start)[0] * 1e-6, message)
                lost = False
            start = end


def find_autopilots(records: Iterable[TlogRecord]) -> list[Sender]:
    """Return the autopilots among the senders, by their heartbeats.

    In a recording without such heartbeats they are the senders with an autopilot's component id.
    """
    heartbeats = {
        one.sender
        for one in records
        if one.message.get_type() == "HEARTBEAT" and is_autopilot(one.message)
    }
    return sorted(
        heartbeats
        or {one.sender for one in records if one.sender.component == minimal.MAV_COMP_ID_AUTOPILOT1}
    )


def describe_senders(records: Iterable[TlogRecord]) -> str:
    """Describe the senders of messages that give poses, for the operator."""
    senders: dict[str, set[Sender]] = {}
    for record in records:
        name = record.message.get_type()
        if name in POSE_MESSAGES:
            senders.setdefault(name, set()).add(record.sender)
    found = (
        f"{name} of {' and of '.join(map(str, sorted(some)))}"
        for name, some in sorted(senders.items())
    )
    return "; ".join(found) or "none of them"
