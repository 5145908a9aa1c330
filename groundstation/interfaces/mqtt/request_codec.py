"""Seals requests that come by MQTT and their answers, and opens them. Sans-IO.

Whoever is on the network, or runs the broker, can publish: only the seal says who asks. It is the HMAC-SHA256, in hex,
under the client's key, over these lines (UTF-8, joined by one line feed, none at the end)::

    groundstation request 1             groundstation answer 1
    PREFIX                              PREFIX
    VEHICLE                             VEHICLE
    SESSION                             SESSION
    CLIENT                              CLIENT
    ID                                  ID
    ASK                                 true or false
    EXPIRES_MS                          SAYS
    WHY

Only the last line is free text, so that no two messages have the same lines. What is meant for one vehicle says nothing
to another, and what was said to one run of the station says nothing to the next.
"""

import hmac

import msgspec

from groundstation.interfaces.mqtt.messages import AnswerMessage, RequestMessage
from groundstation.settings import RemoteAsk

REQUEST_MAX_BYTES = 1024
"""No request is longer."""


class Place(msgspec.Struct, frozen=True):
    """Whose request topic it is."""

    prefix: str
    vehicle: str


def sealed_request(  # every field of it
    key: bytes, place: Place, session: str, client: str, number: int, ask: RemoteAsk, expires_ms: int, why: str = ""
) -> bytes:
    """The JSON of a request."""
    mac = _seal(key, "request", place, session, client, number, ask, expires_ms, why)
    return msgspec.json.encode(
        RequestMessage(
            session=session, client=client, id=number, ask=ask, expires_ms=expires_ms, why=why, mac=mac.hex()
        )
    )


def decode_request(data: bytes) -> RequestMessage | str:
    """The request in ``data``, its seal unchecked; or the reason why there is none: ``oversized``, ``malformed``."""
    if len(data) > REQUEST_MAX_BYTES:
        return "oversized"
    try:
        return msgspec.json.decode(data, type=RequestMessage)
    except (msgspec.MsgspecError, UnicodeError, RecursionError):
        return "malformed"


def is_sealed(request: RequestMessage, key: bytes, place: Place) -> bool:
    """Whether whoever has ``key`` has made ``request`` for that vehicle."""
    r = request
    made = _seal(key, "request", place, r.session, r.client, r.id, r.ask, r.expires_ms, r.why)
    return hmac.compare_digest(made.hex(), r.mac)


def sealed_answer(key: bytes, place: Place, to: RequestMessage, done: bool, says: str) -> bytes:
    """The JSON of the answer to a request."""
    mac = _seal(key, "answer", place, to.session, to.client, to.id, _word(done), says)
    return msgspec.json.encode(
        AnswerMessage(session=to.session, client=to.client, id=to.id, done=done, says=says, mac=mac.hex())
    )


def open_answer(data: bytes, key: bytes, place: Place) -> AnswerMessage | None:
    """The answer in ``data``; None where it is none, or not of whoever has ``key``."""
    try:
        a = msgspec.json.decode(data, type=AnswerMessage)
        made = _seal(key, "answer", place, a.session, a.client, a.id, _word(a.done), a.says)
    except (msgspec.MsgspecError, UnicodeError, RecursionError):
        return None
    return a if hmac.compare_digest(made.hex(), a.mac) else None


def _seal(key: bytes, kind: str, place: Place, *lines: str | int) -> bytes:
    text = "\n".join([f"groundstation {kind} 1", place.prefix, place.vehicle, *map(str, lines)])
    return hmac.digest(key, text.encode("utf-8", "surrogatepass"), "sha256")


def _word(done: bool) -> str:
    return "true" if done else "false"
