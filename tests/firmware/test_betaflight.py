"""Betaflight's own firmware, unmodified, on four rotors: flown through the RF link's bytes."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from groundstation.analysis.identify import identify, read_stretch
from sim.autopilots import (
    STEP_S,
    BetaflightFirmware,
    betaflight,
    configure,
    describe_settings,
    pack_pulses,
)
from sim.autopilots.betaflight import RECEIVER_S
from sim.radio import FAILSAFE_S
from sim.runs import RECORDING, Stage, fly, from_floor, simulate
from sim.runs.flight import Result
from sim.scenarios import BETAFLIGHT, SCENARIOS, prepare, with_betaflight
from sim.world.quadrotor import LIFTING_SHARE
from tests.flight.flights import SHORT
from tests.flight.test_missions import WAY
from tests.known import known
from tests.proving.firmware import (
    STRIKES,
    WATCHED_S,
    cut_wire,
    give_invalid,
    gust,
    hold_for_ever,
    strike_down,
)
from tests.proving.takeoff_start import fly_take_off

pytestmark = pytest.mark.firmware

FAILSAFE_DELAY_S = 1.2
"""Of the firmware, by its settings."""
HOLD_S = 0.3
"""It holds the last good pulses so long (MAX_INVALID_PULSE_TIME_MS, main/rx/rx.c) [s]."""
BROUGHT_DOWN_S = 2.75
"""Motors are off so long after the last pose at the latest."""


@cache
def flown(
    scenario: str, *overrides: str, link: str = "dsm", seed: int = 0, duration_s: float = 30.0
) -> Result:
    world, config = prepare(with_betaflight(SCENARIOS[scenario]), list(overrides), link=link)
    return fly(world, config, seed=seed, duration_s=duration_s, autopilot=BETAFLIGHT)


def test_it_runs_where_the_cache_s_path_has_a_space_and_a_colon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = tmp_path / "a home: mine" / "groundstation"
    cache.parent.mkdir()
    cache.symlink_to(betaflight.cache_folder().parent)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache.parent))
    with BetaflightFirmware() as firmware:
        assert firmware.step(RECEIVER_S).cli_port


@pytest.mark.parametrize(
    ("scenario", "told", "link", "limit_cm"),
    [
        ("paper", "trajectory.kind=hold", "dsm", 0.25),
        ("paper", "trajectory.kind=hold", "crsf", 0.25),
        ("paper", "trajectory.kind=hold sim.thrust_gain=0.85", "dsm", 0.25),
        ("paper", "sim.speed_m_s=0.5", "dsm", 0.35),
        ("paper", "sim.speed_m_s=1.0", "dsm", 0.6),
        ("paper", "sim.speed_m_s=1.0", "rf_bridge", 0.6),
        ("adverse", "sim.speed_m_s=0.5", "dsm", 2.0),
    ],
)
def test_ours_flies_it_within_twice_of_what_it_should(
    scenario: str, told: str, link: str, limit_cm: float
) -> None:
    result = flown(scenario, *told.split(), link=link)
    assert result.completed, result.why
    assert known(result.verdict.rms_cm) < 2.0 * limit_cm


def test_a_gust_moves_it_by_less_than_16_cm_and_it_is_back_soon() -> None:
    peak_cm, back_s = gust(0)
    assert peak_cm < 16.0
    assert back_s < 3.0


def test_the_same_seed_gives_the_same_bytes() -> None:
    world, config = prepare(with_betaflight(SCENARIOS["adverse"]), [], link="crsf")
    first, again = (
        fly(world, config, seed=3, duration_s=5.0, autopilot=BETAFLIGHT).log_sha256
        for _ in range(2)
    )
    assert first == again


def test_a_stick_that_is_told_the_wrong_way_round_ends_the_flight_at_once() -> None:
    result = flown("paper", "link.map.pitch.reverse=false")
    assert not result.completed
    assert result.duration_s < 3.0


@pytest.mark.parametrize(("link", "seed"), [("crsf", 1), ("dsm", 2)])
@pytest.mark.parametrize("scenario", ["paper", "adverse"])
def test_it_goes_from_the_floor_to_the_figure_and_softly_back(
    scenario: str, link: str, seed: int
) -> None:
    world, config = prepare(with_betaflight(SCENARIOS[scenario]), list(SHORT), link=link)
    world, config = from_floor(world, config, 1.0)
    took = fly_take_off(world, config, seed, BETAFLIGHT)
    result, start = took.mission, took.start
    assert result.landed, result.why
    assert min(start.thrust) >= 0.75
    assert max(start.thrust) <= 1.25
    assert max(start.climb) < 0.3
    # Its wind leans it by 7.4°, and by more where it pushed.
    assert start.smooth or scenario == "adverse", start
    assert [one.state for one in result.states] == WAY
    assert known(result.touchdown_m_s) < 0.5
    assert result.home_m < 0.1


@pytest.mark.parametrize(
    ("strike", "link"), [row[1:] for row in STRIKES[:6]], ids=[row[0] for row in STRIKES[:6]]
)
def test_what_is_left_of_ours_brings_it_down_and_stops_its_motors(
    strike: Callable[[Stage], None], link: str
) -> None:
    struck = strike_down(strike, link)
    assert struck.off_s < BROUGHT_DOWN_S
    assert known(struck.hit_m_s) < 2.5


@pytest.mark.parametrize("link", ["dsm", "crsf"])
@pytest.mark.parametrize("strike", [cut_wire, give_invalid])
def test_without_us_receiver_and_firmware_stop_its_motors(
    strike: Callable[[Stage], None], link: str
) -> None:
    off_s = strike_down(strike, link).off_s
    assert off_s < FAILSAFE_S + FAILSAFE_DELAY_S + 0.1
    assert off_s == pytest.approx(FAILSAFE_S + HOLD_S, abs=0.05)


def test_a_receiver_that_holds_its_last_pulses_keeps_the_motors_turning_for_ever() -> None:
    """The hazard of an override that never goes stale: a receiver's hold, MSP or UDP."""
    assert strike_down(hold_for_ever, "dsm").off_s > WATCHED_S - 0.01


def test_where_no_channel_stands_for_disarmed_the_delay_begins_after_the_hold(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(betaflight, "RECIPE", betaflight.RECIPE.replace("rxfail 4 s 1000\n", ""))
    off_s = strike_down(give_invalid, "dsm").off_s
    assert off_s == pytest.approx(FAILSAFE_S + HOLD_S + FAILSAFE_DELAY_S, abs=0.1)
    assert off_s < BROUGHT_DOWN_S


def test_pulses_that_come_back_start_no_motor_until_the_arm_channel_has_been_down() -> None:
    settings = configure(describe_settings(512.0, "AETR1234", (200.0, 200.0, 300.0)))
    with BetaflightFirmware(settings) as firmware:

        def give(for_s: float, throttle_us: int, arm_us: int, stick_us: int = 1500) -> float:
            pulses = pack_pulses([stick_us, stick_us, throttle_us, stick_us, arm_us])
            answers = [
                firmware.step(channels=None if k else pulses) for k in range(round(for_s / STEP_S))
            ]
            return max(answers[-1].motors)

        for _ in range(round(RECEIVER_S / STEP_S)):
            firmware.step()
        assert give(4.0, 988, 988) == 0.0
        assert give(1.0, 988, 2012) > 0.0
        assert give(0.5, 1600, 2012) > LIFTING_SHARE
        assert give(HOLD_S - 0.05, 0, 0, 0) > LIFTING_SHARE
        assert give(0.1, 0, 0, 0) == 0.0
        assert give(2.0, 1600, 2012) == 0.0
        assert give(1.0, 988, 2012) == 0.0
        assert give(0.5, 988, 988) == 0.0
        assert give(1.0, 988, 2012) > 0.0


def test_identify_finds_the_rates_that_the_scenario_tells(tmp_path: Path) -> None:
    """Lag and delay from a command's leaving, the link's lead and DSM's frame included."""
    # Where it begins: a pull-in would clip thrust.
    told = ["trajectory.kind=excitation", "sim.start_ned=[0,0,-1]"]
    simulate("paper", autopilot=BETAFLIGHT, link="dsm", duration=40.0, overrides=told, out=tmp_path)
    found = identify(read_stretch(tmp_path / RECORDING)).parameters["rate_response"]
    vehicle = with_betaflight(SCENARIOS["paper"]).vehicle
    to_receiver_s = 0.005 + 14 * 10 / 125000
    told_s = vehicle.rate_lag_s + vehicle.rate_delay_s + to_receiver_s
    assert found.value == pytest.approx(told_s, rel=0.2)
    assert found.value is not None and found.interval is not None
    assert found.interval[1] - found.interval[0] < 0.4 * found.value


def test_the_firmware_ends_with_whoever_steps_it() -> None:
    firmware = BetaflightFirmware()
    firmware.step()
    process = firmware._process
    firmware._wire.close()
    assert process.wait(5.0) == 0
    firmware.close()
