"""A few cells of the fault deck; the whole of it is `groundstation-sim faults`. And that its judge can find fault."""

import json
import math
import struct
from itertools import repeat

import pytest

from groundstation.core.geometry import euler_zyx
from groundstation.core.messages import IdleRecord
from links.core import Command, Segment
from links.mavlink.protocol import MavlinkCodec
from sim.__main__ import main
from sim.scenarios import SCENARIOS, prepare
from sim.world import Quadrotor, SimulatedVehicle, Wind, World
from tests.proving.faults import FAULTS, MOMENTS, deal_cells, fly_together, pictures, quick, text
from tests.proving.faults.cell import fly_cell
from tests.proving.faults.judge import TOUCHDOWN_M_S, Thrust, WireJudge
from tests.proving.faults.table import page

STATION, VEHICLE = ("127.0.0.1", 14540), ("127.0.0.1", 49152)
FAR = ("trajectory.centre_ned=[0,0,0]",)
"""Where the figure is in every scenario, and not near the place of take-off."""
CELLS = [
    ("freeze", "hold", "descent → aborted"),
    ("dropout", "tracking", "descent → aborted"),
    ("marker swap", "take-off", "descent → aborted"),
    ("latency step", "hold", "flies on"),
    ("frame loss", "hold", "aborted"),
    ("clock step", "hold", "flies on"),
    ("link stall", "landing", "autopilot lands"),
    ("mode stolen", "take-off", "handed_over"),
    ("motor at 70 %", "take-off", "landing"),
    ("battery sag", "hold", "landing"),
    ("controller exception", "landing", "aborted"),
    ("SIGTERM", "descent", "flies on"),
    ("teleport", "ready", "aborted"),
    ("dropout", "arming", "aborted"),
    ("dropout", "spool-up", "landing"),
    ("estimator reset", "ready", "flies on"),
    ("estimator reset", "hold", "flies on"),
    ("estimator reset", "tracking", "flies on"),
    ("wireless", "moving", "flies on"),
    ("push", "moving", "flies on"),
]


@pytest.mark.parametrize(("fault", "state", "reaction"), CELLS)
def test_a_fault_ends_safely(fault: str, state: str, reaction: str) -> None:
    row = fly_cell(fault, state)
    assert row.safe, row.why
    assert reaction in row.reaction
    assert row.tilt_deg < 60.0
    assert (row.touchdown_m_s or 0.0) < TOUCHDOWN_M_S
    assert (row.answer_ms is None) == (reaction == "flies on")


def test_an_estimator_that_resets_its_heading_has_the_true_one_again_and_says_so() -> None:
    world = World(attitude_noise_rad=0.0)
    vehicle = SimulatedVehicle(Quadrotor(world, Wind(world, iter(()))), world, repeat((0.0,) * 6), iter(()))

    def seen() -> tuple[int, int]:
        truth = vehicle.measure(0.0)
        return round(math.degrees(euler_zyx(truth.attitude)[2])), truth.resets

    assert seen() == (0, 0)
    vehicle.lead_heading_astray(19.0)
    assert seen() == (19, 0)
    vehicle.reset_heading()
    assert seen() == (0, 1)


@pytest.mark.parametrize("state", ["take-off", "tracking", "moving", "returning", "landing", "descent"])
def test_where_only_answers_get_lost_the_descent_is_no_fall(state: str) -> None:
    row = fly_cell("answers gone", state)
    assert row.safe, row.why
    assert row.touchdown_m_s is not None
    assert row.touchdown_m_s < 0.8


def test_what_a_radio_vehicle_can_not_be_asked_for_is_said() -> None:
    row = fly_cell("serial unplug", "hold")
    assert row.safe
    assert row.touchdown_m_s is not None
    assert row.touchdown_m_s > TOUCHDOWN_M_S
    assert row.exemption == "no link"


@pytest.mark.parametrize("fault", ["latency step", "frame loss"])
def test_late_poses_and_lost_frames_do_not_make_a_landing_in_bad_air_a_fall(fault: str) -> None:
    row = fly_cell(fault, "landing", seed=3, scenario="adverse", overrides=FAR)
    assert row.safe, row.why
    assert row.touchdown_m_s is not None
    assert row.touchdown_m_s < 0.95


@pytest.mark.parametrize("fault", ["body carried", "body carried, radio"])
def test_a_body_that_somebody_takes_away_during_spool_up_is_not_our_vehicle_lifting_off(fault: str) -> None:
    row = fly_cell(fault, "spool-up")
    assert row.safe, row.why
    assert row.answer_ms is not None
    assert row.answer_ms < 100.0
    assert row.highest_m < 0.1


def test_a_body_that_was_taken_for_ours_from_the_start_is_seen_to_be_carried_by_how_it_leans(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pictures, "NEAR_M", 0.0)
    row = fly_cell("body carried", "spool-up")
    assert row.safe, row.why
    assert "it tips" in row.why
    assert row.highest_m < 0.1


def test_a_vehicle_that_a_tether_stops_below_its_course_lands_from_where_it_is_and_does_not_shoot_up_first() -> None:
    row = fly_cell("tether", "spool-up")
    assert row.safe, row.why
    assert "from where it should be" in row.why
    assert row.touchdown_m_s is not None
    assert row.touchdown_m_s < 0.7


def test_a_stall_of_the_link_in_a_take_off_ends_it_before_the_autopilot_has_landed_by_itself() -> None:
    row = fly_cell("link stall", "take-off")
    assert row.safe, row.why
    assert row.reaction == "autopilot lands → descent"
    assert row.touchdown_m_s is not None
    assert row.touchdown_m_s < 0.7


@pytest.mark.parametrize("fault", ["z frozen", "flicker", "z mirrored", "frozen, radio"])
def test_a_picture_that_lies_from_lift_off_on_does_not_send_the_vehicle_up(fault: str) -> None:
    row = fly_cell(fault, "lift-off")
    assert row.safe, row.why
    assert row.highest_m < 0.7


@pytest.mark.parametrize("seed", [0, 3])
def test_positions_in_another_unit_do_not_throw_the_estimate_by_one_that_comes_near(seed: int) -> None:
    row = fly_cell("mm for m", "hold", seed=seed)
    assert row.safe, row.why
    assert row.fastest_m_s < 1.0
    assert "no pose for" in row.why


@pytest.mark.parametrize("seed", [3, 6])
def test_axes_that_are_swapped_in_flight_are_suspect_before_they_have_led_the_vehicle_away(seed: int) -> None:
    row = fly_cell("x and y swapped", "tracking", seed=seed)
    assert row.safe, row.why
    assert row.fastest_m_s < 2.6


@pytest.mark.parametrize("state", ["take-off", "landing"])
def test_a_floor_that_few_poses_show_is_felt_before_the_model_falls_through_it(state: str) -> None:
    row = fly_cell("every 11th frame", state)
    assert row.safe, row.why
    assert "descent" not in row.reaction
    assert row.over_hover_s == 0.0


@pytest.mark.parametrize(
    ("fault", "state"),
    [("few, x mirrored", "hold"), ("few, z mirrored", "lift-off"), ("few, position frozen", "moving")],
)
def test_a_picture_of_which_few_frames_come_is_found_out_as_one_of_many(fault: str, state: str) -> None:
    row = fly_cell(fault, state)
    assert row.safe, row.why


@pytest.mark.parametrize("state", ["hold", "landing"])
def test_a_height_that_sinks_and_then_stands_is_not_taken_for_the_floor(state: str) -> None:
    row = fly_cell("height sinks", state)
    assert row.safe, row.why


def test_rotors_that_can_not_hold_the_vehicle_any_more_are_not_asked_for_a_soft_touchdown() -> None:
    weak = fly_cell("motor at 70 %", "landing", scenario="adverse", overrides=FAR)
    assert weak.safe, weak.why
    assert weak.exemption == "weak rotors"
    assert fly_cell("motor at 70 %", "landing").exemption == ""


def test_a_bring_down_by_rates_alone_is_found_to_be_too_hard_for_a_vehicle_that_could_land_itself() -> None:
    row = fly_cell("dropout", "tracking", overrides=("link.bring_down=rates",))
    assert not row.safe
    assert "it met the floor at" in row.why


def test_the_quick_deck_has_every_fault_of_virtual_time_and_every_state() -> None:
    work = quick()
    assert len(work) == len(set(work)) >= 20
    assert {cell.fault for cell in work} == {name for name, fault in FAULTS.items() if fault.strike is not None}
    assert {cell.state for cell in work} == set(MOMENTS)
    assert not any(cell.live for cell in work)
    assert set(work) < set(deal_cells())


def judged(time_s: float, thrust: float, rates: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> str:
    """What is wrong with a frame that leaves at ``time_s``, where one command was made with its deadline at 1 s."""
    _, config = prepare(SCENARIOS["paper"], [])
    wire = WireJudge(config, Thrust(0.8, lambda time_s, signal: signal, 0.3))
    parts = (Segment(0.5, 0.6, (0.1, 0.0, 0.0)), Segment(0.1, 0.0, (0.0, 0.0, 0.0)))
    wire.record(IdleRecord(0.75, 0.8, Command(0.8, (0.0, 0.0, 0.0), 0, 0.75, 1.0, parts)))
    frame = MavlinkCodec(245, 190).attitude_target(time_s, 1, 1, 0.5, (0.0, 0.0, 0.0))
    frame = frame.ljust(60, b"\0")[:30] + struct.pack("<4f", *rates, thrust / config.full_thrust_n)
    wire.tap(time_s, STATION, VEHICLE, frame)
    return wire.wrong


def test_the_judge_lets_pass_what_is_due() -> None:
    assert judged(0.9, 0.8) == ""
    assert judged(1.0, 0.8) == ""
    assert judged(1.2, 0.6, (0.1, 0.0, 0.0)) == ""
    assert judged(1.55, 0.0) == ""
    assert judged(9.0, 0.0) == ""


@pytest.mark.parametrize(
    ("time_s", "thrust", "rates"),
    [
        (1.01, 0.8, (0.0, 0.0, 0.0)),
        (0.9, 0.81, (0.0, 0.0, 0.0)),
        (0.9, 0.6, (0.1, 0.0, 0.0)),
        (1.7, 0.6, (0.1, 0.0, 0.0)),
    ],
)
def test_the_judge_finds_what_is_not_due(time_s: float, thrust: float, rates: tuple[float, float, float]) -> None:
    assert "was not due then" in judged(time_s, thrust, rates)


def test_the_judge_finds_a_number_that_is_not_finite() -> None:
    assert "not finite" in judged(0.9, math.nan)
    assert "not finite" in judged(0.9, 0.8, (0.0, math.inf, 0.0))


def test_a_row_of_the_json_says_where_when_and_how_far(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "groundstation-sim faults --fault dropout --state hold --json"
    monkeypatch.setattr("sys.argv", words.split())
    assert main() == 0
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert (row["fault"], row["state"]) == ("dropout", "hold")
    assert (row["link"], row["scenario"]) == ("mavlink", "paper")
    assert 5.0 < row["struck_s"] < 20.0
    assert 200.0 < row["answer_ms"] < 300.0
    numbers = ("highest_m", "sideways_m", "fastest_m_s", "touchdown_m_s", "over_hover_s", "peak_error_m", "tilt_deg")
    assert all(isinstance(row[name], float) for name in numbers)
    assert (row["exemption"], row["safe"]) == ("", True)


def test_cells_that_are_flown_together_are_those_of_flights_of_their_own() -> None:
    faults = ["dropout", "push", "controller exception"]
    together = fly_together(faults, "hold", seed=0, scenario="paper")
    assert together == [fly_cell(fault, "hold") for fault in faults]


def test_a_flight_that_never_comes_to_its_strike_is_a_row_that_is_unsafe() -> None:
    grounded = ("vehicle.mass_kg=0.03",)
    rows = fly_together(["dropout", "push"], "hold", seed=0, scenario="paper", overrides=grounded)
    assert [(row.fault, row.safe, row.struck_s) for row in rows] == [("dropout", False, None), ("push", False, None)]
    assert "the flight ended before hold" in rows[0].why


FROM_THE_START = ("partner", "yaw off by 14°", "ground effect")


@pytest.mark.parametrize("fault", FROM_THE_START)
def test_a_flight_may_begin_with_its_fault(fault: str) -> None:
    row = fly_cell(fault, "start")
    assert row.safe, row.why
    assert row.struck_s == 0.0
    assert row.reaction == "flies on"


@pytest.mark.parametrize("fault", ["push", "motor at 130 %", "wireless", "stamps off by 2 ms", "stamps off by 5 ms"])
def test_a_vehicle_that_obeys_flies_on(fault: str) -> None:
    row = fly_cell(fault, "hold")
    assert row.safe, row.why
    assert row.reaction == "flies on"


@pytest.mark.parametrize("state", ["take-off", "hold", "landing"])
def test_poses_that_are_late_by_one_round_of_the_question_are_no_answer(state: str) -> None:
    row = fly_cell("late by 400 ms, fresh", state)
    assert row.safe, row.why


def test_a_descent_by_good_poses_lifts_with_a_weak_motor() -> None:
    row = fly_cell("motor at 70 %", "descent")
    assert row.safe, row.why
    assert row.touchdown_m_s is not None
    assert row.touchdown_m_s < 0.7


@pytest.mark.parametrize("seed", [4, 5])
def test_a_height_that_is_mirrored_in_a_landing_does_not_drop_the_vehicle(seed: int) -> None:
    row = fly_cell("z mirrored", "landing", seed=seed)
    assert row.safe, row.why


def test_a_vehicle_that_is_led_by_a_hand_or_hangs_on_a_cable_comes_to_rest() -> None:
    for fault, state in (("taken out of the air", "tracking"), ("tether", "hold")):
        row = fly_cell(fault, state)
        assert row.safe, row.why
        assert row.reaction != "flies on"


def test_what_poses_alone_can_not_tell_is_judged_after_five_seconds() -> None:
    row = fly_cell("drift 0.3 m/s", "hold")
    assert (row.safe, row.exemption) == (True, "not observable")
    assert row.sideways_m == pytest.approx(1.5, abs=0.1)


def test_a_partner_is_told_the_same_and_goes_another_way_in_other_air() -> None:
    row = fly_cell("partner", "hold")
    assert row.exemption == "not observable"
    assert 0.5 < row.sideways_m < 1.0


def test_the_table_says_what_is_unsafe() -> None:
    row = fly_cell("dropout", "ready")
    bad = type(row)(**{name: getattr(row, name) for name in row.__struct_fields__} | {"safe": False, "why": "so"})
    assert "1 unsafe" in text([row, bad])
    assert "UNSAFE dropout" in text([bad])
    assert "**NO** | so |" in page([bad], "groundstation-sim faults")


@pytest.mark.parametrize("fault", ["long hold, x frozen", "long hold, position frozen"])
def test_a_position_that_stands_in_a_hold_that_lasts_is_found_by_a_question(fault: str) -> None:
    row = fly_cell(fault, "hold")
    assert row.safe, row.why
    assert row.answer_ms is not None
    assert row.answer_ms < 6000.0


@pytest.mark.parametrize("rate_hz", [25, 240])
def test_a_position_that_stands_on_the_figure_is_found_at_any_rate_of_the_poses(rate_hz: int) -> None:
    overrides = (f"sim.pose_rate_hz={rate_hz}", f"pose.rate_hz={rate_hz}")
    row = fly_cell("position frozen", "tracking", overrides=overrides)
    assert row.safe, row.why


@pytest.mark.parametrize("fault", ["one in ten, x mirrored", "z frozen", "few, z mirrored"])
def test_a_failsafe_descent_that_the_poses_lie_to_ends_on_the_model(fault: str) -> None:
    row = fly_cell(fault, "descent", seed=1)
    assert row.safe, row.why


def test_a_picture_that_stands_low_does_not_stop_the_motors_of_a_vehicle_in_the_air() -> None:
    row = fly_cell("one in ten, position frozen", "lift-off")
    assert row.safe, row.why
    assert row.fastest_m_s < 1.5


def test_a_descent_just_off_the_floor_does_not_take_thrust_for_weak_because_poses_come_late() -> None:
    row = fly_cell("late by 100 ms, fresh", "arming", seed=1)
    assert row.safe, row.why


def test_a_failsafe_descent_whose_estimate_diverges_does_not_believe_the_speed_any_more() -> None:
    row = fly_cell("one in ten, position frozen", "descent")
    assert row.fastest_m_s < 2.0, "it fell at 3 m/s, as the poses had it stand"
