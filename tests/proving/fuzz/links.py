"""What the fuzzer tries on links: one subject a decoder, with good datagrams to damage."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from links.core import Command
from links.rf import RF_CODECS
from tests.proving.fuzz.pose_bytes import FLIGHTS
from tests.proving.fuzz.subjects import Subject, pieces_of, repaired_mavlink


class MavlinkLink:
    """The link's own codec, on every message that the simulated autopilot sends."""

    def __init__(self) -> None:
        """As seen from a ground station."""
        from links.mavlink.protocol import MavlinkCodec

        self._codec = MavlinkCodec(245, 190)
        self._seeds = [
            datagram for name in ("odometry", "local_position", "vision") for datagram in FLIGHTS[name](15)[1]
        ]
        self._seeds += [MavlinkCodec(1, 1).heartbeat(), MavlinkCodec(1, 1).command(1, 1, 400, 1.0)]

    @property
    def seeds(self) -> Sequence[bytes]:
        """See :class:`Subject`."""
        return self._seeds

    def feed(self, datagram: bytes, now_s: float) -> int:
        """See :class:`Subject`."""
        return len(self._codec.feed_datagram(datagram))

    def drops(self) -> Counter[str]:
        """See :class:`Subject`."""
        return Counter(self._codec.dropped)

    def repair(self, datagram: bytes) -> bytes:
        """See :class:`Subject`."""
        return repaired_mavlink(datagram)

    def in_pieces(self, stream: bytes, cuts: Sequence[int]) -> bool | None:
        """See :class:`Subject`."""
        return _mavlink_said([stream]) == _mavlink_said(pieces_of(stream, cuts))


def _mavlink_said(pieces: Sequence[bytes]) -> tuple[list[bytes], Counter[str]]:
    from links.mavlink.protocol import MavlinkCodec

    codec = MavlinkCodec(245, 190)
    return [bytes(m.get_msgbuf()) for piece in pieces for m in codec.feed(piece)], codec.dropped


class RfSubject:
    """Frames of a serial RF module, as a simulated module takes them."""

    def __init__(self, kind: str) -> None:
        """Frames with every channel, from end to end, and each service."""
        self._codec = RF_CODECS[kind]().codec()
        self._decoder = self._codec.decoder()
        channels = self._codec.channels
        self._seeds = [self._codec.encode([0.1 * n - 1.0] * channels) for n in range(21)]
        self._seeds += [self._codec.encode([0.0] * channels, service) for service in self._codec.services]

    @property
    def seeds(self) -> Sequence[bytes]:
        """See :class:`Subject`."""
        return self._seeds

    def feed(self, datagram: bytes, now_s: float) -> int:
        """Let it stand alone on the wire."""
        heard = self._decoder.feed(datagram)
        self._decoder.pause()
        return len(heard)

    def drops(self) -> Counter[str]:
        """See :class:`Subject`."""
        return Counter(self._decoder.dropped)

    def repair(self, datagram: bytes) -> bytes:
        """See :class:`Subject`: CRSF's length and checksum; other frames have neither."""
        from fastcrc.crc8 import dvb_s2

        if datagram[:1] not in (b"\xee", b"\xc8") or not 4 <= len(datagram) <= 64:
            return datagram
        body = datagram[2:-1]
        return datagram[:1] + bytes([len(body) + 1]) + body + bytes([dvb_s2(body)])

    def in_pieces(self, stream: bytes, cuts: Sequence[int]) -> bool | None:
        """See :class:`Subject`."""
        return self._said([stream]) == self._said(pieces_of(stream, cuts))

    def _said(self, pieces: Sequence[bytes]) -> tuple[list[str], dict[str, int]]:
        decoder = self._codec.decoder()
        return [repr(heard) for piece in pieces for heard in decoder.feed(piece)], decoder.dropped


class BridgeSubject:
    """What a bridge hears from its station; damaged datagrams are sealed anew, or else none would be looked into."""

    def __init__(self) -> None:
        """Commands, arming, services and the end."""
        from links.bridge import codec as bridge_codec
        from links.rf import Service

        self._codec = bridge_codec
        self._nonces = (bytes(range(bridge_codec.NONCE_BYTES)), bytes(bridge_codec.NONCE_BYTES))
        self._seal = self._up()
        self._theirs = self._up()
        self._drops: Counter[str] = Counter()
        command = Command(0.8, (0.1, -0.2, 0.3), 7, 1.0, 1.1)
        ups = [bridge_codec.Up(0.1 * n, 0.1 * n, 5.0, n, 0.2, False, command) for n in range(5)]
        ups += [bridge_codec.Up(1.0, 1.0, 5.0, stopped=True), bridge_codec.Up(1.0, 1.0, 5.0, end=True)]
        ups += [bridge_codec.Up(1.0, 1.0, 5.0, serve=(1, service, 2.0)) for service in Service]
        self._seeds = [self._seal.close(up) for up in ups]

    def _up(self) -> Any:
        return self._codec.session_seals(b"k" * 32, *self._nonces)[0]

    @property
    def seeds(self) -> Sequence[bytes]:
        """See :class:`Subject`."""
        return self._seeds

    def feed(self, datagram: bytes, now_s: float) -> int:
        """See :class:`Subject`."""
        return self._theirs.open(datagram, self._codec.UPS, self._drops) is not None

    def drops(self) -> Counter[str]:
        """See :class:`Subject`."""
        return self._drops

    def repair(self, datagram: bytes) -> bytes:
        """See :class:`Subject`: the next datagram of the session, with what is damaged for its payload."""
        payload: Any = msgspec.Raw(datagram[21 : -self._codec.TAG_BYTES])
        sealed: bytes = self._seal.close(payload)
        return sealed

    def in_pieces(self, stream: bytes, cuts: Sequence[int]) -> bool | None:
        """See :class:`Subject`."""
        return None


LINKS: dict[str, Callable[[], Subject]] = {
    "mavlink": MavlinkLink,
    "dsm": lambda: RfSubject("dsm"),
    "crsf": lambda: RfSubject("crsf"),
    "rf_bridge": BridgeSubject,
}
"""Decoders of links; a new link adds its own here."""
