"""Requests by MQTT: sealed, new, in time and allowed, or they do nothing but count."""

import hmac
import itertools
from collections.abc import Collection
from typing import Any

import msgspec
import pytest

from groundstation.core.messages import Ask, Request, Sentence, Waypoint
from groundstation.interfaces.api.messages import ANYONE, ClientOrder, Desk as ControlDesk, Party
from groundstation.interfaces.mqtt.messages import SealedRequest
from groundstation.interfaces.mqtt.requests import (
    ANY_MESSAGES,
    CLIENT_REQUESTS,
    LIFE_MAX_MS,
    REQUEST_MAX_BYTES,
    ClientKey,
    Gatekeeper,
    Place,
    is_sealed,
    open_answer,
    seal_request,
)
from tests.sample_flight import Sampled

PLACE = Place("lab", "mqx")
KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
NOW_MS = 1_700_000_000_000
SESSION = "0" * 31 + "1"


KEYS = {"tablet": KEY, "phone": OTHER_KEY}


class Desk:
    """A gatekeeper, the flight behind it, and what it has told."""

    def __init__(self, **may: Collection[Ask]) -> None:
        """Let each client ask for ``may``."""
        self.core = Sampled()
        self.told: list[Sentence] = []
        sessions = (f"{number:032x}" for number in itertools.count(1))
        clients = {name: ClientKey(KEYS[name], frozenset(asks)) for name, asks in may.items()}
        self.gate = Gatekeeper(
            PLACE, clients, self.core.ask, lambda: next(sessions), self.told.append
        )

    def take(
        self, data: bytes, *, retained: bool = False, now_s: float = 0.0, wall_ms: int = NOW_MS
    ) -> bytes | None:
        return self.gate.take(data, retained=retained, now_s=now_s, wall_ms=wall_ms)

    def answer(self, data: bytes, key: bytes = KEY) -> tuple[bool, str] | None:
        """Whether it was done, and what is said of it; None where nothing is answered."""
        answer = self.take(data)
        if answer is None:
            return None
        opened = open_answer(answer, key, PLACE)
        assert opened is not None
        return opened.done, opened.says


@pytest.fixture
def desk() -> Desk:
    return Desk(tablet={Ask.LAND, Ask.HOLD})


def sealed(
    number: int = 1,
    ask: str = "land",
    *,
    key: bytes = KEY,
    place: Place = PLACE,
    session: str = SESSION,
    client: str = "tablet",
    expires_ms: int = NOW_MS + 3000,
    why: str = "",
    points: tuple[Waypoint, ...] = (),
) -> bytes:
    return seal_request(key, place, session, client, number, ask, expires_ms, why, points)  # type: ignore[arg-type]  # also what is none


def changed(data: bytes, **fields: object) -> bytes:
    return msgspec.json.encode({**msgspec.json.decode(data), **fields})


def test_a_sealed_request_is_done_and_its_answer_is_sealed(desk: Desk) -> None:
    answer = desk.take(sealed(7, why="too windy"))
    assert desk.core.asked == [Request(Ask.LAND, "too windy (tablet by MQTT)")]
    assert answer is not None
    opened = open_answer(answer, KEY, PLACE)
    assert opened is not None
    assert (opened.client, opened.id, opened.done) == ("tablet", 7, True)
    assert opened.says == "land: too windy (tablet by MQTT)"
    assert open_answer(answer, OTHER_KEY, PLACE) is None
    assert open_answer(changed(answer, done=False), KEY, PLACE) is None
    assert desk.gate.counts == {"done": 1}
    assert desk.told == []


THERE = (Waypoint(1.0, 0.5, -1.25), Waypoint(0.0, 0.0, -1.0, 90.0))


@pytest.mark.parametrize(
    ("ask", "points", "line"),
    [("land", (), ""), ("goto", THERE, "1.0000 0.5000 -1.2500 -; 0.0000 0.0000 -1.0000 90.0000\n")],
)
def test_the_seal_is_what_the_documents_say_with_points_in_one_line_before_the_words(
    ask: str, points: tuple[Waypoint, ...], line: str
) -> None:
    data = sealed(7, ask, why="wind", points=points)
    request = msgspec.json.decode(data, type=SealedRequest)
    head = f"groundstation request 1\nlab\nmqx\n{SESSION}\ntablet\n7\n{ask}\n{NOW_MS + 3000}\n"
    assert request.mac == hmac.new(KEY, f"{head}{line}wind".encode(), "sha256").hexdigest()
    assert is_sealed(request, KEY, PLACE)


@pytest.mark.parametrize(
    "other",
    [
        [[1.0, 0.5, -1.25]],
        [[1.0, 0.5, -1.3], [0, 0, -1, 90]],
        [[1.0, 0.5, -1.25, 0], [0, 0, -1, 90]],
    ],
)
def test_no_other_points_than_those_are_sealed(other: list[list[float]]) -> None:
    data = changed(sealed(7, "goto", points=THERE), points=other)
    assert not is_sealed(msgspec.json.decode(data, type=SealedRequest), KEY, PLACE)


DROPPED = {
    "points for a landing": (changed(sealed(), points=[[1, 0, -1]]), "malformed"),
    "to go nowhere": (changed(sealed(), ask="goto"), "malformed"),
    "not JSON": (b"land", "malformed"),
    "nothing": (b"", "malformed"),
    "no object": (b"[]", "malformed"),
    "deep": (b"[" * 900, "malformed"),
    "not UTF-8": (b'{"why": "\xff"}', "malformed"),
    "a field too many": (changed(sealed(), more=1), "malformed"),
    "a why too long": (changed(sealed(), why="x" * 201), "malformed"),
    "to arm": (sealed(ask="arm"), "malformed"),
    "too long": (sealed() + b" " * REQUEST_MAX_BYTES, "oversized"),
    "no seal": (changed(sealed(), mac="0" * 64), "unauthenticated"),
    "another key": (sealed(key=OTHER_KEY), "unauthenticated"),
    "another client": (sealed(client="phone"), "unauthenticated"),
    "another vehicle": (sealed(place=Place("lab", "quad2")), "unauthenticated"),
    "another prefix": (sealed(place=Place("lab2", "mqx")), "unauthenticated"),
    "another ask than sealed": (changed(sealed(), ask="hold"), "unauthenticated"),
    "a later expiry than sealed": (changed(sealed(), expires_ms=NOW_MS + 9000), "unauthenticated"),
    "another id than sealed": (changed(sealed(), id=2), "unauthenticated"),
    "another session": (sealed(session="f" * 32), "other_session"),
    "expired": (sealed(expires_ms=NOW_MS), "expired"),
    "good for ever": (sealed(expires_ms=NOW_MS + LIFE_MAX_MS + 1), "expires_too_late"),
}


@pytest.mark.parametrize(("data", "reason"), DROPPED.values(), ids=DROPPED)
def test_anything_else_does_nothing_but_a_counter_and_one_line(
    desk: Desk, data: bytes, reason: str
) -> None:
    assert desk.take(data) is None
    assert desk.core.asked == []
    assert desk.gate.counts == {reason: 1}
    assert len(desk.told) == 1
    assert reason in desk.told[0].text


def test_what_the_broker_has_kept_is_never_obeyed(desk: Desk) -> None:
    assert desk.take(sealed(), retained=True) is None
    assert desk.gate.counts == {"retained": 1}
    assert desk.core.asked == []


@pytest.mark.parametrize("number", [5, 4, 0])
def test_a_request_that_comes_again_or_late_is_dropped(desk: Desk, number: int) -> None:
    assert desk.take(sealed(5)) is not None
    assert desk.take(sealed(number)) is None
    assert len(desk.core.asked) == 1
    assert desk.gate.counts["replayed"] == 1
    assert desk.take(sealed(6)) is not None


def test_what_is_not_sealed_uses_no_number_up(desk: Desk) -> None:
    desk.take(changed(sealed(1000), mac="0" * 64))
    assert desk.take(sealed(1)) is not None


def test_what_expired_stays_so_even_if_the_clock_is_set_back(desk: Desk) -> None:
    old = sealed(expires_ms=NOW_MS)
    desk.take(old)
    desk.take(old, wall_ms=NOW_MS - 1000)
    assert desk.gate.counts == {"expired": 1, "replayed": 1}
    assert desk.core.asked == []


def test_a_request_from_a_clock_ahead_is_not_obeyed_once_its_time_has_come(desk: Desk) -> None:
    """A client with such a clock is heard again once it is right, with smaller numbers."""
    ahead = sealed(10**9, expires_ms=NOW_MS + 3_600_000)
    desk.take(ahead)
    assert desk.take(ahead, wall_ms=NOW_MS + 3_599_000) is None
    assert desk.core.asked == []
    assert desk.gate.counts == {"expires_too_late": 1, "other_session": 1}
    assert desk.take(sealed(1, session=desk.gate.session)) is not None
    assert len(desk.core.asked) == 1


@pytest.mark.parametrize(
    ("ask", "says", "asked", "reason"),
    [
        ("kill", "tablet may not ask for kill", [], "not_allowed"),
        ("goto", "tablet may not ask for goto", [], "not_allowed"),
        ("hold", "hold is not possible while landing", [Ask.HOLD], "not_possible"),
    ],
)
def test_what_a_client_may_not_ask_or_the_flight_refuses_is_answered_so(
    desk: Desk, ask: str, says: str, asked: list[Ask], reason: str
) -> None:
    assert desk.answer(sealed(ask=ask, points=THERE if ask == "goto" else ())) == (False, says)
    assert [request.ask for request in desk.core.asked] == asked
    assert desk.gate.counts == {reason: 1}


def test_a_why_can_forge_no_line_of_a_log(desk: Desk) -> None:
    desk.take(sealed(why="wind\n12.0 killed\x1b[2J"))
    assert desk.core.asked[0].why == "wind·12.0 killed·[2J (tablet by MQTT)"


def test_a_client_that_asks_all_the_time_is_heard_at_a_rate(desk: Desk) -> None:
    for number in range(100):
        desk.take(sealed(number))
    assert len(desk.core.asked) == CLIENT_REQUESTS.burst
    assert desk.gate.counts["too_many"] == 100 - CLIENT_REQUESTS.burst
    assert desk.take(sealed(1000), now_s=1.0) is not None


def test_in_a_flood_only_a_kill_is_heard() -> None:
    desk = Desk(tablet=ANYONE)
    for _ in range(200):
        desk.take(b'{"ask":"land"}')
    assert desk.gate.counts == {
        "malformed": ANY_MESSAGES.burst,
        "flooded": 200 - ANY_MESSAGES.burst,
    }
    unheard = [sealed(1), sealed(2, "kill", key=OTHER_KEY), b'"kill"', sealed(3, why='"kill"')]
    unheard.append(sealed(4, "kill") + b" " * 4000)
    for number, data in enumerate(unheard, start=201):
        assert desk.take(data) is None
        assert desk.gate.counts["flooded"] == number - ANY_MESSAGES.burst
    assert desk.core.asked == []
    assert desk.take(sealed(5, "kill")) is not None
    assert desk.take(sealed(5, "kill")) is None  # played again
    assert [request.ask for request in desk.core.asked] == [Ask.KILL]
    assert desk.take(sealed(6), now_s=1.0) is not None  # it is over
    assert len(desk.told) == 3  # malformed, flooded, replayed


@pytest.fixture
def pair() -> Desk:
    """A desk for a tablet that may only hold, and a phone that may also kill."""
    return Desk(tablet={Ask.HOLD}, phone={Ask.HOLD, Ask.KILL})


def kill(
    pair: Desk, number: int = 1, client: str = "phone", **more: Any
) -> tuple[bool, str] | None:
    """Return the answer to a client's kill."""
    key = KEYS[client]
    return pair.answer(sealed(number, "kill", key=key, client=client, **more), key)


def test_a_kill_waits_for_no_turn(pair: Desk) -> None:
    for number in range(100):
        pair.take(sealed(number, "hold", key=OTHER_KEY, client="phone"))
    assert pair.gate.counts["too_many"] > 0
    assert kill(pair, 1000) == (True, "kill: told by phone by MQTT")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"session": "f" * 32}, "NOT KILLED, other_session"),
        ({"expires_ms": NOW_MS}, "NOT KILLED, expired"),
        ({"expires_ms": NOW_MS + 60_000}, "NOT KILLED, expires_too_late"),
        ({"client": "tablet"}, "tablet may not ask for kill"),
    ],
)
def test_a_kill_that_does_not_count_is_answered_why(
    pair: Desk, more: dict[str, Any], says: str
) -> None:
    answer = kill(pair, **more)
    assert answer is not None
    assert (answer[0], answer[1].startswith(says), pair.core.asked) == (False, True, [])


@pytest.mark.parametrize("ask", list(Ask))
def test_the_desk_takes_from_afar_all_but_to_arm_and_what_a_local_client_has_control_of(
    ask: Ask,
) -> None:
    points = (Waypoint(1.0, 0.0, -1.0),) if ask is Ask.GOTO else ()
    core, request = Sampled(), Request(ask, "by MQTT", points)
    station = ControlDesk("mqx", core)
    assert (station.from_afar(request).says.startswith("nobody arms")) == (ask is Ask.ARM)
    assert core.asked == ([] if ask is Ask.ARM else [request])
    station.take(ClientOrder(id=1, control="take"), Party(7), 0.0)
    core.asked.clear()
    station.from_afar(request)
    assert core.asked == ([request] if ask in ANYONE else [])
