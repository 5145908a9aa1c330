"""The operator's own dead man in whole flights: let go or lost, it lands; not held, no start."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from groundstation.core.messages import Ask, Request, Verdict
from groundstation.core.mission import InputLost, State
from groundstation.core.mission.operator import DEBOUNCE_S
from groundstation.flight import Flight, HoldWatch, assembly
from links.core import LOOK_S
from sim.autopilots import SimulatedAutopilot
from sim.runs import MissionResult, Stage
from tests.flight.flights import SHORT, mission as fly
from tests.hold_double import Hand
from tests.loops import until

SOON_S = DEBOUNCE_S + 2 * LOOK_S


@pytest.fixture
def hand(monkeypatch: pytest.MonkeyPatch) -> Hand:
    """What the operator of every flight of this test holds."""
    hand = Hand()
    monkeypatch.setattr(
        assembly, "make_hold", lambda config, link: HoldWatch("the pedal", 0.75, lambda: hand)
    )
    return hand


def flown(
    hand: Hand, change: Callable[[Hand], None], state: State, after_s: float = 0.3
) -> tuple[MissionResult, float]:
    """A mission with the pedal pressed before arming; ``change`` in ``state``, and when [s]."""
    at_s = 0.0

    async def script(flight: Flight, _: Stage) -> None:
        nonlocal at_s
        await asyncio.sleep(2.0)
        hand.held = True
        await until(lambda: flight.state is state)
        await asyncio.sleep(after_s)
        change(hand)
        at_s = asyncio.get_running_loop().time()

    return fly("paper", *SHORT, script=script), at_s


def let_go(hand: Hand) -> None:
    hand.held = False


def unplug(hand: Hand) -> None:
    hand.trouble = InputLost("No such device")


def break_reader(hand: Hand) -> None:
    hand.trouble = RuntimeError("the reader is broken")


def test_let_go_in_the_air_it_lands_within_50_ms_and_says_why(hand: Hand) -> None:
    mission, at_s = flown(hand, let_go, State.TRACKING)
    landing = next(one for one in mission.states if one.state == "landing")
    assert landing.reason == "the pedal is not held"
    assert landing.time_s - at_s <= SOON_S + 1e-6
    assert (mission.landed, mission.fault) == (True, "")


@pytest.mark.parametrize("change", [unplug, break_reader])
def test_lost_in_the_air_it_lands_at_once_and_that_is_a_fault(
    hand: Hand, change: Callable[[Hand], None]
) -> None:
    mission, at_s = flown(hand, change, State.TRACKING)
    landing = next(one for one in mission.states if one.state == "landing")
    assert landing.reason == mission.fault == f"the pedal is lost: {hand.trouble}"
    assert landing.time_s - at_s <= LOOK_S + 1e-6
    assert mission.states[-1].state == "landed"


@pytest.mark.parametrize(("state", "after_s"), [(State.ARMING, 0.0), (State.TAKEOFF, 0.3)])
def test_let_go_before_it_has_lifted_off_it_never_does(
    hand: Hand, state: State, after_s: float
) -> None:
    mission, _ = flown(hand, let_go, state, after_s)
    assert "hold" not in [one.state for one in mission.states]
    assert "the pedal is not held" in " ".join(one.reason for one in mission.states)
    assert mission.states[-1].state in ("landed", "aborted")


@pytest.mark.parametrize(
    ("stuck", "why"), [(False, "is not held: hold it"), (True, "was held from the beginning")]
)
def test_what_is_not_held_or_stuck_is_not_armed(hand: Hand, stuck: bool, why: str) -> None:
    hand.held = stuck
    seen: dict[str, Any] = {}

    async def script(flight: Flight, _: Stage) -> None:
        await until(lambda: flight.state is State.READY)
        seen["check"] = next(
            one for one in flight.snapshot().checks if one.name == "operator's hold"
        )
        seen["reply"] = flight.ask(Request(Ask.ARM, "the test"))
        seen["state"] = flight.state

    mission = fly("paper", *SHORT, script=script)
    assert seen["check"].verdict is Verdict.WARN
    assert why in seen["check"].says
    assert not seen["reply"].done
    assert why in seen["reply"].says
    assert seen["state"] is State.READY
    assert mission.states[-1].state == "aborted"
    assert f"not armed: operator's hold: the pedal {why}" in mission.why
    assert hand.closed


@pytest.mark.tried(2)  # each autopilot, each loss
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    ("after", "why", "within_s"),
    [
        ([1000, 1000], "channel 2 of the transmitter is not held", 0.1),
        ([1000], "channel 2 of the transmitter is lost: the receiver has no such channel", 0.06),
    ],
)
def test_a_channel_of_the_transmitter_is_held_as_the_autopilot_tells_it(
    autopilot: str, after: list[int], why: str, within_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SimulatedAutopilot, "channels", [1000, 1000])
    at_s = 0.0

    async def script(flight: Flight, stage: Stage) -> None:
        nonlocal at_s
        await asyncio.sleep(2.0)
        stage.autopilot.channels = [1000, 1900]
        await until(lambda: flight.state is State.TRACKING)
        stage.autopilot.channels = after
        at_s = asyncio.get_running_loop().time()

    held = "operator.hold=rc:2"
    mission = fly("paper", *SHORT, held, autopilot=autopilot, script=script)
    landing = next(one for one in mission.states if one.state == "landing")
    assert landing.reason == why
    assert landing.time_s - at_s <= within_s
    assert mission.states[-1].state == "landed"
