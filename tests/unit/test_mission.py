"""The mission table: total where it must be, and every state leads out."""

import pytest

from groundstation.mission import FINAL, TABLE, Event, IllegalMove, Mission, State


def test_every_state_can_be_reached() -> None:
    reached = {State.IDLE}
    while more := {target for (state, _), target in TABLE.items() if state in reached} - reached:
        reached |= more
    assert reached == set(State)


@pytest.mark.parametrize("state", [s for s in State if s is not State.LANDED])
def test_a_failure_aborts_from_every_state_but_landed(state: State) -> None:
    assert TABLE[(state, Event.FAILED)] is State.ABORTED


@pytest.mark.parametrize("state", [s for s in State if s not in FINAL and s is not State.IDLE])
def test_a_request_to_land_is_legal_in_every_state_under_way(state: State) -> None:
    assert TABLE[(state, Event.LAND)] in (State.LANDING, State.ABORTED)


def test_nothing_leads_out_of_landed() -> None:
    assert not [key for key in TABLE if key[0] is State.LANDED]


def test_an_illegal_move_names_event_and_state() -> None:
    with pytest.raises(IllegalMove, match="armed is not possible while idle"):
        Mission().on(Event.ARMED)


def test_a_move_keeps_its_reason() -> None:
    mission = Mission()
    mission.on(Event.START, "because")
    assert (mission.state, mission.reason) == (State.CONNECTING, "because")
