"""What a station and an RF bridge say to each other in datagrams, and the seal on them. Sans-IO.

    byte 0..3     "RFB1"
    byte 4        kind: 1 hello, 2 welcome, 3 up (station to bridge), 4 down (bridge to station)
    byte 5..12    session; the station's nonce in the first two kinds
    byte 13..20   counter of this seal, big endian
    byte 21..     payload, MessagePack
    last 16       HMAC-SHA256 over all of that, cut

Hello and welcome are sealed with the shared key and carry a fresh random nonce each; everything after with a key made
of the shared key and both nonces, so that nothing from another session counts. Within one the counter must rise: what
comes twice, or late, is dropped. Nothing is secret but the key.

An ``Up`` holds all that the station wants, not changes of it: whichever gets lost, the next one makes up for it.
"""

import hmac
import struct
from collections import Counter
from typing import TypeVar

import msgspec

from links.core import Command
from links.rf import Report
from links.rf.codecs import Manner, Service

HELLO, WELCOME, UP, DOWN = 1, 2, 3, 4
NONCE_BYTES = 16
TAG_BYTES = 16
LARGEST_BYTES = 8192
"""Of a datagram; a command with its bring-down takes about 400."""
_MAGIC = b"RFB1"
_HEAD = struct.Struct(">4sB8sQ")
_NAME = slice(5, 13)

T = TypeVar("T")


class Hello(msgspec.Struct, frozen=True, array_like=True):
    """A station asks for a session."""

    nonce: bytes


class Welcome(msgspec.Struct, frozen=True, array_like=True):
    """The bridge offers one; it begins with the first ``Up``."""

    station_nonce: bytes
    bridge_nonce: bytes
    bridge_s: float
    """When it left, on the bridge's clock [s]."""
    manner: Manner
    """How the bridge paces."""
    report: Report


class Up(msgspec.Struct, frozen=True, array_like=True):
    """All that the station wants now. Times are on its clock [s]; thrusts are shares of the full signal."""

    sent_s: float
    heard_s: float
    """When the newest word of the bridge came."""
    bridge_s: float
    """What the bridge's clock showed in that word."""
    arming: int = 0
    """Number of the newest arming."""
    arm_at_s: float = 0.0
    stopped: bool = False
    """Nothing that lifts, until another arming."""
    command: Command | None = None
    serve: tuple[int, Service, float] | None = None
    """The newest service: its number, what, and for how long [s]."""
    end: bool = False
    """The station leaves once the vehicle is down."""


class Down(msgspec.Struct, frozen=True, array_like=True):
    """The bridge's answer. Times are on its clock [s]."""

    bridge_s: float
    heard: int
    """Counter of the newest ``Up``."""
    refused: str
    """Why this station commands nothing; empty where it does."""
    report: Report
    """Of the pacer; its ``arming`` is the station's number, or 0."""


class Seal:
    """One kind of datagram in one session: closes them, or opens the other side's."""

    def __init__(self, key: bytes, kind: int, name: bytes) -> None:
        """``name`` is the session's, 8 bytes."""
        self._hmac = hmac.new(key, digestmod="sha256")
        self._kind = kind
        self.name = name
        self.counter = 0
        """Of the newest datagram."""

    def close(self, message: msgspec.Struct) -> bytes:
        """The next datagram."""
        self.counter += 1
        data = _HEAD.pack(_MAGIC, self._kind, self.name, self.counter) + _ENCODER.encode(message)
        return data + self._tag(data)

    def open(self, data: bytes, decoder: "msgspec.msgpack.Decoder[T]", dropped: "Counter[str]") -> T | None:
        """What a datagram says; None where it is not for us, not sealed, not new or malformed, counted by reason."""
        body, tag = data[:-TAG_BYTES], data[-TAG_BYTES:]
        if kind_of(data) != self._kind or data[_NAME] != self.name:
            dropped["other_session"] += 1
            return None
        if not hmac.compare_digest(tag, self._tag(body)):
            dropped["bad_seal"] += 1
            return None
        counter: int = _HEAD.unpack_from(data)[3]
        if counter <= self.counter:
            dropped["replayed_or_late"] += 1
            return None
        try:
            message = decoder.decode(body[_HEAD.size :])
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):  # the second for text that is no UTF-8
            dropped["malformed"] += 1
            return None
        self.counter = counter
        return message

    def _tag(self, data: bytes) -> bytes:
        seal = self._hmac.copy()
        seal.update(data)
        return seal.digest()[:TAG_BYTES]


def kind_of(data: bytes) -> int | None:
    """Which kind a datagram claims to be; None where it is none of ours."""
    if not _HEAD.size + TAG_BYTES < len(data) <= LARGEST_BYTES or data[:4] != _MAGIC:
        return None
    return data[4]


def name_of(data: bytes) -> bytes:
    """The session that it claims to belong to, 8 bytes."""
    return data[_NAME]


def first_seal(key: bytes, kind: int, station_nonce: bytes) -> Seal:
    """The seal of a hello or a welcome."""
    return Seal(key, kind, station_nonce[:8])


def session_seals(key: bytes, station_nonce: bytes, bridge_nonce: bytes) -> tuple[Seal, Seal]:
    """The seals of a session, up and down."""

    def derived(what: bytes) -> bytes:
        return hmac.digest(key, what + station_nonce + bridge_nonce, "sha256")

    name = derived(b"name")[:8]
    return Seal(derived(b"up"), UP, name), Seal(derived(b"down"), DOWN, name)


_ENCODER = msgspec.msgpack.Encoder(order="deterministic")  # a set has another order in every process
HELLOS = msgspec.msgpack.Decoder(Hello)
WELCOMES = msgspec.msgpack.Decoder(Welcome)
UPS = msgspec.msgpack.Decoder(Up)
DOWNS = msgspec.msgpack.Decoder(Down)
