"""What `make test` leaves to `make test-all`: of long rows of cases it tries some, and which say why that will do.

The cases that are left out bear the marker ``matrix``.
"""

from collections import defaultdict
from typing import NamedTuple

import pytest


class Row(NamedTuple):
    """Cases of one test, of which some will do."""

    test: str
    """Its file under tests/, and its name."""
    tried: int
    """So many of its cases `make test` tries, from the first to the last at equal steps; at 0 none."""
    why: str
    """Why that will do."""


ROWS = (
    # Flights of the same claim by other seeds, scenarios or faults.
    Row("flight/test_alarms.py::test_the_poses_of_true_flights_are_not_accused", 2, "the calmest air, and gusts"),
    Row("flight/test_alarms.py::test_no_flight_in_bad_air_ends_by_its_poses", 1, "seeds 6 to 23 of the same air"),
    Row("flight/test_batch.py::test_compiled_flights_are_those_of_numpy_to_the_bit", 1, "the other lasts 4 s, not 60"),
    Row("flight/test_batch.py::test_the_certificate_of_a_batch_is_the_one_watched_in_flight", 2, "draws of the same"),
    Row("flight/test_batch.py::test_vehicles_of_a_batch_do_not_touch_each_other", 0, "each agrees with its own flight"),
    Row("flight/test_blocks.py::test_switching_one_block_off_alone_costs_accuracy", 1, "the ladder switches each on"),
    Row("flight/test_campaign.py::test_a_campaign_is_drawn", 0, "a picture of what others check"),
    Row("flight/test_compare.py::test_each_controller_has_a_row_with_every_figure", 0,
        "every other test of it reads the same"),
    Row("flight/test_dead_man.py::test_a_controller_that_stands_still_at_any_instant_for_any_time", 6,
        "random instants"),
    Row("flight/test_fault_deck.py::test_a_fault_ends_safely", 7, "every other of the deck's cells"),
    Row("flight/test_fault_deck.py::test_a_vehicle_that_obeys_flies_on", 2, "a push, and a clock that is wrong"),
    Row("flight/test_gate.py::test_no_pose_of_any_scenario_is_dropped_or_changed", 3, "scenarios"),
    Row("flight/test_late_poses.py::test_poses_that_come_late_for_good_are_as_old_as_they_are_for_good", 3, "sources"),
    Row("flight/test_missions.py::test_abort_and_kill_end_every_state_with_the_motors_off", 7,
        "unit/test_mission.py has every state"),
    Row("flight/test_missions.py::test_every_scenario_takes_off_and_lands", 1, "scenarios"),
    Row("flight/test_missions.py::test_a_failsafe_descent_comes_down_from_every_state", 3, "states"),
    Row("flight/test_obedience.py::test_a_vehicle_that_obeys_is_never_convicted", 4, "disturbances of the same kind"),
    Row("flight/test_obedience.py::test_a_picture_that_stands_still_is_found_out_while_the_vehicle_is_near_and_slow", 2,
        "each of the two faults once"),
    Row("flight/test_own.py::test_every_vehicle_that_comes_along_holds_and_flies_the_eight", 3, "vehicles"),
    Row("flight/test_replay.py::test_a_simulated_flight_is_flown_again_to_the_last_bit", 3, "sources and links"),
    Row("flight/test_rf_flights.py::test_every_radio_link_flies_as_well_as_the_scenario_demands", 2,
        "links, in two airs"),
    Row("flight/test_rf_flights.py::test_the_vehicles_thrust_curve_is_straightened_on_the_way", 1, "links"),
    Row("contract/test_controllers.py::test_a_controller_reaches_and_follows_its_reference_within_the_limits", 6,
        "each controller once"),
    Row("flight/test_theory.py::test_v_falls_from_its_start_to_a_floor_a_million_times_lower", 1, "as we fly it"),
    Row("flight/test_theory.py::test_v_never_rises_by_more_than_sampling_allows_on_its_way_down", 1, "as we fly it"),
    Row("flight/test_theory.py::test_the_error_is_below_a_millimetre_after_10_s", 1, "as we fly it"),
    Row("flight/test_tune.py::test_a_short_search_betters_bad_gains_and_writes_a_configuration_that_flies", 0,
        "unit/test_tune.py searches by a formula, and the next test by one trial"),
    Row("flight/test_tune.py::test_margins_agree_with_flights_on_either_side", 0, "unit/test_tune.py finds margins"),
    Row("flight/test_watch.py::test_flights_that_go_well_are_never_warned_of", 3, "scenarios"),
    # Whole programs whose parts are tried in virtual time, or in one process.
    Row("e2e/test_identify_command.py::test_the_commands_of_the_how_to_lead_from_a_flight_to_a_vehicle_file", 0,
        "flight/test_identify.py finds the same figures; this is the page's order of commands"),
    Row("e2e/test_readme.py::test_a_command_in_the_documents_works", 14, "the README's first ones, and every fourth"),
    Row("e2e/test_recorder_process.py::test_a_kill_at_any_moment_leaves_a_recording_of_all_but_the_last_half_second", 1,
        "ten of the fifty moments"),
    Row("e2e/test_real_time.py::test_fly_refuses_every_address_that_is_not_loopback_without_a_fence_and_says_why", 3,
        "unit/test_checks.py refuses each"),
    Row("e2e/test_sim_command.py::test_bad_usage_exits_2_with_a_clear_last_line", 5, "unit tests refuse each"),
    Row("e2e/test_tui.py::test_nothing_is_drawn_outside_a_terminal_of_any_size", 2, "sizes"),
    Row("e2e/test_frozen_terminal.py::test_motors_stop_though_nobody_reads", 1, "a terminal, and not a pipe as well"),
    Row("e2e/test_served_sources.py::test_a_served_room_has_other_bodies_hides_ours_and_mixes_them_up", 2, "sources"),
    Row("e2e/test_props_off.py::test_however_it_ends_the_vehicle_is_disarmed_and_nothing_is_kept", 1, "ends"),
)  # fmt: skip
"""Said of each row: what of it `make test` tries, or what else tries the rest."""


def spread(tried: int, cases: int) -> set[int]:
    """The numbers of the cases that are tried: ``tried`` of ``cases``, the first among them, and the last of many."""
    if tried <= 1:
        return set(range(min(tried, cases)))
    return {round(k * (cases - 1) / (tried - 1)) for k in range(min(tried, cases))}


@pytest.hookimpl(tryfirst=True)  # before ``-m`` chooses
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what is left out.

    Raises:
        pytest.UsageError: a row names no test.
    """
    cases: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        name = item.nodeid.removeprefix("tests/").partition("[")[0]
        cases[name].append(item)
    for row in ROWS:
        found = cases[row.test]
        if not found and config.args == config.getini("testpaths"):
            raise pytest.UsageError(f"tests/matrix.py: there is no {row.test}")
        tried = spread(row.tried, len(found))
        for number, item in enumerate(found):
            if number not in tried:
                item.add_marker(pytest.mark.matrix)
