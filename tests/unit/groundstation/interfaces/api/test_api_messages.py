"""Any line of a client of the core API becomes an order, or words why it is none."""

import re
from typing import Any

import msgspec
import pytest
from hypothesis import given, strategies as st

from groundstation.core.messages import Ask, Waypoint
from groundstation.interfaces.api import Control, OrderAnswer, decode
from groundstation.interfaces.api.messages import (
    ClientOrder,
    Desk,
    Party,
    Refusal,
    StationHello,
    decode_order,
    encode,
)
from links.text import printable
from tests.sample_flight import Sampled, sample


@given(st.binary(max_size=200) | st.text(max_size=100).map(str.encode))
def test_no_bytes_raise_or_are_taken_for_an_order(data: bytes) -> None:
    assert isinstance(decode_order(data), str)
    with pytest.raises(ValueError, match=r".+"):
        decode(data)


KEYS = st.sampled_from(["id", "ask", "control", "set", "why", "vehicle", "name", "x"])
NUMBERS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False)


@given(st.dictionaries(KEYS, NUMBERS | st.sampled_from(["land", "take", "k"])))
def test_an_order_asks_for_exactly_one_thing(keys: dict[str, object]) -> None:
    order = decode_order(msgspec.json.encode(keys))
    if isinstance(order, ClientOrder):
        assert sum(one is not None for one in (order.ask, order.control, order.gains)) == 1
        assert "x" not in keys


@pytest.mark.parametrize(
    "message",
    [StationHello(1, "mqx", 7, "0.1", "[vehicle]"), Control("tui 7", True), OrderAnswer(7, True,
        "landing"),
     Refusal("no"), sample(3.0)],
    ids=lambda message: type(message).__name__,
)  # fmt: skip
def test_a_message_comes_out_as_it_went_in(message: StationHello) -> None:
    line = encode(message)
    assert line.endswith(b"\n") and line.count(b"\n") == 1
    assert decode(line) == message


def order_of(number: int, ask: Ask, until_s: float | None = None) -> ClientOrder:
    points = (Waypoint(1.0, 0.5, -1.0),) if ask == "goto" else ()
    return ClientOrder(id=number, ask=ask, vehicle="mqx", until_s=until_s, points=points)


def test_the_points_of_an_order_reach_the_flight() -> None:
    core, party = Sampled(), Party(7)
    desk = Desk("mqx", core)
    desk.take(ClientOrder(id=1, control="take"), party, 0.0)
    line = b'{"id": 2, "ask": "goto", "points": [[1, 0.5, -1.2], [0, 0, -1, 90]]}'
    order = decode_order(line)
    assert isinstance(order, ClientOrder)
    assert desk.take(order, party, 0.0).done
    assert core.asked[0].points == (Waypoint(1.0, 0.5, -1.2), Waypoint(0.0, 0.0, -1.0, 90.0))


TOO_MANY = "[" + "[0,0,-1]," * 64 + "[0,0,-1]]"


@pytest.mark.parametrize(
    "points", ["[[1, 2]]", "[[1, 2, 3, 4, 5]]", "[[1, 2, 1e9]]", "[[1, 2, null]]", "[]", TOO_MANY]
)
def test_points_that_are_none_are_no_order(points: str) -> None:
    refused = decode_order(f'{{"id": 2, "ask": "goto", "points": {points}}}'.encode())
    assert isinstance(refused, str) and refused.startswith("not an order: ") and "$" not in refused


@pytest.mark.parametrize(("numbers", "says"), [
    ((1, 2, 1e9), "down_m: expected a number from -100 to 100, got 1000000000.0"),
    ((1, float("nan"), 0), "east_m: expected a number from -100 to 100, got nan"),
    (("1", 2, 0), "north_m: expected a number from -100 to 100, got '1'"),
    ((1, 2, 0, -400), "yaw_deg: expected a number from -360 to 360, got -400"),
])  # fmt: skip
def test_a_point_that_a_program_makes_is_held_to_what_the_wire_takes(
    numbers: tuple[float, ...], says: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(says)):
        Waypoint(*numbers)


MOVES = st.tuples(st.integers(0, 2), st.sampled_from([*Ask, "take", "give", "leave"]))
FREE = ("land", "descend", "abort", "kill")
"""What anybody may ask."""


@given(st.lists(MOVES, max_size=40))
def test_what_lifts_or_moves_the_vehicle_is_asked_by_the_one_holder_alone(
    moves: list[tuple[int, Any]],
) -> None:
    core = Sampled()
    desk, parties, holder = Desk("mqx", core), [Party(number) for number in range(3)], None
    for number, (who, what) in enumerate(moves):
        party, asked = parties[who], len(core.asked)
        if what == "leave":
            desk.leave(party)
            holder = None if holder is party else holder
        elif what in ("take", "give"):
            done = desk.take(ClientOrder(id=number, control=what), party, 0.0).done
            assert done == (holder in (None, party) if what == "take" else holder is party)
            if done:
                holder = party if what == "take" else None
        else:
            desk.take(order_of(number, what), party, 0.0)
            assert (len(core.asked) == asked + 1) == (what in FREE or holder is party)
        assert [desk.control(one).yours for one in parties] == [one is holder for one in parties]


def test_words_of_a_client_stay_on_one_line_and_move_no_cursor() -> None:
    core = Sampled()
    party = Party(7)
    order = ClientOrder(id=1, ask=Ask.LAND, why="fire\n12.3 landed\x1b[2J", name="t\x1bui\n")
    Desk("mqx", core).take(order, party, 0.0)
    assert core.asked[0].why == "fire·12.3 landed·[2J (t·ui· 7)"
    assert printable("ü🚁 z1") == "ü🚁 z1"


@pytest.mark.parametrize("ask", list(Ask))
def test_what_starts_or_steers_is_refused_late_and_what_brings_down_never(ask: Ask) -> None:
    core, party = Sampled(), Party(7)
    desk = Desk("mqx", core)
    desk.take(ClientOrder(id=1, control="take"), party, 0.0)
    late = desk.take(order_of(2, ask, until_s=10.0), party, 12.5)
    down = ask in FREE
    assert (late.done, len(core.asked)) == (down, int(down))
    assert down or "2.5 s too late" in late.says
    desk.take(order_of(3, ask, until_s=10.0), party, 9.9)
    assert len(core.asked) == 1 + int(down)
