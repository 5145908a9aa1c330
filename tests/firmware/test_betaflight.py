"""Betaflight's own firmware, unmodified, on four rotors: ours flies it through the RF link's bytes, in virtual time."""

import asyncio
import math
from collections.abc import Callable
from functools import cache

import pytest

from groundstation.core.mission import State
from groundstation.recording import make_flight
from sim.autopilots import Firmware
from sim.radio import FAILSAFE_S, Failsafe, PulseReceiver
from sim.runs import Stage, confirm_at, fly, fly_mission, from_floor
from sim.runs.flight import Result
from sim.scenarios import BETAFLIGHT, SCENARIOS, by_betaflight, prepare
from sim.time import VirtualTimeLoop
from sim.world import FourRotors
from tests.flight.test_missions import SHORT, WAY

pytestmark = pytest.mark.firmware

FAILSAFE_DELAY_S = 1.5
"""Of the firmware, by its settings."""
BROUGHT_DOWN_S = 2.75
"""Motors are off so long after the last pose at the latest, where a part of ours lives."""

WATCHED_S = 5.0
"""How long the world goes on after a strike [s]."""


@cache
def flown(scenario: str, *overrides: str, link: str = "dsm", seed: int = 0, duration_s: float = 30.0) -> Result:
    world, config = prepare(by_betaflight(SCENARIOS[scenario]), list(overrides), link=link)
    return fly(world, config, seed=seed, duration_s=duration_s, autopilot=BETAFLIGHT)


@pytest.mark.parametrize(
    ("scenario", "told", "link", "limit_cm"),
    [
        ("paper", "trajectory.kind=hold", "dsm", 0.25),
        ("paper", "trajectory.kind=hold", "crsf", 0.25),
        ("paper", "sim.speed_m_s=0.5", "dsm", 0.35),
        ("paper", "sim.speed_m_s=1.0", "dsm", 0.6),
        ("paper", "sim.speed_m_s=1.0", "rf_bridge", 0.6),
        ("adverse", "sim.speed_m_s=0.5", "dsm", 2.0),
    ],
)
def test_ours_flies_it_within_twice_of_what_it_should(scenario: str, told: str, link: str, limit_cm: float) -> None:
    result = flown(scenario, told, link=link)
    assert result.completed, result.why
    assert result.verdict.rms_cm is not None
    assert result.verdict.rms_cm < 2.0 * limit_cm


def test_a_gust_moves_it_by_less_than_16_cm_and_it_is_back_soon() -> None:
    errors: list[tuple[float, float]] = []
    world, config = prepare(
        by_betaflight(SCENARIOS["gust_front"]), ["trajectory.kind=hold", "sim.wind_step_time_s=16"], link="dsm"
    )
    place = config.trajectory.build().position_at(0.0)
    result = fly(
        world, config, seed=0, duration_s=22.0, autopilot=BETAFLIGHT,
        on_step=lambda time_s, at: errors.append((time_s, math.dist(at, place))),
    )  # fmt: skip
    assert result.completed, result.why
    gust_s = errors[-1][0] - 22.0 + 16.0
    after = [(time_s - gust_s, error) for time_s, error in errors if time_s > gust_s]
    assert max(error for _, error in after) < 0.16
    assert max((time_s for time_s, error in after if error > 0.05), default=0.0) < 3.0


def test_the_same_seed_gives_the_same_bytes() -> None:
    world, config = prepare(by_betaflight(SCENARIOS["adverse"]), [], link="crsf")
    first, again = (fly(world, config, seed=3, duration_s=5.0, autopilot=BETAFLIGHT).log_sha256 for _ in range(2))
    assert first == again


def test_weak_rotors_are_compensated() -> None:
    result = flown("paper", "sim.thrust_gain=0.85", "trajectory.kind=hold")
    assert result.completed, result.why
    assert result.verdict.rms_cm is not None
    assert result.verdict.rms_cm < 0.5


def test_a_stick_that_is_told_the_wrong_way_round_ends_the_flight_at_once() -> None:
    result = flown("paper", "link.map.pitch.reverse=false")
    assert not result.completed
    assert result.duration_s < 3.0


@pytest.mark.parametrize(("link", "seed"), [("crsf", 1), ("dsm", 2)])
@pytest.mark.parametrize("scenario", ["paper", "adverse"])
def test_it_goes_from_the_floor_to_the_figure_and_softly_back(scenario: str, link: str, seed: int) -> None:
    world, config = prepare(by_betaflight(SCENARIOS[scenario]), list(SHORT), link=link)
    result = fly_mission(*from_floor(world, config, 1.0), seed=seed, autopilot=BETAFLIGHT)
    assert result.landed, result.why
    assert [one.state for one in result.states] == WAY
    assert result.touchdown_m_s is not None
    assert result.touchdown_m_s < 0.5
    assert result.home_m < 0.1


def strike_down(strike: Callable[[Stage], None], link: str) -> tuple[list[tuple[float, FourRotors]], float | None]:
    """The firmware's motor signals after ``strike`` falls in tracking [s since], and how it met the floor [m/s]."""

    async def watch() -> tuple[list[tuple[float, FourRotors]], float | None]:
        motors: list[tuple[float, FourRotors]] = []
        loop = asyncio.get_running_loop()
        stage = Stage(world, config, 0, autopilot=BETAFLIGHT)
        flight = make_flight(config, confirm=confirm_at(2.0), wires=stage.wires)
        running = [asyncio.ensure_future(stage.run()), asyncio.ensure_future(flight.run())]
        while flight.state is not State.TRACKING:
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.503)
        assert stage.board is not None
        struck_s = loop.time()
        stage.board.on_motors = lambda time_s, signals: motors.append((time_s - struck_s, signals))
        strike(stage)
        await asyncio.sleep(WATCHED_S)
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
        return motors, stage.plant.hardest_m_s

    world, config = prepare(by_betaflight(SCENARIOS["paper"]), list(SHORT), link=link)
    world, config = from_floor(world, config, 30.0)
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(watch())


def last_turn_s(motors: list[tuple[float, FourRotors]]) -> float:
    """When the motors turn for the last time [s]."""
    return max(time_s for time_s, signals in motors if any(signals))


def kill_pacer(stage: Stage) -> None:
    assert stage.port.pacer is not None
    stage.port.pacer.strike()


def freeze_pacer(stage: Stage) -> None:
    assert stage.port.pacer is not None
    stage.port.pacer.strike(stopped=True)


def kill_station(stage: Stage) -> None:
    assert stage.port.pacer is not None
    stage.port.pacer.lose_commander()


def freeze_station(stage: Stage) -> None:
    assert stage.port.pacer is not None
    stage.port.pacer.lose_commander(stopped=True)


def interrupt_bridge(stage: Stage) -> None:
    assert stage.bridge_task is not None
    stage.bridge_task.cancel()


def cut_bridge_off(stage: Stage) -> None:
    assert stage._bridge is not None
    assert stage._bridge._wire is not None
    stage._bridge._wire.abort()


def cut_wire(stage: Stage) -> None:
    stage.port.cut = True


@pytest.mark.parametrize(
    ("strike", "link"),
    [
        (kill_pacer, "crsf"), (freeze_pacer, "dsm"), (kill_station, "crsf"), (freeze_station, "dsm"),
        (interrupt_bridge, "rf_bridge"), (cut_bridge_off, "rf_bridge"),
    ],
)  # fmt: skip
def test_what_is_left_of_ours_brings_it_down_and_stops_its_motors(strike: Callable[[Stage], None], link: str) -> None:
    motors, hit_m_s = strike_down(strike, link)
    assert last_turn_s(motors) < BROUGHT_DOWN_S
    assert hit_m_s is not None
    assert hit_m_s < 2.5


@pytest.mark.parametrize("link", ["dsm", "crsf"])
def test_where_nothing_of_ours_is_heard_any_more_receiver_and_firmware_stop_its_motors(link: str) -> None:
    motors, _ = strike_down(cut_wire, link)
    assert last_turn_s(motors) < FAILSAFE_S + FAILSAFE_DELAY_S + 0.1


@pytest.mark.parametrize(
    ("failsafe", "at_least_s", "at_most_s"), [("hold", WATCHED_S - 0.01, WATCHED_S), ("invalid", 2.7, 2.9)]
)
def test_a_receiver_that_holds_its_last_pulses_keeps_the_motors_turning_for_ever(
    failsafe: Failsafe, at_least_s: float, at_most_s: float
) -> None:
    """The hazard of every override that never goes stale: a receiver's hold, or channels by MSP or UDP.

    Pulses that mean nothing are taken for the last good ones for 0.3 s more than missing frames are.
    """

    def strike(stage: Stage) -> None:
        assert stage.radio is not None
        assert isinstance(stage.radio.receiver, PulseReceiver)
        stage.radio.receiver.failsafe_gives = failsafe
        cut_wire(stage)

    motors, _ = strike_down(strike, "dsm")
    assert at_least_s <= last_turn_s(motors) <= at_most_s


def test_the_firmware_ends_with_whoever_steps_it() -> None:
    firmware = Firmware()
    firmware.step()
    process = firmware._process
    firmware._wire.close()
    assert process.wait(5.0) == 0
    firmware.close()
