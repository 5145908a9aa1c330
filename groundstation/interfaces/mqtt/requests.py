"""Remote requests: seals, and a gatekeeper that lets through what is sealed, new, in time and
allowed. Sans-IO.

Whoever is on the network, or runs the broker, can publish: only the seal says who asks. It is the
HMAC-SHA256, in hex, under the client's key, over these lines (UTF-8, joined by one line feed, none
at the end)::

    groundstation request 1             groundstation answer 1
    PREFIX                              PREFIX
    VEHICLE                             VEHICLE
    SESSION                             SESSION
    CLIENT                              CLIENT
    ID                                  ID
    ASK                                 true or false
    EXPIRES_MS                          SAYS
    WHY

Only the last line is free text, so that no two messages have the same lines. What is meant for one
vehicle says nothing to another, and what was said to one run of the station says nothing to the
next.
"""

import hmac
from collections import Counter
from collections.abc import Callable, Mapping
from typing import NamedTuple

import msgspec

from groundstation.core.messages import Ask, RemoteAsk, Reply, Request, Say, Waypoint, notice
from groundstation.interfaces.api import Allowance, TokenBucket
from groundstation.interfaces.mqtt.messages import SealedAnswer, SealedRequest
from links.text import printable

REQUEST_MAX_BYTES = 4096
"""No request is longer."""


class Place(msgspec.Struct, frozen=True):
    """Vehicle whose request topic it is."""

    prefix: str
    vehicle: str


def seal_request(  # every field of it
    key: bytes,
    place: Place,
    session: str,
    client: str,
    number: int,
    ask: RemoteAsk,
    expires_ms: int,
    why: str = "",
    points: tuple[Waypoint, ...] = (),
) -> bytes:
    """The JSON of a request."""
    mac = _seal(
        key, "request", place, session, client, number, ask, expires_ms, *_point_line(points), why
    )
    request = SealedRequest(
        session=session,
        client=client,
        id=number,
        ask=ask,
        expires_ms=expires_ms,
        points=points,
        why=why,
        mac=mac.hex(),
    )
    return msgspec.json.encode(request)


def _point_line(points: tuple[Waypoint, ...]) -> tuple[str, ...]:
    """Write the sealed line of points, only in a ``goto``: ``1.0000 0.5000 -1.2000 -; …``.

    Each number has four decimals; a dash means no heading. The line stands before the free words.
    """
    told = (
        " ".join(
            "-" if number is None else f"{number:.4f}"
            for number in (*point.place_ned, point.yaw_deg)
        )
        for point in points
    )
    return ("; ".join(told),) if points else ()


def decode_request(data: bytes) -> SealedRequest | str:
    """The request in ``data``, its seal unchecked.

    Or the reason why there is none: ``oversized``, ``malformed``.
    """
    if len(data) > REQUEST_MAX_BYTES:
        return "oversized"
    try:
        return msgspec.json.decode(data, type=SealedRequest)
    except (msgspec.MsgspecError, UnicodeError, RecursionError):
        return "malformed"


def is_sealed(request: SealedRequest, key: bytes, place: Place) -> bool:
    """Whether whoever has ``key`` has made ``request`` for that vehicle."""
    r = request
    made = _seal(
        key,
        "request",
        place,
        r.session,
        r.client,
        r.id,
        r.ask,
        r.expires_ms,
        *_point_line(r.points),
        r.why,
    )
    return hmac.compare_digest(made.hex(), r.mac)


def seal_answer(key: bytes, place: Place, to: SealedRequest, done: bool, says: str) -> bytes:
    """The JSON of the answer to a request."""
    mac = _seal(key, "answer", place, to.session, to.client, to.id, _word(done), says)
    return msgspec.json.encode(
        SealedAnswer(
            session=to.session, client=to.client, id=to.id, done=done, says=says, mac=mac.hex()
        )
    )


def open_answer(data: bytes, key: bytes, place: Place) -> SealedAnswer | None:
    """The answer in ``data``; None where it is none, or not of whoever has ``key``."""
    try:
        a = msgspec.json.decode(data, type=SealedAnswer)
        made = _seal(key, "answer", place, a.session, a.client, a.id, _word(a.done), a.says)
    except (msgspec.MsgspecError, UnicodeError, RecursionError):
        return None
    return a if hmac.compare_digest(made.hex(), a.mac) else None


def _seal(key: bytes, kind: str, place: Place, *lines: str | int) -> bytes:
    text = "\n".join([f"groundstation {kind} 1", place.prefix, place.vehicle, *map(str, lines)])
    return hmac.digest(key, text.encode("utf-8", "surrogatepass"), "sha256")


def _word(done: bool) -> str:
    return "true" if done else "false"


LIFE_MAX_MS = 10_000
"""No request is good for longer: what is held back on its way is not obeyed later [ms]."""
CLIENT_REQUESTS = Allowance(rate_hz=2.0, burst=10.0)
"""Requests that one client may make."""
ANY_MESSAGES = Allowance(rate_hz=50.0, burst=100.0)
"""Messages from all clients; above it all requests except ``kill`` are ignored."""
MOST_MESSAGES = Allowance(rate_hz=1000.0, burst=1000.0)
"""Messages from all clients; above it ``kill`` is ignored too: reading takes a flight's time."""
TELL_S = 60.0
"""A reason for which requests are dropped is told once in this time [s]."""
SESSIONS_KEPT = 64
"""At most this many sessions of one station count; only a client's wrong clock begins more."""


class ClientKey(msgspec.Struct, frozen=True):
    """One client: what it may ask, and the key that it proves itself with."""

    key: bytes
    may: frozenset[Ask]


class Dropped(NamedTuple):
    """Why a message is no request to be obeyed."""

    reason: str
    text: str


FLOODED = Dropped("flooded", "too many messages, of whomever: only a kill is heard")
KILL_WORD = b'"kill"'
"""Bytes that every kill contains; quick to search for in a flood."""


class Gatekeeper:
    """Takes what comes on the request topic of one vehicle."""

    def __init__(
        self,
        place: Place,
        clients: Mapping[str, ClientKey],
        do: Callable[[Request], Reply],
        new_session: Callable[[], str],
        tell: Say,
    ) -> None:
        """``do`` what is let through; ``tell`` a line about what is not, seldom.

        ``new_session`` gives 32 random hex digits, other ones each time.
        """
        self.counts: Counter[str] = Counter()
        """``done``, ``not_possible``, and the reasons for which requests were dropped."""
        self._new_session = new_session
        self._place = place
        self._clients = clients
        self._do = do
        self._tell = tell
        self._told_s: dict[str, float] = {}
        self._sessions: dict[str, dict[str, int]] = {}
        """Each session that counts, oldest first: who may name it, and the newest number of that
        client in it."""
        self._each = {name: TokenBucket(CLIENT_REQUESTS) for name in clients}
        self._any = TokenBucket(ANY_MESSAGES)
        self._most = TokenBucket(MOST_MESSAGES)
        self._begin()

    @property
    def session(self) -> str:
        """The session that new requests shall name."""
        return next(reversed(self._sessions))

    def _begin(self) -> None:
        """Begin a session, which every client may name."""
        self._sessions[self._new_session()] = dict.fromkeys(self._clients, -1)
        if len(self._sessions) > SESSIONS_KEPT:
            del self._sessions[next(iter(self._sessions))]

    def is_overrun(self, now_s: float) -> bool:
        """Count one more message, whatever it is.

        True where they are so many that it is better not to listen.
        """
        if self._most.take(now_s):
            return False
        self._drop(
            Dropped("overrun", "far too many messages, of whomever: not listening for a moment"),
            now_s,
        )
        return True

    def take(self, data: bytes, *, retained: bool, now_s: float, wall_ms: int) -> bytes | None:
        """Do what a message asks for, and return its answer.

        None where it is dropped, counted by reason.

        In a flood only a kill is taken, for which one seal is checked, and all else dropped unread.

        A kill is answered even where it is dropped, so that whoever has asked for it knows that the
        motors still run: but for what was not sealed by a client, what came before and was answered
        then, and one too many of who may not kill.

        Args:
            data: What was published.
            retained: Whether the broker had kept it.
            now_s: The event loop's clock [s].
            wall_ms: The wall clock [ms since 1970].
        """
        flooded = not self._any.take(now_s)
        if flooded and (KILL_WORD not in data or len(data) > REQUEST_MAX_BYTES):
            self._drop(FLOODED, now_s)
            return None
        found = self._open_request(data, retained)
        if flooded and not (isinstance(found, SealedRequest) and Ask(found.ask) is Ask.KILL):
            found = FLOODED
        if isinstance(found, Dropped):
            self._drop(found, now_s)
            return None
        client = self._clients[found.client]
        late = self._find_refusal(found, now_s, wall_ms)
        if late is not None:
            self._drop(late, now_s)
            if Ask(found.ask) is not Ask.KILL or late.reason in ("replayed", "too_many"):
                return None
            return self._answer(
                client,
                found,
                Reply.of(False, notice("order.not_killed", reason=late.reason, why=late.text)),
            )
        if Ask(found.ask) not in client.may:
            self._drop(Dropped("not_allowed", f"of {found.client!r}, to {found.ask}"), now_s)
            return self._answer(
                client,
                found,
                Reply.of(False, notice("order.not_allowed", client=found.client, ask=found.ask)),
            )
        told = printable(found.why).strip()
        why = f"{told} ({found.client} by MQTT)" if told else f"told by {found.client} by MQTT"
        reply = self._do(Request(Ask(found.ask), why, found.points))
        self.counts["done" if reply.done else "not_possible"] += 1
        return self._answer(client, found, reply)

    def _open_request(self, data: bytes, retained: bool) -> "SealedRequest | Dropped":
        """The request in ``data``, where a client has sealed it."""
        if retained:
            return Dropped("retained", "kept by the broker")
        request = decode_request(data)
        if isinstance(request, str):
            return Dropped(request, f"{len(data)} bytes")
        client = self._clients.get(request.client)
        if client is None or not is_sealed(request, client.key, self._place):
            return Dropped("unauthenticated", f"it says that it is {request.client!r}")
        return request

    def _find_refusal(self, request: SealedRequest, now_s: float, wall_ms: int) -> "Dropped | None":
        """Why a sealed request is not obeyed: it is of another session, old, or one too many.

        None where it is.
        """
        client = request.client
        whose = f"of {client!r}, to {request.ask}"
        newest = self._sessions.get(request.session, {}).get(client)
        if newest is None:
            return Dropped(
                "other_session", f"{whose}: sealed for another session than {self.session}"
            )
        if request.id <= newest:
            return Dropped(
                "replayed", f"{whose}: id {request.id} is not greater than those before it"
            )
        self._sessions[request.session][client] = request.id
        # The rate comes first: nobody makes sessions faster. But a kill of whoever may waits for no
        # turn.
        turn = self._each[client].take(now_s)
        if not turn and not (
            Ask(request.ask) is Ask.KILL and Ask.KILL in self._clients[client].may
        ):
            return Dropped("too_many", whose)
        left_ms = request.expires_ms - wall_ms
        if left_ms > LIFE_MAX_MS:
            # Kept by somebody, it would come into force one day: so nothing that this client has
            # sealed so far shall. What others have sealed is in time, and counts.
            if turn:
                for numbers in self._sessions.values():
                    numbers.pop(client, None)
                self._begin()
            return Dropped("expires_too_late", f"{whose}: good for {left_ms} ms, by our clock")
        if left_ms <= 0:
            return Dropped("expired", f"{whose}: {-left_ms} ms ago, by our clock")
        return None

    def _answer(self, client: ClientKey, request: SealedRequest, reply: Reply) -> bytes:
        return seal_answer(client.key, self._place, request, reply.done, reply.says)

    def _drop(self, what: "Dropped", now_s: float) -> None:
        reason = what.reason
        self.counts[reason] += 1
        if now_s - self._told_s.get(reason, -TELL_S) >= TELL_S:
            self._told_s[reason] = now_s
            self._tell(
                notice("mqtt.dropped", reason=reason, count=self.counts[reason], why=what.text)
            )
