"""MQTT messages: what is published below ``PREFIX/VEHICLE/``. Sans-IO."""

from typing import Annotated, Any

import msgspec

from groundstation.config import WHOLE_NAME
from groundstation.core.messages import Numbers, RemoteAsk, Snapshot, Waypoints, ensure_points

OFFLINE = "offline"
"""The ``state`` of a vehicle that no station flies, also as last will."""

Session = Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{32}\Z")]
Seal = Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{64}\Z")]
"""HMAC-SHA256 in hex; see requests.py."""
Client = Annotated[str, msgspec.Meta(pattern=WHOLE_NAME)]
Number = Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]


class EventMessage(msgspec.Struct, frozen=True):
    """One event of a flight."""

    number: Annotated[
        int,
        msgspec.Meta(
            description="Grows by one from event to event of one station; one that comes twice has "
            "the same."
        ),
    ]
    time_s: Annotated[
        float,
        msgspec.Meta(
            description="When, on the station's clock, which `time_s` of a snapshot is on too [s]."
        ),
    ]
    text: Annotated[str, msgspec.Meta(description="What happened, for the operator.")]
    id: Annotated[
        str,
        msgspec.Meta(
            description="Which sentence that is (docs/reference/messages.md); empty where it is "
            "none."
        ),
    ] = ""
    numbers: Annotated[Numbers, msgspec.Meta(description="Its numbers, by their names.")] = {}


class HealthMessage(msgspec.Struct, frozen=True):
    """Health of the station's telemetry itself."""

    groundstation: Annotated[str, msgspec.Meta(description="The program's version.")]
    connections: Annotated[
        int, msgspec.Meta(description="How often it has connected to the broker.")
    ]
    snapshots: Annotated[int, msgspec.Meta(description="How many it has published.")]
    events_lost: Annotated[
        int,
        msgspec.Meta(description="Events that nobody got: more than 100 waited for the broker."),
    ]
    requests: Annotated[
        dict[str, int],
        msgspec.Meta(
            description="Requests by what became of them: `done`, `not_possible`, and those "
            "dropped, by reason."
        ),
    ]


class SessionMessage(msgspec.Struct, frozen=True):
    """Session that a request must name."""

    session: Annotated[
        Session, msgspec.Meta(description="Random; another one after every start of the station.")
    ]


class SealedRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One request."""

    session: Annotated[
        Session, msgspec.Meta(description="The station's, as retained in `request/session`.")
    ]
    client: Annotated[
        Client, msgspec.Meta(description="Who asks: a name in the station's configuration.")
    ]
    id: Annotated[
        Number,
        msgspec.Meta(
            description="Greater than that of any request before it of this client in this session."
        ),
    ]
    ask: Annotated[RemoteAsk, msgspec.Meta(description="What.")]
    expires_ms: Annotated[
        Number,
        msgspec.Meta(
            description="When it must no longer be obeyed, by the wall clock [ms since 1970]: at "
            "most 10 s from now."
        ),
    ]
    points: Annotated[
        Waypoints,
        msgspec.Meta(
            description="Where to, for `goto`, which the station's `mqtt.requests.authority` must "
            "allow."
        ),
    ] = ()
    why: Annotated[str, msgspec.Meta(max_length=200, description="Why, in words.")] = ""
    mac: Annotated[Seal, msgspec.Meta(description="The seal on it.")]

    def __post_init__(self) -> None:
        ensure_points(self.ask, self.points)


class SealedAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """Answer to a request that was sealed, new and in time; any other gets none."""

    session: Annotated[Session, msgspec.Meta(description="Of the request.")]
    client: Annotated[Client, msgspec.Meta(description="Who has asked.")]
    id: Annotated[Number, msgspec.Meta(description="Of the request.")]
    done: Annotated[bool, msgspec.Meta(description="Whether the station does it.")]
    says: Annotated[str, msgspec.Meta(description="What it does now, or why not.")]
    mac: Annotated[Seal, msgspec.Meta(description="The seal on it, by the same key.")]


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


STATE = Topic(
    "state",
    None,
    f"state of the mission; `{OFFLINE}` where nobody flies it, also as last will",
    True,
    1,
)
SNAPSHOT = Topic(
    "snapshot",
    Snapshot,
    "all about the flight, the newest, `mqtt.rate_hz` times a second",
    expires_s=2,
)
EVENT = Topic(
    "event",
    EventMessage,
    "every event once; after an outage, the newest 100 that were not delivered",
    quality=1,
)
HEALTH = Topic(
    "health",
    HealthMessage,
    "about the connection itself and the requests, every `mqtt.health_period_s`",
    retained=True,
)
SESSION = Topic(
    "request/session",
    SessionMessage,
    "what requests must name; absent where none are taken",
    retained=True,
    quality=1,
)
REQUEST = Topic(
    "request", SealedRequest, "asks something of the flight; never retained", quality=1, inward=True
)
ANSWER = Topic("answer", SealedAnswer, "what became of it", quality=1, expires_s=10)
TOPICS = (STATE, SNAPSHOT, EVENT, HEALTH, SESSION, REQUEST, ANSWER)


def properties(topic: Topic, expires_s: int | None = None) -> Any:
    """Return a message's MQTT properties: ``expires_s``, else the topic's expiry, if any."""
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties

    seconds = expires_s or topic.expires_s
    if seconds is None:
        return None
    made = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's
    made.MessageExpiryInterval = seconds
    return made
