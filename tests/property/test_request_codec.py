"""Whatever is published on the request topic, nothing but what the key has sealed is ever done."""

from hypothesis import given, strategies as st

from groundstation.core.messages import Ask, Reply, Request
from groundstation.interfaces.mqtt.messages import SealedRequest
from groundstation.interfaces.mqtt.requests import (
    ClientKey,
    Gatekeeper,
    Place,
    decode_request,
    is_sealed,
    seal_request,
)

PLACE, KEY, NOW_MS = Place("lab", "mqx"), bytes(range(32)), 1_700_000_000_000
GOOD = seal_request(KEY, PLACE, "0" * 32, "tablet", 1, "land", NOW_MS + 3000, "too windy")


def done_with(data: bytes) -> list[Request]:
    """What a gatekeeper has done on ``data``."""
    asked: list[Request] = []

    def do(request: Request) -> Reply:
        asked.append(request)
        return Reply(True, "")

    clients = {"tablet": ClientKey(KEY, frozenset(Ask))}
    gate = Gatekeeper(PLACE, clients, do, lambda: "0" * 32, lambda _: None)
    gate.take(data, retained=False, now_s=0.0, wall_ms=NOW_MS)
    assert gate.counts.total() == 1
    return asked


def test_the_sealed_one_is_done() -> None:
    assert len(done_with(GOOD)) == 1


@given(st.binary(max_size=2000))
def test_bytes_at_random_do_nothing(data: bytes) -> None:
    assert done_with(data) == []


@given(st.integers(0, len(GOOD) - 1), st.integers(1, 255))
def test_a_changed_byte_does_nothing_but_what_was_sealed(where: int, by: int) -> None:
    data = bytearray(GOOD)
    data[where] ^= by
    assert done_with(bytes(data)) in ([], [Request(Ask.LAND, "too windy (tablet by MQTT)")])


@given(st.integers(0, len(GOOD) - 1))
def test_a_cut_request_does_nothing(length: int) -> None:
    assert done_with(GOOD[:length]) == []


NUMBER = st.integers(0, 1 << 53)
ASKS = ["hold", "return", "track", "land", "descend", "abort", "kill"]


@given(st.text(max_size=200), NUMBER, NUMBER, st.sampled_from(ASKS))
def test_what_is_sealed_opens_and_only_for_its_vehicle(
    why: str, number: int, expires_ms: int, ask: str
) -> None:
    data = seal_request(KEY, PLACE, "0" * 32, "tablet", number, ask, expires_ms, why)  # type: ignore[arg-type]  # one of them
    request = decode_request(data)
    assert isinstance(request, SealedRequest)
    assert (request.why, request.ask) == (why, ask)
    assert (request.id, request.expires_ms) == (number, expires_ms)
    assert is_sealed(request, KEY, PLACE)
    assert not is_sealed(request, KEY, Place("lab", "mqx2"))
    assert not is_sealed(request, KEY[::-1], PLACE)
