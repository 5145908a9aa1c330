"""MQTT messages: what is published, and where below ``PREFIX/VEHICLE/``. Sans-IO."""

from typing import Annotated, Any

import msgspec

from groundstation.config import CLIENT_LETTERS, name_pattern
from groundstation.core.messages import RemoteAsk, Snapshot, Waypoints, ensure_points

OFFLINE = "offline"
"""The ``state`` of a vehicle that no station flies, also as last will."""

Session = Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{32}\Z")]
Seal = Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{64}\Z")]
"""HMAC-SHA256 in hex; see request_codec.py."""
Client = Annotated[str, msgspec.Meta(pattern=name_pattern(CLIENT_LETTERS))]
Number = Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]


class EventMessage(msgspec.Struct, frozen=True):
    """One event of a flight."""

    number: int
    """Grows by one from event to event of one station; one that comes twice has the same."""
    time_s: float
    """When, on the station's clock, which ``time_s`` of a snapshot is on too [s]."""
    text: str
    """What happened, for the operator."""


class HealthMessage(msgspec.Struct, frozen=True):
    """How the station's telemetry itself is doing."""

    groundstation: str
    """The program's version."""
    connections: int
    """How often it has connected to the broker."""
    snapshots: int
    """How many it has published."""
    events_lost: int
    """Events that nobody got: more than 100 waited for the broker."""
    requests: dict[str, int]
    """Requests by what became of them: ``done``, ``not_possible``, and those dropped, by reason."""


class SessionMessage(msgspec.Struct, frozen=True):
    """What a request must name."""

    session: Session
    """Random; another one after every start of the station."""


class SealedRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One request."""

    session: Session
    """The station's, as retained in ``request/session``."""
    client: Client
    """Who asks: a name in the station's configuration."""
    id: Number
    """Greater than that of any request before it of this client in this session."""
    ask: RemoteAsk
    """What."""
    expires_ms: Number
    """When it must no longer be obeyed, by the wall clock [ms since 1970]: at most 10 s from now."""
    points: Waypoints = ()
    """Where to, for ``goto``, which the station's ``mqtt.requests.authority`` must allow."""
    why: Annotated[str, msgspec.Meta(max_length=200)] = ""
    """Why, in words."""
    mac: Seal
    """The seal on it."""

    def __post_init__(self) -> None:
        """Check what the fields alone can't.

        Raises:
            ValueError: points that belong to nothing, or a ``goto`` without any.
        """
        ensure_points(self.ask, self.points)


class SealedAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a request that was sealed, new and in time; any other is not answered."""

    session: Session
    """Of the request."""
    client: Client
    """Who has asked."""
    id: Number
    """Of the request."""
    done: bool
    """Whether the station does it."""
    says: str
    """What it does now, or why not."""
    mac: Seal
    """The seal on it, by the same key."""


class Topic(msgspec.Struct, frozen=True):
    """One topic."""

    name: str
    """Below ``PREFIX/VEHICLE/``."""
    message: type[msgspec.Struct] | None
    """JSON of this; None: plain text."""
    says: str
    retained: bool = False
    quality: int = 0
    """MQTT's quality of service."""
    expires_s: int | None = None
    """After this the broker drops what it could not deliver [s]."""
    inward: bool = False
    """Read by the station."""


STATE = Topic("state", None, f"state of the mission; `{OFFLINE}` where nobody flies it, also as last will", True, 1)
SNAPSHOT = Topic("snapshot", Snapshot, "all about the flight, the newest, `mqtt.rate_hz` times a second", expires_s=2)
EVENT = Topic(
    "event", EventMessage, "every event once; after an outage, the newest 100 that were not delivered", quality=1
)
HEALTH = Topic(
    "health", HealthMessage, "about the connection itself and the requests, every `mqtt.health_period_s`", retained=True
)
SESSION = Topic(
    "request/session", SessionMessage, "what requests must name; absent where none are taken", retained=True, quality=1
)
REQUEST = Topic("request", SealedRequest, "asks something of the flight; never retained", quality=1, inward=True)
ANSWER = Topic("answer", SealedAnswer, "what became of it", quality=1, expires_s=10)
TOPICS = (STATE, SNAPSHOT, EVENT, HEALTH, SESSION, REQUEST, ANSWER)


def parse_event(number: int, line: str) -> EventMessage:
    """The event in a line of a snapshot, ``12.345 text``."""
    time, _, text = line.partition(" ")
    try:
        return EventMessage(number, float(time), text)
    except ValueError:
        return EventMessage(number, 0.0, line)


def properties(topic: Topic, expires_s: int | None = None) -> Any:
    """What goes along with a message to ``topic``: when it expires, where it does; ``expires_s`` comes first."""
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties

    seconds = expires_s or topic.expires_s
    if seconds is None:
        return None
    made = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's
    made.MessageExpiryInterval = seconds
    return made
