"""The mission table: total where it must be, every state reached, and a way out of each."""

from pathlib import Path

import pytest

from groundstation.core.messages import Ask, Request, notice
from groundstation.core.messages.snapshot import decode
from groundstation.core.mission import (
    EVENT_OF,
    FINAL,
    IN_AIR,
    ON_GROUND,
    TABLE,
    Event,
    Mission,
    State,
)
from groundstation.core.mission.mission import IllegalMove
from tests.proving.reference import states_page as markdown

BEGIN, END = "<!-- states:begin -->", "<!-- states:end -->"
PAGE = Path(__file__).parents[5] / "docs" / "explanation" / "safety.md"


def reached(start: State, without: frozenset[Event] = frozenset()) -> set[State]:
    """Every state that can be reached from ``start`` by other events than ``without``."""
    found = {start}
    while (
        more := {t for (s, event), t in TABLE.items() if s in found and event not in without}
        - found
    ):
        found |= more
    return found


def test_every_state_can_be_reached() -> None:
    assert reached(State.IDLE) == set(State)


@pytest.mark.parametrize("state", State)
def test_every_state_can_be_brought_down_and_leads_to_an_end(state: State) -> None:
    assert all((state, event) in TABLE for event in (Event.LAND, Event.DESCEND, Event.ABORT))
    assert TABLE[state, Event.KILL] is State.KILLED
    if state in FINAL:
        assert reached(state) <= {state, State.KILLED}
    else:
        assert reached(state) & FINAL
        assert TABLE[state, Event.ABORT] is State.ABORTED


@pytest.mark.parametrize("state", IN_AIR)
def test_every_state_in_the_air_leads_to_the_floor_and_at_once_into_a_descent_or_to_who_takes_over(
    state: State,
) -> None:
    assert State.LANDED in reached(state, frozenset({Event.ABORT, Event.KILL, Event.TAKEN_OVER}))
    assert TABLE[state, Event.DESCEND] is State.DESCENT
    assert (state, Event.TAKEN_OVER) in TABLE


@pytest.mark.parametrize("event", [Event.LAND, Event.DESCEND])
def test_nothing_that_brings_down_takes_a_vehicle_off_the_ground(event: Event) -> None:
    for state in ON_GROUND:
        assert TABLE[state, event] in FINAL


def test_a_descent_is_never_made_gentler() -> None:
    assert reached(State.DESCENT) & set(IN_AIR) == {State.DESCENT}


def test_nobody_who_took_over_is_ever_contradicted() -> None:
    assert reached(State.HANDED_OVER) == {State.HANDED_OVER, State.KILLED}


def test_an_illegal_move_names_event_and_state() -> None:
    with pytest.raises(IllegalMove, match="armed is not possible while idle"):
        Mission().on(Event.ARMED)


def test_a_move_keeps_its_reason_and_staying_keeps_the_first() -> None:
    mission = Mission()
    mission.on(Event.START, notice("mission.waiting"))
    assert (mission.state, mission.reason) == (State.CONNECTING, notice("mission.waiting"))
    mission.on(Event.ABORT, notice("fault.taken", mode="LOITER"))
    mission.on(Event.ABORT, notice("fault.taken", mode="RTL"))
    assert mission.reason == notice("fault.taken", mode="LOITER")


def test_every_request_is_an_event() -> None:
    assert set(EVENT_OF) == set(Ask)


def test_a_request_is_read_from_json_and_anything_else_is_none() -> None:
    assert decode(b'{"ask": "land", "why": "MQTT"}') == Request(Ask.LAND, "MQTT")
    for bad in (b"", b"land", b'{"ask": "fly"}', b'{"ask": "land", "force": true}', b"[]", b"\xff"):
        assert decode(bad) is None


def test_the_page_shows_the_table_that_flies() -> None:
    """If this fails: groundstation-sim dev reference --write docs/reference."""
    text = PAGE.read_text("utf-8")
    assert text[text.index(BEGIN) + len(BEGIN) : text.index(END)].strip() == markdown()
