"""Whole missions from the floor to the figure and back, and requests in every state of them."""

import asyncio
import math
from pathlib import Path
from typing import Any

import pytest

from groundstation.analysis.replay import replay_facts
from groundstation.core.messages import Ask, Reply, Request, tell_lines
from groundstation.core.mission import IN_AIR, State
from groundstation.core.safety import SpoolUp
from groundstation.flight import Flight
from links.mavlink.protocol import MavResult
from sim.autopilots import Px4Autopilot
from sim.runs import MissionResult, Stage, from_floor
from sim.runs.flight import Script
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import SHORT, in_state, mission, nothing
from tests.known import known
from tests.loops import until
from tests.recordings import record_mission

CLIMB = ["connecting", "ready", "arming", "takeoff", "hold"]
WAY = [*CLIMB, "tracking", "returning", "landing", "disarming", "landed"]


def asking(state: State, ask: Ask, after_s: float = 0.3) -> Script:
    """Ask as ``state`` has lasted ``after_s``."""
    return in_state(state, lambda flight, _: flight.ask(Request(ask, "the test")), after_s)


@pytest.mark.tried(1)  # airs
@pytest.mark.parametrize(("scenario", "rms_cm"), [("paper", 0.3), ("adverse", 3.0)])
def test_a_whole_mission_goes_from_the_floor_to_the_figure_and_softly_back(
    scenario: str, rms_cm: float
) -> None:
    flown = mission(scenario, figure_s=18.0)
    assert flown.landed, flown.why
    assert [one.state for one in flown.states] == WAY
    assert all(one.reason for one in flown.states)
    assert known(flown.touchdown_m_s) <= 0.5
    assert flown.figure_s >= 2.9
    assert known(flown.rms_cm) < rms_cm
    assert flown.home_m < 0.1
    assert flown.tilt_max_deg < 30.0


# Scenarios and controllers, of which each flies in contract/test_controllers.py.
@pytest.mark.tried(2)
@pytest.mark.parametrize(
    ("scenario", "controller"),
    [
        *((scenario, "adaptive") for scenario in ("fast", "storm", "quad1kg")),
        *(("paper", controller) for controller in ("geometric", "l1", "pid", "indi")),
    ],
)
def test_every_scenario_and_every_controller_takes_off_and_lands(
    scenario: str, controller: str
) -> None:
    flown = mission(scenario, *SHORT, f"controller.kind={controller}", seed=1)
    assert flown.landed, flown.fault or flown.why
    assert known(flown.touchdown_m_s) <= 0.5


def test_a_controller_that_drifts_is_brought_down_though_its_wind_is_wrong() -> None:
    """Nobody corrects b̂ in the failsafe descent: its last value would lift the vehicle away."""
    flown = mission("paper", *SHORT, "controller.kind=uncompensated")
    assert flown.fault  # it leans from wind that nobody takes back
    assert [one.state for one in flown.states][-3:] == ["descent", "disarming", "landed"]
    assert known(flown.touchdown_m_s) < 1.0
    assert flown.home_m < 30.0  # 20 s of descent with that wind


def test_thrust_effectiveness_is_not_learnt_on_the_floor() -> None:
    learnt: list[float] = []

    async def script(flight: Flight, _: Stage) -> None:
        await until(lambda: flight.state is State.TAKEOFF)
        while flight.snapshot().thrust_n == 0.0:  # no law has flown yet
            learnt.append(flight._pilot.state.estimator._effectiveness.value)
            await asyncio.sleep(0.01)

    assert mission("adverse", *SHORT, script=script).landed
    assert len(learnt) > 100
    assert set(learnt) == {1.0}


def test_a_vehicle_that_lifts_too_little_is_not_flown() -> None:
    flown = mission("paper", "sim.thrust_gain=0.5")
    assert not flown.landed
    asks = "no lift-off: is this the right body, is the mass right? Thrust went to 1.02 N"
    assert asks in flown.fault
    assert "behind a radio that link.map.arm starts the motors" in flown.fault
    assert flown.states[-1].state == "landed"
    assert flown.touchdown_m_s is None


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_failing_checks_of_an_autopilot_are_told_before_it_refuses_to_arm(autopilot: str) -> None:
    told: list[str] = []

    async def script(_: Flight, stage: Stage) -> None:
        stage.autopilot.lacks = "Preflight Fail: Compass Sensor 0 missing"

    flown = mission("paper", autopilot=autopilot, script=script, watch=tell_lines(told.append))
    (warning,) = [line for line in told if "pre-flight" in line and "ready to arm" in line]
    assert "WARN" in warning.upper()
    assert "its own pre-arm checks do not pass" in warning
    assert flown.states[-1].state == "aborted"
    assert "Compass Sensor 0 missing" in flown.why


@pytest.mark.parametrize(
    "script", [None, asking(State.HOLD, Ask.HOLD)], ids=["by itself", "told to hold"]
)
def test_a_vehicle_whose_hover_thrust_is_not_its_own_lands_again(script: Script | None) -> None:
    flown = mission("paper", *SHORT, "sim.thrust_gain=1.5", script=script)
    assert not flown.landed
    assert "vehicle.hover_range allows 70 to 145 %" in flown.fault
    assert [one.state for one in flown.states][-4:] == ["hold", "landing", "disarming", "landed"]
    assert known(flown.touchdown_m_s) < 0.5


def test_landing_in_flight_begins_without_a_step_of_the_speed() -> None:
    steps: list[float] = []

    async def script(flight: Flight, _: Stage) -> None:
        last = None
        while True:
            tick = flight._controller.tick
            if tick is not None and last is not None and tick is not last:
                change = math.dist(last.reference.velocity_ned, tick.reference.velocity_ned)
                steps.append(change / (tick.estimate.time_s - last.estimate.time_s))
            last = tick
            started = flight.started_s or math.inf
            if flight.state is State.TRACKING and asyncio.get_running_loop().time() > started + 1.7:
                flight.ask(Request(Ask.LAND, "the test"))
            await asyncio.sleep(0.005)

    flown = mission("paper", script=script, figure_s=30.0)
    assert flown.landed
    assert [one.state for one in flown.states][-3:] == ["landing", "disarming", "landed"]
    assert max(steps) < 1.3  # m/s²: the figure's own acceleration is 0.75


OFF_FIGURE = (State.TAKEOFF, State.HOLD, State.RETURNING)


@pytest.mark.tried(5)  # states, by either way down
@pytest.mark.parametrize(
    ("ask", "scenario", "state"),
    [
        *((Ask.LAND, "paper", state) for state in OFF_FIGURE),
        *((Ask.DESCEND, "paper", state) for state in (*OFF_FIGURE, State.LANDING)),
        (Ask.DESCEND, "storm", State.TRACKING),
    ],
)
def test_landing_and_the_failsafe_descent_come_down_softly_from_every_state(
    ask: Ask, scenario: str, state: State
) -> None:
    after_s, limit_m_s = (0.3, 0.5) if ask is Ask.LAND else (0.9, 1.0)
    flown = mission(scenario, *SHORT, script=asking(state, ask, after_s))
    assert flown.states[-1].state == "landed", flown.why
    assert flown.touchdown_m_s is None or flown.touchdown_m_s < limit_m_s
    assert flown.tilt_max_deg < 45.0


@pytest.mark.parametrize("link", ["mavlink", "dsm"])
def test_a_descent_asked_for_between_lift_off_and_the_next_command_comes_down(link: str) -> None:
    asked: list[bool] = []

    async def script(flight: Flight, _: Stage) -> None:
        controller = flight._controller
        while not (isinstance(controller.phase, SpoolUp) and controller.phase.lift_off):
            await asyncio.sleep(0.0005)
        asked.append(flight.ask(Request(Ask.DESCEND, "the test")).done)

    flown = mission("paper", *SHORT, script=script, link=link, seed=2)
    assert asked == [True]
    assert flown.landed, flown.why
    assert known(flown.touchdown_m_s) < 1.0


KILLED = [State.CONNECTING, State.READY, State.ARMING, *IN_AIR[:3], State.LANDING, State.DISARMING]
ABORTED = [State.CONNECTING, State.ARMING, State.TAKEOFF, State.TRACKING, State.DISARMING]


@pytest.mark.tried(3)  # unit/groundstation/core/mission/test_mission.py has every state
@pytest.mark.parametrize(
    ("ask", "end", "state"),
    [
        *((Ask.KILL, State.KILLED, s) for s in KILLED),
        *((Ask.ABORT, State.ABORTED, s) for s in ABORTED),
    ],
)
def test_abort_and_kill_end_every_state_with_the_motors_off(
    ask: Ask, end: State, state: State
) -> None:
    after_s = 0.0 if state in (State.CONNECTING, State.DISARMING) else 0.2
    flown, stage = mission_on_stage(*SHORT, script=asking(state, ask, after_s))
    assert flown.states[-1].state == end
    assert not flown.landed
    assert stage.plant._body.thrust < 0.05


def mission_on_stage(
    *overrides: str, script: Script, **options: Any
) -> tuple[MissionResult, Stage]:
    """A mission of ``paper``, and its simulated side as that was left."""
    stages: list[Stage] = []

    async def noted(flight: Flight, stage: Stage) -> None:
        stages.append(stage)
        await script(flight, stage)

    return mission("paper", *overrides, script=noted, **options), stages[0]


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_an_autopilot_that_lands_after_an_abort_can_still_be_killed(autopilot: str) -> None:
    thrusts_n: list[float] = []
    replies: list[Reply] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await asking(State.HOLD, Ask.ABORT)(flight, stage)
        await asyncio.sleep(0.5)
        thrusts_n.append(stage.plant.truth(asyncio.get_running_loop().time()).thrust_n)
        replies.append(flight.ask(Request(Ask.KILL, "the test")))
        await asyncio.sleep(0.4)
        thrusts_n.append(stage.plant.truth(asyncio.get_running_loop().time()).thrust_n)

    flown = mission("paper", *SHORT, "sim.own_estimate=true", script=script, autopilot=autopilot)
    assert replies[0].done
    assert flown.states[-1].state == State.KILLED
    landing, killed = thrusts_n
    assert landing > 0.5
    assert killed < 0.05


def test_motors_that_run_on_the_floor_are_stopped_by_force(monkeypatch: pytest.MonkeyPatch) -> None:
    denied = MavResult.TEMPORARILY_REJECTED, "Disarming denied: not landed"
    monkeypatch.setattr(Px4Autopilot, "_answer_disarming", lambda self, now_s: denied)
    flown, stage = mission_on_stage(*SHORT, script=nothing)
    assert flown.landed
    assert "stopped by force" in flown.why
    assert not stage.autopilot.armed


def test_a_way_down_that_does_not_end_is_ended() -> None:
    async def script(flight: Flight, stage: Stage) -> None:
        await until(lambda: flight.state is State.HOLD)
        flight._controller._course.detect_touchdown = lambda *_, **__: False  # type: ignore[method-assign]
        flight.land("the test")

    flown = mission("paper", *SHORT, script=script)
    states = [one.state for one in flown.states]
    assert states[-3:] == [State.LANDING, State.DESCENT, State.ABORTED]
    assert "the descent takes too long" in flown.states[-1].reason


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_program_stays_until_the_autopilot_has_stopped_the_motors(autopilot: str) -> None:
    abort = asking(State.HOLD, Ask.ABORT)
    _, stage = mission_on_stage(*SHORT, "sim.own_estimate=true", script=abort, autopilot=autopilot)
    assert stage.plant._body.thrust < 0.05


def test_holding_in_flight_waits_until_it_is_told_to_go_on() -> None:
    async def script(flight: Flight, _: Stage) -> None:
        await asking(State.TRACKING, Ask.HOLD, 1.0)(flight, _)
        assert not flight.ask(Request(Ask.ARM, "out of place")).done
        await asyncio.sleep(5.0)
        assert flight.state is State.HOLD
        flight.ask(Request(Ask.TRACK, "on"))
        await asyncio.sleep(1.0)
        flight.ask(Request(Ask.RETURN, "home"))

    flown = mission("paper", *SHORT, script=script, figure_s=30.0)
    assert flown.landed
    names = [one.state for one in flown.states]
    assert names[3:] == [*WAY[3:6], "hold", *WAY[5:]]


def test_a_mission_that_ends_in_a_descent_is_replayed_to_the_last_bit(tmp_path: Path) -> None:
    """One that lands: test_moves.py."""
    world, config = from_floor(*prepare(SCENARIOS["adverse"], list(SHORT)), 5.0)
    script = asking(State.TRACKING, Ask.DESCEND, 1.0)
    _, path = record_mission(tmp_path, world, config, script, "adverse")
    facts = replay_facts(path)
    assert facts["first_difference"] is None
    assert facts["commands"] > 200
    assert facts["idle_commands"] > 100
