"""From what speaks against the poses to what is done."""

import pytest

from groundstation.core.geometry import Vec3
from groundstation.core.safety import (
    Charge,
    Conviction,
    DescentMonitor,
    Parole,
    PoseEvidence,
    Resets,
    Since,
    charge_age,
    charge_place,
)
from groundstation.core.safety.guards import ANSWERED, HELD_S, OLD_S, PAROLE_S
from groundstation.core.vehicle import Motion

NOTHING = PoseEvidence(0.0, 0.0, 0.0, 0.0)


def test_poses_that_show_what_the_commands_do_are_charged_with_nothing() -> None:
    conviction = Conviction()
    assert conviction.look(NOTHING, 0.0) is None
    assert conviction.says == ""


def test_a_suspicion_is_told_once_and_so_is_its_end() -> None:
    conviction = Conviction()
    said = []
    for now, share in enumerate((0.2, 0.9, 0.95, 0.9, 0.1, 0.0)):
        assert conviction.look(NOTHING._replace(attitude=share), float(now)) is None
        said.append(conviction.says)
    assert [bool(line) for line in said] == [False, True, False, False, True, False]
    assert said[1].startswith("suspicion: ") and "gone" in said[4]


def test_each_witness_but_a_position_that_stands_convicts() -> None:
    for name in ("attitude", "axes", "heading"):
        charge = Conviction().look(NOTHING._replace(**{name: 1.0}), 0.0)
        assert charge is not None and charge.accuses == "convicted"
        assert charge.reason.startswith("convicted: ")


def test_half_the_evidence_convicts_where_the_autopilot_disagrees_with_the_poses_too() -> None:
    half = NOTHING._replace(attitude=0.5)
    assert Conviction().look(half, 0.0) is None
    charge = Conviction().look(half, 0.0, doubted=True)
    assert charge is not None and charge.accuses == "convicted"
    assert "autopilot" in charge.reason


def test_the_autopilot_s_doubt_alone_convicts_nobody() -> None:
    assert Conviction().look(NOTHING, 0.0, doubted=True) is None


def test_what_something_else_moves_ends_the_flight_and_is_not_convicted() -> None:
    charge = Conviction().look(NOTHING._replace(attitude=2.0), 0.0, led=True)
    assert charge is not None and charge.accuses == "suspicion"
    assert charge.reason.startswith("suspicion: ")


def test_a_position_that_stands_is_never_convicted_and_ends_the_flight_only_when_it_lasts() -> None:
    conviction = Conviction()
    stands = NOTHING._replace(still=0.8)
    assert conviction.look(stands, 0.0) is None
    assert conviction.look(stands, 0.9 * HELD_S) is None
    charge = conviction.look(stands, HELD_S)
    assert charge is not None and charge.accuses == "suspicion"


def test_a_position_that_moves_again_in_time_is_forgotten() -> None:
    conviction = Conviction()
    assert conviction.look(NOTHING._replace(still=0.8), 0.0) is None
    assert conviction.look(NOTHING._replace(still=0.1), 0.5 * HELD_S) is None
    assert conviction.look(NOTHING._replace(still=0.8), 0.9 * HELD_S) is None
    assert conviction.look(NOTHING._replace(still=0.8), 1.2 * HELD_S) is None


def test_a_position_that_does_not_show_what_pushes_the_vehicle_ends_the_flight_and_convicts_nobody() -> None:
    conviction = Conviction()
    assert conviction.look(NOTHING._replace(push=0.9), 0.0) is None
    assert conviction.says.startswith("suspicion: ")
    charge = conviction.look(NOTHING._replace(push=1.0), 0.1)
    assert charge is not None and charge.accuses == "suspicion"


def test_poses_that_are_too_old_for_a_while_end_the_flight() -> None:
    since = Since()
    assert charge_age(0.2, 0.25, since, 0.0) is None
    assert charge_age(0.1, 0.25, since, 0.2) is None
    assert charge_age(0.2, 0.25, since, 0.3) is None
    charge = charge_age(0.2, 0.25, since, 0.3 + OLD_S)
    assert charge is not None and "200 ms old" in charge.reason


def test_poses_that_come_back_prove_themselves_or_end_the_flight() -> None:
    parole = Parole()
    assert not parole.serves(1.0)
    parole.begin(1.0)
    assert not parole.serves(1.0), "none has come back"
    assert parole.serves(1.5)
    assert not parole.ends(0.5 * ANSWERED)
    assert parole.charge(1.5) is None
    charge = parole.charge(1.5 + PAROLE_S)
    assert charge is not None and charge.accuses == ""
    assert parole.ends(1.1 * ANSWERED)
    assert not parole.serves(3.0)
    parole.begin(4.0)
    assert parole.charge(4.5) is None, "those that come back from another gap have their own time"


def sinks(descent: DescentMonitor, velocity: Vec3, share: float, seconds: float, *, high: bool = True) -> Charge | None:
    """What follows from a failsafe descent whose poses show so fast a motion for so long."""
    motion = Motion((0.0, 0.0, -1.0), velocity, (1.0, 0.0, 0.0, 0.0), 1.0, (0.0, 0.0, 0.0))
    charges = [descent.charge(motion, share, high, 0.02 * n) for n in range(round(seconds / 0.02))]
    return next((one for one in charges if one is not None), None)


def test_a_descent_that_sinks_as_told_is_not_charged() -> None:
    assert sinks(DescentMonitor(), (0.3, 0.0, 0.4), 0.97, 5.0) is None


def test_a_descent_that_gets_faster_across_though_told_to_level_out_ends_on_the_model() -> None:
    descent = DescentMonitor()
    assert sinks(descent, (0.4, 0.0, 0.4), 1.0, 0.2) is None
    charge = sinks(descent, (2.2, 0.0, 0.4), 1.0, 0.2)
    assert charge is not None
    assert "it gets faster, 2.2 m/s" in charge.reason
    assert charge.accuses != "convicted"


def test_a_descent_that_begins_fast_and_slows_down_is_not_charged() -> None:
    descent = DescentMonitor()
    for tenths in range(30, 0, -1):
        assert sinks(descent, (0.1 * tenths, 0.0, 0.4), 1.0, 0.1) is None


@pytest.mark.parametrize(("velocity", "share", "high", "ends"), [
    ((0.0, 0.0, 0.0), 0.85, True, True),
    ((0.0, 0.0, 0.0), 0.85, False, False),
    ((0.0, 0.0, 0.0), 0.97, True, False),
    ((0.0, 0.0, -0.3), 0.8, True, False),
])  # fmt: skip
def test_poses_that_stand_up_in_the_air_while_thrust_does_not_carry_end_it_and_a_stronger_motor_does_not(
    velocity: Vec3, share: float, high: bool, ends: bool
) -> None:
    assert (sinks(DescentMonitor(), velocity, share, 1.5, high=high) is not None) is ends


def test_poses_that_rise_ever_faster_while_thrust_does_not_carry_end_it() -> None:
    descent = DescentMonitor()
    assert sinks(descent, (0.0, 0.0, 0.4), 0.9, 0.2) is None
    assert sinks(descent, (0.0, 0.0, -0.5), 0.8, 0.5) is not None


@pytest.mark.parametrize(("height_m", "astray_m", "ends"), [(-0.1, 0.0, False), (-0.31, 0.0, True), (-0.6, 0.4, False)])
def test_a_pose_under_the_floor_is_no_pose_of_ours(height_m: float, astray_m: float, ends: bool) -> None:
    assert (charge_place(height_m, astray_m) is not None) is ends


def test_an_estimate_that_is_reset_four_times_in_five_seconds_flies_and_one_more_ends_it() -> None:
    resets = Resets()
    charges = [resets.charge(count, 0.9 * count) for count in range(6)]
    assert charges[:5] == [None] * 5
    assert charges[5] is not None
    assert "reset 5 times within 5 s" in charges[5].reason


def test_resets_that_come_every_two_seconds_are_corrections() -> None:
    resets = Resets()
    assert not any(resets.charge(count, 2.0 * count) for count in range(50))
