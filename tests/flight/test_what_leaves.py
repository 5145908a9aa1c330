"""Frames after the poses stop: docs/explanation/safety.md, code and bytes say the same."""

import asyncio
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.config import ConfigError
from groundstation.core.control import bring_down, model_descent
from groundstation.core.mission import State, operator
from groundstation.core.safety import GuardsConfig
from groundstation.flight import Flight, hold_to_run, make_flight
from groundstation.flight.command_loop import DRAIN_S
from groundstation.flight.controller import LAST_CHANCE_S
from groundstation.interfaces.api.client import STOP_ANSWER_S
from groundstation.lab.props_off import STOP_S
from groundstation.settings import Config, FlightConfig
from links.core import LOOK_S, NEWS_S, STALL_S, Command
from links.core.deadman import BRING_DOWN_LIMIT_S, DEADLINE_LIMIT_S
from links.mavlink import MavlinkLinkConfig
from links.mavlink.connection import HEARTBEAT_S
from links.mavlink.protocol import procedures
from links.rf import Channels, DsmLinkConfig, StandbyWatch
from links.rf.pacer import AFTERLIFE_S
from links.rf.pacer_standby import PREPARE_S
from sim.radio import MODULE
from sim.runs import Stage, confirm_at, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from sim.world import World
from tests.flight.flights import cover_cameras, read_set_points
from tests.known import known
from tests.loops import in_virtual_time, running, until

Tap = Callable[[float, tuple[str, int], tuple[str, int], bytes], None]
Event = Callable[[Flight, Stage], None]
SAFETY = Path(__file__).parents[2] / "docs" / "explanation" / "safety.md"
LOOKS_S = operator.DEBOUNCE_S + 2.0 * LOOK_S
HEARTBEAT_TIMEOUT_S = MavlinkLinkConfig().heartbeat_timeout_s
TIMES = {
    "pose to deadline, `flight.coast_s`": FlightConfig().coast_s,
    "longest deadline that a link accepts": DEADLINE_LIMIT_S,
    "failsafe descent begins before the deadline by": LAST_CHANCE_S,
    "standing still for less is not noticed": STALL_S,
    "poses skipped after the program stood still": DRAIN_S,
    "bring-down, at most": BRING_DOWN_LIMIT_S,
    "bring-down, zero thrust at its end": bring_down.OFF_S,
    "bring-down, at slightly less than hover thrust before that": bring_down.SETTLE_S,
    "descent on the model, at most": model_descent.LONGEST_S,
    "descent on the model, zero thrust at its end": bring_down.OFF_S,
    "descent on the model, above hover thrust in all": model_descent.LONGEST_BRAKING_S,
    "our heartbeat over MAVLink, one every": HEARTBEAT_S,
    "autopilot's heartbeat missing, `link.heartbeat_timeout_s`": HEARTBEAT_TIMEOUT_S,
    "autopilot's estimate is too old for LAND after": NEWS_S,
    "autopilot is asked for its mode before LAND, every": procedures.AskMode.period_s,
    "autopilot is asked for its mode before LAND, at most": procedures.AskMode.tries
    * procedures.AskMode.period_s,
    "kill repeated every": procedures.Kill.period_s,
    "kill repeated, at most": procedures.Kill.tries * procedures.Kill.period_s,
    "presses of a key that count once, within": operator.ONCE_S,
    "props-off test: motors stop by themselves, within": STOP_S,
    "operator's pedal released, known within": LOOKS_S,
    "operator's pedal lost, known within": LOOK_S,
    "operator's channel over MAVLink, one every": 1.0 / hold_to_run.RATE_HZ,
    "operator's channel over MAVLink counts as lost after": hold_to_run.OLD_S,
    "`stop-all` names flights that did not answer within": STOP_ANSWER_S,
}
"""What the table of times in that page names, and what the code has [s]."""


def test_every_time_in_the_page_s_table_is_the_code_s() -> None:
    (table,) = re.findall(
        r"^\| time \| \|\n\|---\|---:\|\n((?:\|.*\n)+)", SAFETY.read_text("utf-8"), re.M
    )
    rows = re.findall(r"^\| (.+) \| ([\d.]+) (m?s) \|$", table, re.M)
    shown = {what: float(number) / (1e3 if unit == "ms" else 1.0) for what, number, unit in rows}
    assert shown == pytest.approx(TIMES)


def test_commands_may_rest_on_a_pose_for_a_second_at_most_however_they_are_told() -> None:
    with pytest.raises(ConfigError, match="the limit is 1 s"):
        prepare(SCENARIOS["paper"], ["flight.coast_s=0.8", "guards.level_s=0.3"])


def test_a_stand_by_takes_over_from_a_pacer_that_stands_still_within_a_tenth_of_a_second() -> None:
    for period_s in (DsmLinkConfig().period_s, 0.004):
        silent_s = StandbyWatch(period_s).wait_s + LOOK_S + PREPARE_S + period_s
        assert silent_s < 0.105


def test_the_table_of_what_leaves_has_the_numbers_of_the_code() -> None:
    coast, level = 1e3 * FlightConfig().coast_s, 1e3 * GuardsConfig().level_s
    down, after = 1e3 * BRING_DOWN_LIMIT_S, 1e3 * AFTERLIFE_S
    lines = SAFETY.read_text("utf-8").splitlines()
    rows = [line for line in lines if line.startswith("| ") and "T + " in line]
    (poses,) = [row for row in rows if row.startswith("| poses stop")]
    for ms in (coast - 1e3 * LAST_CHANCE_S, coast + level, coast + level + down):
        assert f"until T + {ms:.0f}" in poses
    (killed,) = [row for row in rows if row.startswith("| the process is killed")]
    for ms in (coast, coast + down, coast + down + after):
        assert f"until T + {ms:.0f}" in killed


def struck(world: World, config: Config, tap: Tap, event: Event) -> tuple[Command, float, float]:
    """Let ``event`` strike a hold: newest command, link's period [s], when it struck [s]."""

    async def main() -> tuple[Command, float, float]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        stage = Stage(world, config, 0)
        flight = make_flight(config, confirm=confirm_at(1.0), wires=stage.wires)
        async with running(stage), running(flight):
            await until(lambda: flight.state is State.HOLD)
            await asyncio.sleep(1.003)
            loop.tap, struck_s = tap, loop.time()
            event(flight, stage)
            await asyncio.sleep(4.0)
            tick, period_s = flight._controller.tick, flight._link.period_s
        assert tick is not None
        return tick.command, period_s, struck_s

    return in_virtual_time(main)()


@pytest.mark.parametrize(
    ("overrides", "fresh_ms"),
    [
        ([], 500.0),
        (["guards.level_s=0"], 250.0),
        (["flight.coast_s=0.2", "guards.level_s=0.1"], 300.0),
    ],
)
def test_nothing_lifts_later_than_the_table_says(overrides: list[str], fresh_ms: float) -> None:
    # From 2 m a bring-down is as long as one may be.
    asked = ["takeoff.height_m=2", *overrides]
    world, config = from_floor(*prepare(SCENARIOS["paper"], asked), None)
    left: list[tuple[float, float]] = []

    def tap(time_s: float, source: tuple[str, int], _: object, data: bytes) -> None:
        if source[1] == 14540:
            left.extend((frame.time_s, frame.thrust) for frame in read_set_points([(time_s, data)]))

    # No pose is newer than the moment at which the cameras were covered.
    *_, stamp_s = struck(world, config, tap, cover_cameras)
    lifting = max(time_s for time_s, thrust in left if thrust > 0.0)
    latest = max(time_s for time_s, _ in left)
    period_s, rest_s = 0.0225, world.pose_latency_s + 1.0 / 50.0
    assert lifting <= stamp_s + 1e-3 * fresh_ms + BRING_DOWN_LIMIT_S - 0.15
    assert latest <= stamp_s + 1e-3 * fresh_ms + BRING_DOWN_LIMIT_S
    # It is played to its end.
    assert latest > stamp_s - rest_s - period_s + 1e-3 * fresh_ms + BRING_DOWN_LIMIT_S - 0.15


def _controller_raises(flight: Flight, stage: Stage) -> None:
    def raises(*_: object) -> None:
        raise RuntimeError("a bug")

    flight._pilot.compute_command = raises  # type: ignore[method-assign, assignment]  # as a controller of one's own may


def _pacer_dies(flight: Flight, stage: Stage) -> None:
    known(stage.port.pacer).strike()


def _pacer_stops(flight: Flight, stage: Stage) -> None:
    known(stage.port.pacer).strike(stopped=True)


@pytest.mark.parametrize(
    ("event", "link", "fresh_ms"),
    [
        (cover_cameras, "dsm", 500.0),
        (cover_cameras, "rf_bridge", 500.0),
        (_controller_raises, "mavlink", 250.0),
        (_controller_raises, "dsm", 250.0),
        (_controller_raises, "rf_bridge", 250.0),
        (_pacer_dies, "dsm", 250.0),
        (_pacer_stops, "dsm", 250.0),
        (_pacer_dies, "rf_bridge", 250.0),
    ],
)
def test_what_is_owed_leaves_until_the_instant_that_the_table_has(
    event: Event, link: str, fresh_ms: float
) -> None:
    asked = ["takeoff.height_m=2"]
    world, config = from_floor(*prepare(SCENARIOS["paper"], asked, link=link), None)
    left: list[tuple[float, float]] = []
    module = config.link if isinstance(config.link, DsmLinkConfig) else DsmLinkConfig()
    codec = module.codec()
    decoder = codec.decoder()
    channels = Channels(module.map, count=codec.channels, thrust_max_n=1.0)

    def tap(time_s: float, source: tuple[str, int], target: tuple[str, int], data: bytes) -> None:
        if link == "mavlink" and source[1] == 14540:
            left.extend((frame.time_s, frame.thrust) for frame in read_set_points([(time_s, data)]))
        elif target == MODULE:
            for heard in decoder.feed(data):
                left.append((time_s, channels.read(known(heard.positions)).thrust_n))

    last, period_s, _ = struck(world, config, tap, event)
    assert last.deadline_s - last.pose_time_s == pytest.approx(1e-3 * fresh_ms)
    lifts_s = sum(part.duration_s for part in last.bring_down if part.thrust_n > 0.0)
    owed_s = last.deadline_s + lifts_s
    lifting = max(time_s for time_s, thrust in left if thrust > 0.0)
    assert lifting <= owed_s + 1e-6
    # A pacer holds what came before it died, while commands go on until that is known; and a
    # bridge's clock may be late by what the network takes, never early.
    earlier_s = 0.05 if event is _pacer_dies or link == "rf_bridge" else 1e-6
    if event is _pacer_stops:
        earlier_s = 0.15
    assert lifting > owed_s - period_s - earlier_s
    after = [thrust for time_s, thrust in left if time_s > owed_s + 1e-6]
    assert all(thrust == 0.0 for thrust in after)
    latest = max(time_s for time_s, _ in left)
    if link == "mavlink":
        assert latest <= last.deadline_s + BRING_DOWN_LIMIT_S, "then it is silent"
    elif event is cover_cameras:
        assert after, "disarm frames"
