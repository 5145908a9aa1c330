"""What the fuzzer tries on pose sources: one subject a decoder, with good datagrams to damage."""

import struct
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Protocol

from tests.proving.fuzz.pose_bytes import FLIGHTS, natnet_handshake


class Subject(Protocol):
    """One decoder."""

    @property
    def seeds(self) -> Sequence[bytes]:
        """Good datagrams, to be damaged."""
        ...

    def feed(self, datagram: bytes, now_s: float) -> int:
        """Decode one datagram; returns how many events came of it."""
        ...

    def drops(self) -> Counter[str]:
        """What was dropped so far."""
        ...

    def repair(self, datagram: bytes) -> bytes:
        """A damaged datagram with lengths and checksums that fit, so that damage gets past them."""
        ...

    def in_pieces(self, stream: bytes, cuts: Sequence[int]) -> bool | None:
        """Whether a stream says the same when cut at ``cuts``; None for a decoder of datagrams."""
        ...


class PoseSubject:
    """A reader of poses."""

    def __init__(self, name: str) -> None:
        """The reader and the datagrams of the source ``name``."""
        self.reader, self._seeds = FLIGHTS[name](50)

    @property
    def seeds(self) -> Sequence[bytes]:
        """See :class:`Subject`."""
        return self._seeds

    def feed(self, datagram: bytes, now_s: float) -> int:
        """See :class:`Subject`."""
        return len(self.reader.read(datagram, now_s))

    def drops(self) -> Counter[str]:
        """See :class:`Subject`."""
        return Counter(self.reader.status.dropped)

    def repair(self, datagram: bytes) -> bytes:
        """See :class:`Subject`."""
        return datagram

    def in_pieces(self, stream: bytes, cuts: Sequence[int]) -> bool | None:
        """See :class:`Subject`."""
        return None


class NatNetSubject(PoseSubject):
    """NatNet, whose messages tell their length."""

    def __init__(self, name: str) -> None:
        """Messages of the handshake among the frames: damaged ones are believed, and good ones must come again."""
        super().__init__(name)
        self._seeds = [*natnet_handshake((3, 0) if name.endswith("3.0") else (4, 1)) * 5, *self._seeds]

    def repair(self, datagram: bytes) -> bytes:
        """See :class:`Subject`."""
        return datagram[:2] + struct.pack("<H", min(max(len(datagram) - 4, 0), 0xFFFF)) + datagram[4:]


class QualisysSubject(PoseSubject):
    """Contents of data packets; as a stream, the packets themselves."""

    def in_pieces(self, stream: bytes, cuts: Sequence[int]) -> bool | None:
        """See :class:`Subject`."""
        return _framed([stream]) == _framed(pieces_of(stream, cuts))


def _framed(pieces: Sequence[bytes]) -> tuple[list[bytes], bool]:
    from groundstation.pose.sources import Framer

    framer = Framer()
    return [packet for piece in pieces for packet in framer.feed(piece)], framer.broken


class MavlinkSubject(PoseSubject):
    """Poses that come in MAVLink frames."""

    def repair(self, datagram: bytes) -> bytes:
        """See :class:`Subject`."""
        return repaired_mavlink(datagram)


class CsvSubject:
    """Rows of recorded poses."""

    def __init__(self) -> None:
        """Rows as a run's folder has them."""
        from groundstation.pose import CsvRow, encode_csv

        self._seeds = [
            encode_csv(CsvRow(0.01 * n, 0.01 * n + 0.02, (0.1 * n, 1.0, -1.0), (1.0, 0.0, 0.0, 0.0))).encode()
            for n in range(50)
        ]
        self._drops: Counter[str] = Counter()

    @property
    def seeds(self) -> Sequence[bytes]:
        """See :class:`Subject`."""
        return self._seeds

    def feed(self, datagram: bytes, now_s: float) -> int:
        """See :class:`Subject`."""
        from groundstation.pose import read_csv

        return sum(1 for _ in read_csv(datagram.decode("utf-8", "replace").splitlines(), self._drops))

    def drops(self) -> Counter[str]:
        """See :class:`Subject`."""
        return self._drops

    def repair(self, datagram: bytes) -> bytes:
        """See :class:`Subject`."""
        return datagram

    def in_pieces(self, stream: bytes, cuts: Sequence[int]) -> bool | None:
        """See :class:`Subject`."""
        return None


class TlogSubject(CsvSubject):
    """Records of a .tlog."""

    def __init__(self) -> None:
        """ODOMETRY behind its time."""
        super().__init__()
        self._seeds = [(n * 10_000).to_bytes(8, "big") + data for n, data in enumerate(FLIGHTS["odometry"](50)[1])]

    def feed(self, datagram: bytes, now_s: float) -> int:
        """See :class:`Subject`."""
        from groundstation.pose import TlogReader

        reader = TlogReader(datagram)
        count = sum(1 for _ in reader)
        self._drops += reader.dropped
        return count

    def repair(self, datagram: bytes) -> bytes:
        """See :class:`Subject`."""
        return datagram[:8] + repaired_mavlink(datagram[8:])


def pieces_of(stream: bytes, cuts: Sequence[int]) -> list[bytes]:
    """``stream``, cut at ``cuts`` (in order)."""
    ends = [0, *cuts, len(stream)]
    return [stream[a:b] for a, b in zip(ends, ends[1:], strict=False)]


def repaired_mavlink(frame: bytes) -> bytes:
    """A damaged MAVLink 2 frame with the length and the checksum of what it holds."""
    from fastcrc.crc16 import mcrf4xx

    from links.mavlink.protocol import DIALECT

    if len(frame) < 12:
        return frame
    number = int.from_bytes(frame[7:10], "little")
    message = DIALECT.kind(number)
    if message is None:
        return frame
    body = bytes([min(len(frame) - 12, 255)]) + b"\0" + frame[3:-2][:263]
    return b"\xfd" + body + mcrf4xx(body + message.crc_byte).to_bytes(2, "little")


SOURCES: dict[str, Callable[[], Subject]] = {
    "vicon": lambda: PoseSubject("vicon"),
    "natnet": lambda: NatNetSubject("natnet"),
    "natnet 3.0": lambda: NatNetSubject("natnet 3.0"),
    "qualisys": lambda: QualisysSubject("qualisys"),
    "odometry": lambda: MavlinkSubject("odometry"),
    "local_position": lambda: MavlinkSubject("local_position"),
    "vision": lambda: MavlinkSubject("vision"),
    "json": lambda: PoseSubject("json"),
    "csv": CsvSubject,
    "tlog": TlogSubject,
}
"""Decoders of pose sources; a new source adds its own here."""
