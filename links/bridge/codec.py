"""Bridge codec: datagrams between a station and an RF bridge, and the seal on them. Sans-IO.

    byte 0..3     "RFB1"
    byte 4        kind: 1 hello, 2 welcome, 3 up (station to bridge), 4 down (bridge to station)
    byte 5..12    session; the station's nonce in the first two kinds
    byte 13..20   counter of this seal, big endian
    byte 21..     payload, MessagePack
    last 16       HMAC-SHA256 over all of that, cut

Hello and welcome are sealed with the shared key and carry a fresh random nonce each; everything
after with a key made of the shared key and both nonces, so that nothing from another session
counts. Within one the counter must rise: what comes twice, or late, is dropped. Nothing is secret
but the key.

An ``Up`` holds all that the station wants, not changes of it: whichever gets lost, the next one
makes up for it.

Behind the messages come the clocks' bounds and a session as either end keeps it.
"""

import hmac
import math
import struct
from collections import Counter
from collections.abc import Callable
from enum import IntEnum
from typing import Any, TypeVar

import msgspec

from links.core import TICK_S, Command
from links.rf import Manner, PacerReport, Service


class DatagramKind(IntEnum):
    """Kinds of datagrams: greeting, its answer, from the station to the bridge, and back."""

    HELLO = 1
    WELCOME = 2
    UP = 3
    DOWN = 4


NONCE_BYTES = 16
"""Length of a side's random number in the greeting [bytes]."""
TAG_BYTES = 16
"""Length of the seal behind a datagram [bytes]: HMAC-SHA-256, cut."""
_MAGIC = b"RFB1"
_HEAD = struct.Struct(">4sB8sQ")

T = TypeVar("T")
Nonce = Callable[[int], bytes]
"""Makes a random number of so many bytes."""


class BridgeHello(msgspec.Struct, frozen=True, array_like=True):
    """A station asks for a session."""

    nonce: bytes


class Welcome(msgspec.Struct, frozen=True, array_like=True):
    """The bridge offers one; it begins with the first ``Up``."""

    station_nonce: bytes
    bridge_nonce: bytes
    bridge_s: float
    """When it left, on the bridge's clock [s]."""
    manner: Manner
    """Pacing of the bridge."""
    report: PacerReport


class Up(msgspec.Struct, frozen=True, array_like=True):
    """All that the station wants now.

    Times are on its clock [s]; thrusts are shares of the full signal.
    """

    sent_s: float
    heard_s: float
    """When the newest word of the bridge came."""
    bridge_s: float
    """Bridge's clock when it sent the answered datagram [s]."""
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
    report: PacerReport
    """Report of the pacer; its ``arming`` is the station's number, or 0."""


class Seal:
    """One kind of datagram in one session: closes them, or opens the other side's."""

    def __init__(self, key: bytes, kind: int, name: bytes) -> None:
        """``name`` is the session's, 8 bytes."""
        self._hmac = hmac.new(key, digestmod="sha256")
        self._kind = kind
        self.name = name
        self.counter = 0
        """Counter of the newest datagram [-]."""

    def close(self, message: msgspec.Struct) -> bytes:
        """The next datagram."""
        self.counter += 1
        data = _HEAD.pack(_MAGIC, self._kind, self.name, self.counter) + _ENCODER.encode(message)
        return data + self._tag(data)

    def open(
        self, data: bytes, decoder: "msgspec.msgpack.Decoder[T]", dropped: "Counter[str]"
    ) -> T | None:
        """Open a datagram; None where it is foreign, unsealed, old or malformed (counted)."""
        body, tag = data[:-TAG_BYTES], data[-TAG_BYTES:]
        if kind_of(data) != self._kind or name_of(data) != self.name:
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
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
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
    if len(data) <= _HEAD.size + TAG_BYTES or data[:4] != _MAGIC:
        return None
    return data[4]


def name_of(data: bytes) -> bytes:
    """The session that it claims to belong to, 8 bytes."""
    name: bytes = _HEAD.unpack_from(data)[2]
    return name


def first_seal(key: bytes, kind: int, station_nonce: bytes) -> Seal:
    """The seal of a hello or a welcome."""
    return Seal(key, kind, station_nonce[:8])


def session_seals(key: bytes, station_nonce: bytes, bridge_nonce: bytes) -> tuple[Seal, Seal]:
    """The seals of a session, up and down."""

    def derive(what: bytes) -> bytes:
        return hmac.digest(key, what + station_nonce + bridge_nonce, "sha256")

    name = derive(b"name")[:8]
    up = Seal(derive(b"up"), DatagramKind.UP, name)
    return up, Seal(derive(b"down"), DatagramKind.DOWN, name)


# A set has another order in every process.
_ENCODER = msgspec.msgpack.Encoder(order="deterministic")
HELLOS = msgspec.msgpack.Decoder(BridgeHello)
WELCOMES = msgspec.msgpack.Decoder(Welcome)
UPS = msgspec.msgpack.Decoder(Up)
DOWNS = msgspec.msgpack.Decoder(Down)


DRIFT = 2e-4
"""Largest relative drift of two machines' clocks [-]: crystals stay within a tenth of that."""


class ClockBounds:
    """Bounds on what must be added to the other's clock to get ours [s].

    A message that left there at their t and came here at our T says: at most T - t. One that left
    here at our T and had come there by their t says: at least T - t. The tightest of each kind is
    kept, and loosened by the drift as it ages.
    """

    def __init__(self) -> None:
        self.least_s, self.most_s = -math.inf, math.inf
        self._at_s = 0.0

    def narrow(self, least_s: float, most_s: float, now_s: float) -> bool:
        """Take two new bounds; False where they contradict the old ones: a clock has jumped.

        Then only they count.
        """
        if not math.isfinite(least_s + most_s):
            return False
        # Each is true of an instant up to a round trip ago.
        drifted = DRIFT * max(0.0, most_s - least_s)
        least_s, most_s = least_s - drifted, most_s + drifted
        slack = DRIFT * max(0.0, now_s - self._at_s)
        least, most = max(self.least_s - slack, least_s), min(self.most_s + slack, most_s)
        self._at_s = now_s
        if least > most + TICK_S:
            self.least_s, self.most_s = least_s, most_s
            return False
        self.least_s, self.most_s = least, most
        return True

    @property
    def middle_s(self) -> float:
        """Half-way between the bounds."""
        return 0.5 * (self.least_s + self.most_s)


class BridgeEnd:
    """One station's, as the bridge keeps it."""

    def __init__(self, key: bytes, station_nonce: bytes, bridge_nonce: bytes) -> None:
        self.bridge_nonce = bridge_nonce
        self.welcome = first_seal(key, DatagramKind.WELCOME, station_nonce)
        self.up, self.down = session_seals(key, station_nonce, bridge_nonce)
        self.clock = ClockBounds()
        self.peer: Any = None
        self.heard_s = 0.0
        self.wants: Up | None = None
        """All but the command, as heard last."""
        self.arming: int | None = None
        """The pacer's number of its newest arming; None where it has not armed."""
        self.ended = False


class StationEnd:
    """The bridge's, as the station keeps it. Times are on the event loop's clock [s]."""

    def __init__(self, key: bytes, welcome: Welcome, now_s: float) -> None:
        """Begin with the bridge's ``welcome``, which arrived at ``now_s``."""
        self._up, self._down = session_seals(key, welcome.station_nonce, welcome.bridge_nonce)
        self._clock = ClockBounds()
        self._sent_s: dict[int, float] = {}
        self._bridge_s = welcome.bridge_s
        self.heard_s = now_s
        """When the bridge was heard last."""
        self.heard = 0
        """Counter of the newest of our datagrams that it has heard."""

    @property
    def sent(self) -> int:
        """Counter of our newest datagram."""
        return self._up.counter

    @property
    def round_trip_s(self) -> float:
        """Round trip of the fastest answer [s].

        Infinite before the first, when the bridge's times mean nothing yet.
        """
        return self._clock.most_s - self._clock.least_s

    def close(self, wants: Up, command: Command | None, now_s: float) -> bytes:
        """The next datagram, with all that the station wants, that leaves at ``now_s``."""
        data = self._up.close(
            msgspec.structs.replace(
                wants, sent_s=now_s, heard_s=self.heard_s, bridge_s=self._bridge_s, command=command
            )
        )
        self._sent_s[self._up.counter] = now_s
        return data

    def open(self, data: bytes, dropped: "Counter[str]", now_s: float) -> Down | None:
        """Open a datagram of the bridge.

        None where it is not of this session or not sound (counted).
        """
        down = self._down.open(data, DOWNS, dropped)
        if down is None:
            return None
        self.heard_s, self._bridge_s = now_s, down.bridge_s
        self.heard = max(self.heard, down.heard)
        self._sent_s = {at: sent for at, sent in self._sent_s.items() if at >= down.heard}
        sent_s = self._sent_s.get(down.heard)
        if sent_s is not None:
            self._clock.narrow(sent_s - down.bridge_s, now_s - down.bridge_s, now_s)
        return down

    def ours(self, report: PacerReport) -> PacerReport:
        """``report`` by this machine's clock."""
        shift, told = self._clock.middle_s, report.telemetry
        if told.attitude_s is not None:
            told = msgspec.structs.replace(told, attitude_s=told.attitude_s + shift)
        return msgspec.structs.replace(
            report, now_s=report.now_s + shift, frame_s=report.frame_s + shift, telemetry=told
        )
