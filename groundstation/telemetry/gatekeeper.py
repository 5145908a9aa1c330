"""Which requests from afar are let through: sealed, new, in time, allowed, and not too many. Sans-IO."""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import NamedTuple

import msgspec

from groundstation.api.desk import printable
from groundstation.requests import Ask, Reply, Request
from groundstation.telemetry.mqtt_messages import RequestMessage
from groundstation.telemetry.request_codec import Place, decode_request, is_sealed, sealed_answer

LIFE_MAX_MS = 10_000
"""No request is good for longer: what is held back on its way is not obeyed later [ms]."""
CLIENT_HZ, CLIENT_BURST = 2.0, 10.0
"""So many requests of one client are obeyed [1/s], and at once."""
ANY_HZ, ANY_BURST = 50.0, 100.0
"""More messages than this, whoever sends them, and nobody listens for a while [1/s], and at once."""
TELL_S = 60.0
"""A reason for which requests are dropped is told once in this time [s]."""


class ClientKey(msgspec.Struct, frozen=True):
    """One client: what it may ask, and the key that it proves itself with."""

    key: bytes
    may: frozenset[Ask]


class Dropped(NamedTuple):
    """Why a message is no request to be obeyed."""

    reason: str
    text: str


class Bucket:
    """Allows a burst, and a rate ever after."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        """Begin full."""
        self._rate_hz = rate_hz
        self._burst = self._left = burst
        self._at_s: float | None = None

    def take(self, now_s: float) -> bool:
        """Whether one more is allowed at ``now_s``."""
        elapsed_s = 0.0 if self._at_s is None else max(0.0, now_s - self._at_s)
        self._left = min(self._burst, self._left + self._rate_hz * elapsed_s)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Gatekeeper:
    """Takes what comes on the request topic of one vehicle."""

    def __init__(
        self,
        place: Place,
        clients: Mapping[str, ClientKey],
        do: Callable[[Request], Reply],
        new_session: Callable[[], str],
        tell: Callable[[str], None],
    ) -> None:
        """``do`` what is let through; ``tell`` a line about what is not, seldom.

        ``new_session`` gives 32 random hex digits, other ones each time.
        """
        self.counts: Counter[str] = Counter()
        """``done``, ``not_possible``, and the reasons for which requests were dropped."""
        self.session = new_session()
        """What requests must name."""
        self._new_session = new_session
        self._place = place
        self._clients = clients
        self._do = do
        self._tell = tell
        self._told_s: dict[str, float] = {}
        self._newest: dict[str, int] = {}
        self._each = {name: Bucket(CLIENT_HZ, CLIENT_BURST) for name in clients}
        self._any = Bucket(ANY_HZ, ANY_BURST)

    def is_flooded(self, now_s: float) -> bool:
        """Count one more message, whatever it is; True where they are so many that it is better not to listen."""
        if self._any.take(now_s):
            return False
        self._drop(Dropped("flooded", "too many messages, of whomever: not listening for a while"), now_s)
        return True

    def take(self, data: bytes, *, retained: bool, now_s: float, wall_ms: int) -> bytes | None:
        """Do what a message asks for, and return its answer; None where it is dropped, counted by reason.

        Args:
            data: What was published.
            retained: Whether the broker had kept it.
            now_s: The event loop's clock [s].
            wall_ms: The wall clock [ms since 1970].
        """
        found = self._checked(data, retained, now_s, wall_ms)
        if isinstance(found, Dropped):
            self._drop(found, now_s)
            return None
        client = self._clients[found.client]
        if Ask(found.ask) not in client.may:
            self._drop(Dropped("not_allowed", f"of {found.client!r}, to {found.ask}"), now_s)
            return self._answer(client, found, Reply(False, f"{found.client} may not ask for {found.ask}"))
        told = printable(found.why).strip()
        why = f"{told} ({found.client} by MQTT)" if told else f"told by {found.client} by MQTT"
        reply = self._do(Request(Ask(found.ask), why))
        self.counts["done" if reply.done else "not_possible"] += 1
        return self._answer(client, found, reply)

    def _checked(self, data: bytes, retained: bool, now_s: float, wall_ms: int) -> "RequestMessage | Dropped":
        """The request in ``data``, where it is sealed, new and in time."""
        if retained:
            return Dropped("retained", "kept by the broker")
        request = decode_request(data)
        if isinstance(request, str):
            return Dropped(request, f"{len(data)} bytes")
        client = self._clients.get(request.client)
        if client is None or not is_sealed(request, client.key, self._place):
            return Dropped("unauthenticated", f"it says that it is {request.client!r}")
        whose = f"of {request.client!r}, to {request.ask}"
        if request.session != self.session:
            return Dropped("other_session", whose)
        if request.id <= self._newest.get(request.client, -1):
            return Dropped("replayed", f"{whose}: id {request.id} is not greater than those before it")
        self._newest[request.client] = request.id
        left_ms = request.expires_ms - wall_ms
        if left_ms > LIFE_MAX_MS:
            # Kept by somebody, it would come into force one day: so no request of this session shall ever again.
            self.session = self._new_session()
            self._newest.clear()
            return Dropped("expires_too_late", f"{whose}: good for {left_ms} ms, by our clock")
        if left_ms <= 0:
            return Dropped("expired", f"{whose}: {-left_ms} ms ago, by our clock")
        if not self._each[request.client].take(now_s):
            return Dropped("too_many", whose)
        return request

    def _answer(self, client: ClientKey, request: RequestMessage, reply: Reply) -> bytes:
        return sealed_answer(client.key, self._place, request, reply.done, reply.says)

    def _drop(self, what: "Dropped", now_s: float) -> None:
        reason = what.reason
        self.counts[reason] += 1
        if now_s - self._told_s.get(reason, -TELL_S) >= TELL_S:
            self._told_s[reason] = now_s
            self._tell(f"request by MQTT dropped, {reason} ({self.counts[reason]} so far): {what.text}")
