"""Commands that arrive late or not at all, while the autopilot speaks and poses come."""

import asyncio

import pytest

from groundstation.core.messages import CommandSent, FlightEvent, Notice
from groundstation.core.mission import State
from groundstation.flight import Flight
from sim.runs import Stage, fly_mission, from_floor
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import fly_fault
from tests.loops import until
from tests.proving.faults.fault import Fault, Scene

LASTS_S, STRUCK_S, KNOWN_S = 4.0, 1.0, 0.6
"""The way is dead for so long, so late into the hold; nothing pushes after the last [s]."""


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_an_autopilot_that_does_not_hear_us_is_told_and_nothing_pushes(autopilot: str) -> None:
    world, config = prepare(SCENARIOS["paper"], ["takeoff.hold_s=20"])
    world, config = from_floor(world, config, 2.0)
    pushed: list[float] = []

    async def script(flight: Flight, stage: Stage) -> None:
        loop, hovers, since_s = asyncio.get_running_loop(), config.weight_n, float("inf")

        def hear(event: FlightEvent) -> None:
            nonlocal hovers
            if isinstance(event, CommandSent):
                thrust = event.tick.command.thrust_n
                if loop.time() < since_s:
                    hovers += 0.01 * (thrust - hovers)
                elif since_s + KNOWN_S < loop.time() < since_s + LASTS_S:
                    pushed.append(thrust / hovers)

        flight._subscribers += (hear,)
        # As the doctor wants it: it holds the last set-point no longer.
        if autopilot == "ardupilot":
            stage.autopilot.parameters._table["GUID_TIMEOUT"] = (0.5, 9)
        await until(lambda: flight.state is State.HOLD)
        await asyncio.sleep(STRUCK_S)
        since_s = loop.time()
        stage.peer.cut(True, speaks=True)
        await asyncio.sleep(LASTS_S)
        stage.peer.cut(False)

    flown = fly_mission(world, config, seed=0, script=script, autopilot=autopilot)
    assert "commands do not reach the autopilot: it sends" in flown.fault
    # What hovers is known to two percent; where it sinks, all of that is told.
    assert max(pushed) < 1.02
    # It sinks at 0.5; PX4 comes down by itself, after the flight's end.
    assert (flown.touchdown_m_s or 0.0) < 0.6


@pytest.mark.parametrize(("later_s", "state", "says"), [
    (0.6, "tracking", "commands reach the autopilot 600 ms too late"),
    (1.5, "tracking", "commands do not reach the autopilot"),  # meanwhile it has landed by itself
    (0.6, "take-off", "commands do not reach the autopilot"),
])  # fmt: skip
def test_commands_that_come_too_late_end_gently(later_s: float, state: str, says: str) -> None:
    told: list[str] = []

    async def delay(scene: Scene) -> None:
        scene.flight._subscribers += (hear,)
        scene.stage.peer.hearing_s += later_s

    def hear(event: FlightEvent) -> None:
        if isinstance(event, Notice):
            told.append(event.text)

    row = fly_fault("late", Fault(delay), state)
    # Late commands swing it: 600 ms on the figure is 1.6 times the limits of the fault table, and
    # it comes down.
    assert row.worst <= 1.65
    assert (row.touchdown_m_s or 0.0) < 1.05
    assert any(says in text for text in told)
    assert not any("another body" in text for text in told)
