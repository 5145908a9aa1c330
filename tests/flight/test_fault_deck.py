"""A few cells of the fault deck (`groundstation-sim dev faults`), and what its judge finds."""

import asyncio
import math

import pytest
from msgspec.structs import replace

from groundstation.core.messages import IdleRecord
from links.core import Command, Segment
from links.mavlink.protocol import MavlinkCodec
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import fly_cell, fly_fault
from tests.known import known
from tests.proving.faults import (
    Cell,
    Fault,
    Kind,
    Poses,
    Scene,
    fly_all,
    fly_together,
    page,
    pictures,
    text,
)
from tests.proving.faults.faults import MIRROR, cut, dropout, push_along
from tests.proving.faults.judge import (
    KNOWN,
    OPEN_LOOP,
    RATES_TOUCHDOWN_M_S,
    STRICT,
    TOUCHDOWN_M_S,
    Thrust,
    WireJudge,
)

STATION, VEHICLE = ("127.0.0.1", 14540), ("127.0.0.1", 49152)
FAR = ("trajectory.centre_ned=[0,0,0]",)
"""Centre of the figure in every scenario: not near the place of take-off."""
CELLS = [
    ("freeze", "hold", "descent → aborted"),
    ("dropout", "tracking", "descent → aborted"),
    ("dropout", "arming", "aborted"),
    ("clock step", "hold", "flies on"),
    ("mode stolen", "take-off", "handed_over"),
    ("motors: 70 %", "take-off", "landing"),
    ("controller exception", "landing", "aborted"),
    ("SIGTERM", "descent", "flies on"),
    ("frame loss", "tracking", "autopilot lands → landing"),
    ("estimator reset", "tracking", "flies on"),
    ("wireless", "moving", "flies on"),
    ("stamps off: 5 ms", "hold", "flies on"),
    ("ground effect", "start", "flies on"),
]
LIES = [
    ("frozen", "hold", "mavlink"),
    ("frozen", "tracking", "dsm"),
    ("attitude frozen", "tracking", "mavlink"),
    ("position frozen", "take-off", "mavlink"),
    ("body at rest", "spool-up", "mavlink"),
    ("mirrored: x", "tracking", "mavlink"),
    ("swapped", "hold", "mavlink"),
    ("tilt axes: swapped", "hold", "mavlink"),
    ("late: 200 ms, fresh stamps", "tracking", "mavlink"),
    ("late: 200 ms, fresh stamps", "hold", "mavlink"),
    ("unit: mm for m", "hold", "mavlink"),
    ("teleport", "returning", "mavlink"),
]
"""A cell of most required families."""
MISSED = [("swapped", "tracking", "mavlink", 1.5), ("frame loss", "take-off", "mavlink", 3.0)]
"""Cells beyond the limits of the fault table, and the share that they stay within [-]."""
HONEST = [
    ("push: 6 for 1 s", "tracking", "dsm", 0),
    ("push: 6 for 0.4 s", "tracking", "dsm", 7),
    ("push: 6 for 1 s", "tracking", "mavlink", 3),
    ("push: down 6 for 1 s", "hold", "mavlink", 0),
    ("wind step: 5", "hold", "mavlink", 0),
    ("wind step: 5", "landing", "dsm", 0),
    ("cable picked up", "take-off", "mavlink", 0),
    ("tether", "tracking", "mavlink", 0),
]
"""Disturbances that must not end a mission, and the seed of each: in the second, tones would take
from the law what its limited rate gives; in the third, a rate is at its limit for as long as an
honest push needs."""
FORCED = [("suspect", "flies on"), ("failed:pose.position_no_answer", "lands")]
"""Doubts, and how a flight on MAVLink ends that they are forced upon."""


@pytest.mark.tried(4)  # every fourth of the deck's cells
@pytest.mark.parametrize(("case", "state", "reaction"), CELLS)
def test_a_fault_ends_safely(case: str, state: str, reaction: str) -> None:
    row = fly_cell(case, state)
    assert row.safe, row.why
    assert reaction in row.reaction
    assert (row.answer_ms is None) == (reaction == "flies on")
    assert (row.touchdown_m_s or 0.0) < TOUCHDOWN_M_S


@pytest.mark.tried(4)  # families of lies
@pytest.mark.parametrize(("case", "state", "link"), LIES)
def test_poses_that_lie_lead_the_vehicle_nowhere(case: str, state: str, link: str) -> None:
    row = fly_cell(case, state, link=link)
    assert row.safe, row.why
    assert row.kind == Kind.REQUIRED
    assert row.answer_ms is not None
    assert row.worst <= 1.0


@pytest.mark.parametrize(("case", "state", "link", "most"), MISSED)
def test_cells_beyond_the_limits_stay_within_what_was_measured(
    case: str, state: str, link: str, most: float
) -> None:
    row = fly_cell(case, state, link=link)
    assert 1.0 < row.worst <= most, "move it to those that end safely, or find what made it worse"


@pytest.mark.tried(3)  # a push, a step of the wind, a tether
@pytest.mark.parametrize(("case", "state", "link", "seed"), HONEST)
def test_a_vehicle_that_something_moves_flies_on_by_true_poses(
    case: str, state: str, link: str, seed: int
) -> None:
    (row,) = fly_all([Cell(case, state, link, seed=seed)], overrides=(), workers=1)
    assert row.safe, row.why
    assert row.ended == "flies on"
    assert known(row.unguarded_m_s) > 0.0


@pytest.mark.parametrize(("doubt", "ended"), FORCED)
def test_no_doubt_is_worse_than_what_it_doubts(doubt: str, ended: str) -> None:
    cell = Cell("push: 6 for 1 s", "hold", "mavlink", forced=doubt)
    (row,) = fly_all([cell], overrides=(), workers=1)
    assert row.safe, row.why
    assert (row.forced, row.ended) == (doubt, ended)


@pytest.mark.tried(1)  # states
@pytest.mark.parametrize("state", ["take-off", "tracking", "landing", "descent"])
def test_where_only_answers_get_lost_the_descent_is_no_fall(state: str) -> None:
    row = fly_cell("one way silent: answers", state)
    assert row.safe, row.why
    assert known(row.touchdown_m_s) < 0.85


@pytest.mark.tried(1)  # faults
@pytest.mark.parametrize("case", ["latency step", "frame loss"])
def test_late_poses_and_lost_frames_do_not_make_a_landing_in_bad_air_a_fall(case: str) -> None:
    row = fly_cell(case, "landing", seed=3, scenario="adverse", overrides=FAR)
    assert row.safe, row.why
    assert known(row.touchdown_m_s) < 0.95


@pytest.mark.tried(1)  # at take-off as at landing
@pytest.mark.parametrize("state", ["take-off", "landing"])
def test_a_floor_that_few_poses_show_is_felt_before_the_model_falls_through_it(state: str) -> None:
    row = fly_cell("few frames: every 11th", state)
    assert row.safe, row.why
    assert "descent" not in row.reaction


def test_a_bring_down_by_rates_alone_is_too_hard_for_a_vehicle_that_could_land_itself() -> None:
    row = fly_cell("dropout", "tracking", overrides=("link.bring_down=rates",))
    assert not row.safe
    assert "it met the floor at" in row.why
    assert row.ended == OPEN_LOOP


@pytest.mark.tried(1)  # ways of a push
@pytest.mark.parametrize(
    ("where", "peak_m_s2", "lasts_s", "covered_s", "aside_m"),
    [("down", 6.0, 1.0, 0.6, 0.5), ("up", 6.0, 1.0, 0.6, 0.5), ("aside", 10.0, 0.4, 0.3, 2.3)],
)
def test_a_hand_that_covers_the_markers_throws_no_vehicle(
    where: str, peak_m_s2: float, lasts_s: float, covered_s: float, aside_m: float
) -> None:
    async def press(scene: Scene) -> None:
        async with asyncio.TaskGroup() as hand:
            hand.create_task(push_along(where, peak_m_s2, lasts_s)(scene))
            await asyncio.sleep(covered_s)
            await dropout(scene)

    row = fly_fault("covered", Fault(press, link="dsm", poses=Poses.GONE), "hold")
    assert row.highest_m < 0.5
    assert row.sideways_m < aside_m
    assert row.fastest_m_s < STRICT.speed_m_s


def test_a_blind_descent_does_not_count_on_commands_that_a_link_that_stalled_has_lost() -> None:
    async def stall(scene: Scene) -> None:
        await cut(0.25)(scene)
        await asyncio.sleep(0.25)
        await dropout(scene)

    own_estimate = ("sim.own_estimate=false",)
    row = fly_fault("stall", Fault(stall, poses=Poses.GONE, overrides=own_estimate), "tracking")
    assert row.ended == OPEN_LOOP
    assert row.sideways_m < 1.0
    assert row.fastest_m_s < STRICT.speed_m_s


@pytest.mark.tried(1)  # poses that come back
@pytest.mark.parametrize(
    ("poses", "aside_m", "touchdown_m_s"),
    [
        (Poses.TRUE, STRICT.aside_m, TOUCHDOWN_M_S),
        (Poses.FALSE, KNOWN.aside_m, RATES_TOUCHDOWN_M_S),  # two faults
    ],
)
def test_poses_that_come_back_in_a_blind_descent_are_flown_by_as_long_as_they_respond(
    poses: Poses, aside_m: float, touchdown_m_s: float
) -> None:
    async def cover(scene: Scene) -> None:
        await dropout(scene)
        await asyncio.sleep(0.3)
        if poses is Poses.FALSE:
            scene.between.picture = pictures.map_positions(scene.struck, MIRROR["x"])
        assert scene.stage.mocap is not None
        scene.stage.mocap.cover(False)

    row = fly_fault("back", Fault(cover, link="dsm", poses=poses), "tracking")
    assert row.sideways_m < aside_m
    assert row.fastest_m_s < 2.1
    assert known(row.touchdown_m_s) < touchdown_m_s


def test_a_flight_is_flown_to_its_end_however_far_it_goes() -> None:
    async def storm_in_the_dark(scene: Scene) -> None:
        await dropout(scene)
        scene.stage.wind.push = (12.0, 0.0, 0.0)

    fault = Fault(storm_in_the_dark, poses=Poses.GONE)
    row = fly_fault("storm", fault, "hold")
    assert not row.safe
    assert row.sideways_m > 6.0
    assert row.worst > 1.5


def judged(time_s: float, thrust: float, rates: tuple[float, float, float]) -> str:
    """Say why a frame at ``time_s`` is wrong, after one command with its deadline at 1 s."""
    _, config = prepare(SCENARIOS["paper"], [])
    wire = WireJudge(config, Thrust(0.8, lambda time_s, signal: signal, 0.3))
    parts = (Segment(0.5, 0.6, (0.1, 0.0, 0.0)), Segment(0.1, 0.0, (0.0, 0.0, 0.0)))
    wire.record(IdleRecord(0.75, 0.8, Command(0.8, (0.0, 0.0, 0.0), 0, 0.75, 1.0, parts)))
    frame = MavlinkCodec(245, 190).attitude_target(
        time_s, 1, 1, thrust / config.full_thrust_n, rates
    )
    wire.tap(time_s, STATION, VEHICLE, frame)
    return wire.wrong


LEVEL, ROLLED = (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)


@pytest.mark.parametrize(
    ("time_s", "thrust", "rates", "says"),
    [
        (0.9, 0.8, LEVEL, ""),
        (1.0, 0.8, LEVEL, ""),
        (1.2, 0.6, ROLLED, ""),
        (1.55, 0.0, LEVEL, ""),
        (9.0, 0.0, LEVEL, ""),
        (1.01, 0.8, LEVEL, "was not due then"),
        (0.9, 0.81, LEVEL, "was not due then"),
        (0.9, 0.6, ROLLED, "was not due then"),
        (1.7, 0.6, ROLLED, "was not due then"),
        (0.9, math.nan, LEVEL, "not finite"),
        (0.9, 0.8, (0.0, math.inf, 0.0), "not finite"),
    ],
)
def test_the_judge_lets_pass_what_is_due_and_finds_what_is_not(
    time_s: float, thrust: float, rates: tuple[float, float, float], says: str
) -> None:
    wrong = judged(time_s, thrust, rates)
    assert says in wrong if says else not wrong


@pytest.mark.matrix  # of the tool that flies the table of faults
@pytest.mark.parametrize(
    ("cases", "link"),
    [(["dropout", "gust", "controller exception"], "mavlink"), (["freeze", "mirrored: x"], "dsm")],
)
def test_cells_that_are_flown_together_are_those_of_flights_of_their_own(
    cases: list[str], link: str
) -> None:
    together = fly_together([Cell(case, "hold", link) for case in cases])
    assert together == [fly_cell(case, "hold", link=link) for case in cases]


def test_what_poses_alone_can_not_tell_is_judged_after_five_seconds() -> None:
    row = fly_cell("drift: 0.1 m/s", "hold")
    assert (row.safe, row.exemption) == (True, "not observable")
    assert row.sideways_m == pytest.approx(0.5, abs=0.05)


def test_the_table_says_what_is_unsafe() -> None:
    row = fly_cell("dropout", "ready")
    bad = replace(row, safe=False, why="so", worst=1.7)
    assert "1 unsafe" in text([row, bad])
    assert "UNSAFE dropout" in text([bad])
    assert "| lost | 2 | 1 | 1 |" in page([row, bad], "groundstation-sim dev faults")
    assert "dropout, ready (1.70x)" in page([row, bad], "groundstation-sim dev faults")
