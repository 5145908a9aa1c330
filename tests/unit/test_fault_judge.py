"""The judge of the fault table: made-up flights break each limit, and keep just below it."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from groundstation.core.geometry import Vec3, so3
from groundstation.core.health import Failure, health
from groundstation.core.messages import Sentence
from sim.scenarios import SCENARIOS, prepare
from sim.world import Body, Quadrotor, Wind
from tests.proving.faults import (
    CASES,
    FAULTS,
    MOMENTS,
    REASONS,
    Exemption,
    Fault,
    Kind,
    Poses,
    Row,
    deal_cells,
    is_within,
)
from tests.proving.faults.faults import FAMILIES, FROM_START, OBEYING, dropout
from tests.proving.faults.judge import Answer, Observations, Thrust, Truth, judge, judge_honest
from tests.proving.faults.monitors import FAILURES

FALSE = Fault(dropout, poses=Poses.FALSE)
TRUE = Fault(dropout)
ANSWER = (0.4, "descent", "it does not obey")
STRUCK_S = 0.1


def test_a_doubt_that_may_be_forced_is_one_that_the_monitor_can_have() -> None:
    source = Path(health.__file__).read_text("utf-8")
    assert set(re.findall(r'_fail_part\("(.*?)"', source)) == set(FAILURES)


def moved(
    place: Callable[[float], Vec3],
    *,
    speed_m_s: float = 0.0,
    lean_rad: float = 0.0,
    course: bool = False,
) -> Truth:
    """The truth of a vehicle that a hand leads along ``place`` for 1 s, struck at 0.1 s.

    ``course``: as it is told.
    """
    world, _ = prepare(SCENARIOS["paper"], [])
    truth = Truth(world.floor_z_m)
    plant = Quadrotor(world, Wind(world, iter(())), truth.step)
    truth.plant = plant
    plant.release(0.0)
    attitude = so3.from_euler_zyx(lean_rad, 0.0, 0.0)
    plant.lead = lambda time_s, thrust: Body(
        place(time_s), (0.0, speed_m_s, 0.0), attitude, thrust, (0.0, 0.0, 0.0)
    )
    for k in range(1, 101):
        if k == 10:
            plant.advance(STRUCK_S)
            truth.strike(STRUCK_S)
        plant.advance(0.01 * k)
        if course:
            truth.refer(0.01 * k, place(0.01 * k), (0.0, 0.0, 0.0), 0.01 * k)
    return truth


def verdict(
    fault: Fault = FALSE,
    truth: Truth | None = None,
    *answers: Answer,
    state: str = "hold",
    **noted: Any,
) -> Row:
    """The row of a made-up flight; of one that stood still where nothing else is told."""
    truth = moved(along()) if truth is None else truth
    return judge("made up", fault, state, Observations(truth, answers, **noted))


def told(*signals: tuple[float, float], held_s: float = 0.3) -> Thrust:
    """Commands (when, as a share of what hovers) after an answer at 1 s."""
    thrust = Thrust(1.0, lambda time_s, signal: signal, held_s)
    thrust.answered_s = thrust.decided_s = 1.0
    thrust.decided_height_m = 0.52  # 2.74 s may commands lift
    for time_s, signal in signals:
        thrust.command(time_s, signal)
    thrust.end(9.0)
    return thrust


def test_a_vehicle_that_stays_where_it_is_is_safe() -> None:
    row = verdict()
    assert row.safe, row.why
    assert (row.struck_s, row.answer_ms, row.exemption) == (STRUCK_S, None, "")


def along(rise_m: float = 0.0, aside_m: float = 0.0) -> Callable[[float], Vec3]:
    """A way up and sideways from a hover, done at an even speed from the strike on."""

    def place(time_s: float) -> Vec3:
        share = max(time_s - STRUCK_S, 0.0) / 0.9
        return (0.0, aside_m * share, -1.0 - rise_m * share)

    return place


FREE = {Exemption.NO_LINK, Exemption.NO_MOTORS}
MOTIONS = {
    "it rose": (moved(along(rise_m=0.99)), moved(along(rise_m=1.02)), set[Exemption]()),
    "sideways": (moved(along(aside_m=2.95)), moved(along(aside_m=3.05)), {Exemption.NO_LINK}),
    "it moved at": (
        moved(along(), speed_m_s=2.95),
        moved(along(), speed_m_s=3.05),
        {*FREE, Exemption.WEAK},
    ),
    "it leant by 63°": (moved(along(), lean_rad=1.0), moved(along(), lean_rad=1.1), FREE),
}


@pytest.mark.parametrize("exemption", Exemption)
@pytest.mark.parametrize("says", MOTIONS)
def test_a_motion_has_its_limit_but_for_whom_it_is_lifted(says: str, exemption: Exemption) -> None:
    within, beyond, exempt = MOTIONS[says]
    assert verdict(TRUE, within).safe
    row = verdict(TRUE, beyond, exemption=exemption)
    assert row.safe is (exemption in exempt)
    assert (says in row.why) is (exemption not in exempt)


def test_where_no_lift_off_is_seen_it_may_rise_less_and_fall_from_there() -> None:
    up = moved(lambda t: (0.0, 0.0, -max(t - STRUCK_S, 0.0)))
    assert "it rose 0.90 m" in verdict(FALSE, up, state="spool-up").why
    assert verdict(FALSE, up, state="hold").safe
    assert verdict(FALSE, touchdown_m_s=2.9, state="spool-up").safe
    assert "it met the floor" in verdict(FALSE, touchdown_m_s=3.1, state="spool-up").why
    lifted = moved(lambda t: (0.0, 0.0, -max(t - STRUCK_S, 0.0)), course=True)
    assert verdict(FALSE, lifted, state="spool-up").safe
    assert "it met the floor" in verdict(FALSE, lifted, touchdown_m_s=1.1, state="spool-up").why


@pytest.mark.parametrize(
    ("link", "poses", "most_m_s"),
    [
        ("mavlink", Poses.GONE, 1.0),
        ("mavlink", Poses.TRUE, 1.0),
        ("dsm", Poses.TRUE, 1.0),
        ("dsm", Poses.GONE, 2.5),
        ("dsm", Poses.FALSE, 2.5),
    ],
)
def test_how_hard_it_may_meet_the_floor_depends_on_who_brings_it_down(
    link: str, poses: Poses, most_m_s: float
) -> None:
    fault = Fault(dropout, link=link, poses=poses)
    assert verdict(fault, None, ANSWER, touchdown_m_s=most_m_s - 0.01).safe
    hard = verdict(fault, None, ANSWER, touchdown_m_s=most_m_s + 0.01)
    assert "it met the floor" in hard.why
    weak = verdict(fault, None, ANSWER, touchdown_m_s=most_m_s + 0.01, exemption=Exemption.WEAK)
    assert weak.safe
    assert "it met the floor" in verdict(fault, touchdown_m_s=1.01).why


def test_after_the_answer_no_command_pushes_with_more_than_a_quarter_above_hovering() -> None:
    assert verdict(thrust=told((1.1, 1.25), (1.2, 0.9), (1.3, 0.0))).safe
    hard = told((0.9, 2.0), (1.1, 1.26), (1.2, 0.0))
    assert "1.26x what hovers" in verdict(thrust=hard).why
    assert verdict(TRUE, thrust=hard).safe  # whoever sees may push as he must
    assert verdict(thrust=told((0.9, 2.0), (1.1, 0.0))).safe  # before the answer


def test_after_the_answer_commands_push_above_hovering_for_half_a_second_in_all() -> None:
    assert told((1.0, 1.1), (1.2, 1.0), (1.5, 1.1), (1.7, 0.9)).over_s == pytest.approx(0.4)
    assert told((1.0, 1.1)).over_s == pytest.approx(0.3)  # it is held for no longer
    long = told((1.0, 1.1), (1.3, 1.1), (1.6, 0.9))
    row = verdict(thrust=long)
    assert row.over_hover_s == pytest.approx(0.6)
    assert "more than what hovers for 0.60 s" in row.why


def test_nothing_lifts_any_more_after_the_bring_down_or_once_land_is_acknowledged() -> None:
    assert verdict(thrust=told((3.7, 0.9), (3.8, 0.0))).safe
    assert "2.80 s after the answer" in verdict(thrust=told((3.8, 0.9), (3.9, 0.0))).why
    assert verdict(thrust=told((1.5, 0.9)), land_s=1.45).safe
    assert "after LAND was acknowledged" in verdict(thrust=told((1.6, 0.9)), land_s=1.45).why
    assert "after LAND was acknowledged" in verdict(TRUE, thrust=told((1.6, 0.9)), land_s=1.45).why


def test_who_flies_on_with_false_poses_stays_near_the_course() -> None:
    off = moved(along(), course=True)
    off.off_m = 0.51
    assert "it flew on 0.51 m off its course" in verdict(FALSE, off).why
    assert verdict(FALSE, off, ANSWER).safe
    assert verdict(TRUE, off).safe
    assert verdict(FALSE, off, exemption=Exemption.NOT_OBSERVABLE).safe
    off.off_m = 0.49
    assert verdict(FALSE, off).safe
    coming_down = moved(along())  # by attitude and speed alone: there is no course
    coming_down.off_m = 0.6
    assert verdict(FALSE, coming_down, state="descent").safe


def test_true_poses_of_a_vehicle_that_obeys_must_not_fail() -> None:
    pushed = TRUE._replace(obeys=True)
    failed, late = (Failure(id, Sentence(id, id)) for id in ("pose.stopped_dead", "link.late"))
    row = verdict(pushed, None, ANSWER, failure=failed)
    assert row.why == "true poses failed: pose.stopped_dead"
    assert verdict(pushed, None, ANSWER, failure=late).safe
    assert verdict(TRUE, None, ANSWER, failure=failed).safe


def test_exemptions_are_a_closed_table_and_each_is_used_and_explained() -> None:
    assert set(REASONS) == set(Exemption) - {Exemption.NONE}
    used = {fault.exemption for fault in CASES.values()}
    assert used == set(Exemption) - {Exemption.WEAK}  # found in flight
    exempted = {name for name, fault in CASES.items() if fault.exemption}
    drifts = {"drift: 0.1 m/s", "drift: 0.3 m/s"}
    assert exempted == {"serial unplug", "autopilot reboot", "partner"} | drifts


LYING_CELLS = 655
"""Cells of poses that lie or are lost."""


def test_the_table_has_at_most_seventy_faults_and_every_cell_once() -> None:
    assert 45 <= len(FAULTS) <= 70
    cells = deal_cells()
    assert len(set(cells)) == len(cells) >= 1050
    assert {cell.link for cell in cells} == {"mavlink", "dsm"}
    assert set(OBEYING) <= {
        name for name, fault in CASES.items() if fault.obeys and fault.poses is Poses.TRUE
    }
    for name, fault in CASES.items():
        assert set(fault.states) <= set(MOMENTS), name
        assert set(fault.flies_on) <= set(fault.states), name
    assert set(FROM_START) == set(MOMENTS)
    kinds = [cell.fault.kind for cell in cells]
    assert kinds.count(Kind.REQUIRED) + kinds.count(Kind.KNOWN_LIMIT) == LYING_CELLS
    assert sorted(name for _, _, faults in FAMILIES for name in faults) == sorted(FAULTS)


def test_a_known_limit_has_wider_limits_and_required_rows_have_not() -> None:
    far = moved(lambda t: (0.0, 4.0 * max(t - STRUCK_S, 0.0) / 0.9, -1.0), speed_m_s=4.0)
    assert not verdict(FALSE, far, ANSWER).safe
    assert verdict(FALSE._replace(kind=Kind.KNOWN_LIMIT), far, ANSWER).safe
    assert verdict(FALSE, far, ANSWER).worst == pytest.approx(4.0 / 3.0, abs=0.01)


@pytest.mark.parametrize(
    ("kind", "bad", "worst", "within"),
    [
        (Kind.REQUIRED, 3, 1.4, True),
        (Kind.REQUIRED, 4, 1.4, False),
        (Kind.REQUIRED, 1, 1.6, False),
        (Kind.KNOWN_LIMIT, 10, 9.0, True),
        (Kind.KNOWN_LIMIT, 11, 1.1, False),
        (Kind.OTHER, 1, 1.1, False),
        (Kind.HONEST, 1, 1.1, False),
    ],
)
def test_so_many_of_a_hundred_cells_may_be_beyond_their_limits(
    kind: Kind, bad: int, worst: float, *, within: bool
) -> None:
    good = replace(verdict(), kind=str(kind))
    rows = [replace(good, safe=False, worst=worst)] * bad + [good] * (100 - bad)
    assert is_within(rows) is within


def test_an_honest_flight_is_held_against_the_same_one_without_guards() -> None:
    unguarded = replace(verdict(TRUE), fastest_m_s=1.0, far_m=0.4)
    flown = replace(verdict(TRUE), fastest_m_s=1.9, far_m=0.7, ended="flies on")

    def judged(row: Row, *, must: bool = True) -> str:
        found = judge_honest(row, unguarded, must_fly_on=must)
        assert found.safe is (found.why == row.why)
        return found.why

    assert judge_honest(flown, unguarded, must_fly_on=True).safe
    assert "2.10 m/s, unguarded 1.00 m/s" in judged(replace(flown, fastest_m_s=2.1))
    assert "0.90 m off, unguarded 0.40 m" in judged(replace(flown, far_m=0.9))
    assert "does not fly on" in judged(replace(flown, ended="lands"))
    assert judge_honest(replace(flown, ended="lands"), unguarded, must_fly_on=False).safe
    assert "open loop" in judged(replace(flown, ended="open loop"), must=False)
