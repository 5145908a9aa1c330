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
    Row("flight/test_budget.py::test_without_the_only_disturbance_of_a_flight_its_error_vanishes", 1, "disturbances"),
    Row("flight/test_fault_deck.py::test_late_poses_and_lost_frames_do_not_make_a_landing_in_bad_air_a_fall", 1,
        "faults"),
    Row("flight/test_fault_deck.py::test_poses_that_are_late_by_one_round_of_the_question_are_no_answer", 1, "moments"),
    Row("flight/test_gale.py::test_without_aerodynamics_at_most_nine_are_so_that_the_test_has_power", 0,
        "of the test before it, and not of what flies"),
    Row("flight/test_identify.py::test_the_drag_that_its_scenario_tells_quad1kg_is_what_is_found_in_flight", 0,
        "a figure of one scenario; drag is found in the flight on rotors"),
    Row("flight/test_identify.py::test_an_interval_that_a_flight_tells_holds_the_truth", 0,
        "the flight before it, counted by another tool"),
    Row("flight/test_own.py::test_a_course_from_rest_to_rest_is_followed_from_the_first_moment_to_after_the_last", 1,
        "courses, which contract/test_trajectories.py has"),
    Row("flight/test_report.py::test_figures_for_print_are_a_column_wide", 1, "formats of one figure"),
    Row("flight/test_scenarios.py::test_on_rotors_a_pure_lag_in_the_place_of_lag_and_delay_costs_twice_as_much", 1,
        "vehicles"),
    Row("flight/test_thrust_scale.py::test_a_curve_that_is_told_right_costs_nothing", 1, "ways to tell it"),
    Row("flight/test_tune.py::test_processes_and_one_process_see_the_same", 0,
        "test_campaign.py flies the same in processes and in one"),
    Row("flight/test_witness_flights.py::test_attitudes_that_begin_to_lie_in_flight_are_doubted_once_it_leans", 3,
        "lies, in either air; unit/test_witness.py has each"),
    Row("flight/test_witness_flights.py::test_attitudes_of_poses_that_lie_are_told_by_the_attitude_over_crsf", 1,
        "lies"),
    Row("flight/test_witness_flights.py::test_axes_that_were_never_right_are_doubted_as_soon_as_it_leans", 3,
        "lies, by either autopilot; unit/test_witness.py has each"),
    Row("unit/test_carry.py::test_each_of_the_24_mappings_of_the_world_and_of_the_body_is_found", 8,
        "each axis once; unit/test_frames.py tries all 24 without noise"),
    Row("unit/test_carry.py::test_each_of_the_24_mirrored_mappings_is_refused", 8, "each axis once"),
    Row("flight/test_alarms.py::test_the_poses_of_true_flights_are_not_accused", 1, "the worst air"),
    Row("flight/test_alarms.py::test_no_flight_in_bad_air_ends_by_its_poses", 0, "the test before, by more seeds"),
    Row("flight/test_batch.py::test_compiled_flights_are_those_of_numpy_to_the_bit", 0,
        "property/test_compiled_stages.py compares each stage to the bit"),
    Row("flight/test_batch.py::test_the_certificate_of_a_batch_is_the_one_watched_in_flight", 0,
        "property/test_batch_watch.py watches each flight of a batch as if it were alone"),
    Row("flight/test_batch.py::test_stamps_that_are_off_at_a_metre_and_a_half_a_second_cost_little", 0,
        "test_fault_deck.py flies stamps that are off by more, and unit/test_estimator.py looks at the noise"),
    Row("flight/test_batch.py::test_vehicles_of_a_batch_do_not_touch_each_other", 0, "each agrees with its own flight"),
    Row("flight/test_blocks.py::test_switching_one_block_off_alone_costs_accuracy", 1, "the ladder switches each on"),
    Row("flight/test_campaign.py::test_a_campaign_is_drawn", 0, "a picture of what others check"),
    Row("flight/test_equal_margins.py::test_ours_as_shipped_keeps_the_floors", 0,
        "twelve flights of a page of figures, which `make margins` makes"),
    Row("flight/test_evidence.py::test_prediction_of_a_flight_of_ours_beats_constant_velocity_whoever_wrote_it_down", 1,
        "layouts, of which the test before reads each"),
    Row("flight/test_evidence.py::test_prediction_of_an_autopilots_flight_is_no_worse_than_constant_velocity", 1,
        "captures"),
    Row("flight/test_evidence.py::test_an_attitude_loop_is_found_with_its_delay", 1, "gains"),
    Row("flight/test_identify.py::test_what_scenarios_on_rotors_are_told_is_found_again_by_a_flight_that_is_told_pure_lags",
        1, "the vehicle with lags and delays; test_scenarios.py flies all by what is told"),
    Row("flight/test_slow_radio.py::test_a_delay_that_is_told_costs_little_and_one_that_is_not_much", 2,
        "of commands, and of rates"),
    Row("flight/test_witness_flights.py::test_true_poses_are_not_doubted_by_what_a_radio_tells", 1, "the worst air"),
    Row("flight/test_dead_man.py::test_a_controller_that_stands_still_at_any_instant_for_any_time", 6,
        "random instants"),
    Row("flight/test_fault_deck.py::test_a_fault_ends_safely", 7, "every other of the deck's cells"),
    Row("flight/test_fault_deck.py::test_a_vehicle_that_obeys_flies_on", 2, "a push, and a clock that is wrong"),
    Row("flight/test_gate.py::test_no_pose_of_any_scenario_is_dropped_or_changed", 2, "scenarios"),
    Row("flight/test_late_poses.py::test_poses_that_come_late_for_good_are_as_old_as_they_are_for_good", 3, "sources"),
    Row("flight/test_missions.py::test_abort_and_kill_end_every_state_with_the_motors_off", 7,
        "unit/test_mission.py has every state"),
    Row("flight/test_missions.py::test_every_scenario_takes_off_and_lands", 1, "scenarios"),
    Row("flight/test_missions.py::test_a_failsafe_descent_comes_down_from_every_state", 3, "states"),
    Row("flight/test_obedience.py::test_a_vehicle_that_obeys_is_never_convicted", 3, "disturbances of the same kind"),
    Row("flight/test_obedience.py::test_a_picture_that_stands_still_is_found_out_while_the_vehicle_is_near_and_slow", 2,
        "each of the two faults once"),
    Row("flight/test_own.py::test_every_vehicle_that_comes_along_holds_and_flies_the_eight", 3, "vehicles"),
    Row("flight/test_replay.py::test_a_simulated_flight_is_flown_again_to_the_last_bit", 3, "sources and links"),
    Row("flight/test_rf_flights.py::test_every_radio_link_flies_as_well_as_the_scenario_demands", 1,
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
    Row("flight/test_watch.py::test_flights_that_go_well_are_never_warned_of", 1, "scenarios"),
    Row("flight/test_batch.py::test_a_batch_agrees_with_whole_flights_to_a_micrometre", 1, "in the other air"),
    Row("flight/test_blocks.py::test_telling_weak_thrust_from_wind_helps_where_thrust_is_weak_and_costs_nothing_elsewhere",
        0, "test_scenarios.py sees it told from the wind"),
    Row("flight/test_determinism.py::test_another_process_with_another_hash_seed_gives_the_same_bytes", 1, "links"),
    Row("flight/test_fault_deck.py::test_a_flight_may_begin_with_its_fault", 1, "faults"),
    Row("flight/test_fault_deck.py::test_a_floor_that_few_poses_show_is_felt_before_the_model_falls_through_it", 1,
        "at take-off as at landing"),
    Row("flight/test_fleet.py::test_every_source_that_shows_several_bodies_serves_a_fleet", 1, "sources"),
    Row("flight/test_gate.py::test_a_short_mix_up_of_bodies_does_not_reach_the_controller", 2, "sources"),
    Row("flight/test_identify.py::test_a_fast_vehicle_with_much_drag_is_found_to_a_percent", 0,
        "another vehicle than in the test of gusts"),
    Row("flight/test_missions.py::test_a_whole_mission_goes_from_the_floor_to_the_figure_and_softly_back", 1, "airs"),
    Row("flight/test_missions.py::test_every_controller_takes_off_and_lands", 1,
        "each flies in contract/test_controllers.py"),
    Row("flight/test_scenarios.py::test_composite_adaptation_does_no_harm_where_poses_are_ten_times_as_noisy", 1,
        "vehicles"),
    Row("flight/test_sources.py::test_other_bodies_and_short_occlusions_are_borne", 2, "sources"),
    Row("flight/test_sources.py::test_paper_tracks_as_well_through_every_source_as_through_vicon", 1, "sources"),
    Row("flight/test_spool_up.py::test_law_and_estimator_begin_without_a_step", 1, "vehicles"),
    Row("flight/test_spool_up.py::test_the_poses_of_another_body_that_rests_let_nothing_fly_away", 4, "instants"),
    Row("flight/test_watch.py::test_neither_are_lost_poses_gusts_and_wrong_lags", 2, "disturbances"),
    Row("flight/test_witness_flights.py::test_true_poses_are_not_doubted_in_any_air", 1, "the worst air"),
    Row("flight/test_batch.py::test_a_batch_feels_a_thrust_curve_as_a_whole_flight_does", 0,
        "the batch agrees with whole flights; what differs is one function of the plant"),
    Row("flight/test_batch.py::test_a_latency_that_is_not_the_one_told_stamps_poses_wrongly_as_in_whole_flights", 0,
        "as before; what differs is one stamp"),
    Row("flight/test_blocks.py::test_the_provable_form_of_composite_adaptation_is_no_worse_than_the_raw_one", 0,
        "a comparison of two forms, of which we fly one"),
    Row("flight/test_fault_deck.py::test_cells_that_are_flown_together_are_those_of_flights_of_their_own", 0,
        "of the tool that flies the table of faults"),
    Row("flight/test_report.py::test_two_recordings_stand_side_by_side", 0, "each stands on a page of its own"),
    Row("unit/test_bench.py::test_every_measurement_gives_json_and_words", 0,
        "of the tool that measures; others of its tests run the parts of it that judge"),
    Row("unit/test_bench.py::test_growth_is_seen", 0, "of the tool; test_allocation.py sees what flies"),
    Row("unit/test_law_document.py::test_the_law_flies_as_well_as_documented", 0, "test_scenarios.py flies them"),
    Row("unit/test_liftoff.py::test_a_body_that_rests_lets_no_vehicle_gather_energy", 2, "bodies, 40 seeds each"),
    Row("unit/test_liftoff.py::test_heights_that_wander_alone_fly_hardly_ever", 1, "50 of 200 seeds"),
    Row("unit/test_liftoff.py::test_a_vehicle_that_lifts_is_seen_to_fly_and_its_hover_thrust_and_speed_are_found", 4,
        "loads, with and without an estimate that wanders"),
    Row("unit/test_witness.py::test_it_does_not_doubt_poses_that_are_true", 22, "each scene once; motions in turn"),
    Row("unit/test_obedience.py::test_a_vehicle_that_obeys_is_never_suspected", 5, "motions, with gains and leans"),
    Row("flight/test_alarms.py::test_an_estimate_that_wanders_and_turns_its_heading_is_not_accused", 1, "seeds"),
    Row("flight/test_alarms.py::test_an_estimate_that_has_its_height_and_speed_wrong_on_the_floor_has_touched_down_all_the_same",
        1, "seeds"),
    Row("flight/test_alarms.py::test_a_coordinate_that_a_gust_holds_by_chance_is_not_accused", 1, "seeds"),
    Row("flight/test_autopilots.py::test_the_figure_eight_is_flown_on_either", 2, "each autopilot, each source"),
    Row("flight/test_fault_deck.py::test_axes_that_are_swapped_in_flight_are_suspect_before_they_have_led_the_vehicle_away",
        1, "seeds"),
    Row("flight/test_fault_deck.py::test_positions_in_another_unit_do_not_throw_the_estimate_by_one_that_comes_near", 1,
        "seeds"),
    Row("flight/test_first_screen.py::test_what_the_law_makes_out_is_told_beside_what_it_should",
        2, "too little, and right"),
    Row("flight/test_guards.py::test_who_takes_over_between_two_heartbeats_keeps_it_although_the_vehicle_then_obeys_us_no_more",
        2, "instants between two heartbeats"),
    Row("flight/test_hold_to_run.py::test_a_channel_of_the_transmitter_is_held_as_the_autopilot_tells_it", 2,
        "each autopilot, each loss"),
    Row("flight/test_library.py::test_the_example_notebook_runs_from_its_first_cell_to_its_last_in_a_running_loop", 0,
        "the next test runs the page's examples, and another flies in a running loop"),
    Row("flight/test_missions.py::test_a_mission_from_the_floor_is_flown_again_from_its_recording_to_the_last_bit", 1,
        "ways to end; test_replay.py flies others again"),
    Row("flight/test_obedience.py::test_a_flight_that_ends_by_what_the_commands_did_is_flown_again_to_the_last_bit", 1,
        "faults"),
    Row("flight/test_rf_flights.py::test_the_same_seed_gives_the_same_bytes_and_another_seed_others", 1, "links"),
    Row("flight/test_sources.py::test_a_velocity_that_is_off_its_own_positions_moves_the_vehicle_little", 1,
        "vehicles and figures"),
    Row("flight/test_spool_up.py::test_an_estimate_that_wanders_and_steps_in_yaw_as_px4_s_does_is_no_lift_off",
        2, "seeds"),
    Row("flight/test_spool_up.py::test_another_body_s_poses_do_not_tremble_under_a_nudge_and_nothing_leaves_the_floor",
        4, "vehicles and links, each told right and wrong"),
    Row("flight/test_spool_up.py::test_a_vehicle_whose_own_poses_tremble_under_a_nudge_lifts_off",
        2, "vehicles and links"),
    Row("flight/test_spool_up.py::test_poses_too_noisy_to_show_a_nudge_are_no_other_body_s", 1, "seeds"),
    Row("flight/test_watch.py::test_noise_alone_feeds_v_with_about_what_the_theory_says", 1, "levels of noise"),
    Row("property/test_composite_proof.py::test_a_whole_flight_on_the_ideal_plant_keeps_the_inequality_and_finds_the_disturbance",
        2, "disturbances, known and not"),
    Row("unit/test_source_clock.py::test_a_queue_that_stays_for_good_is_never_forgotten", 2, "lengths of the queue"),
    # Whole programs whose parts are tried in virtual time, or in one process.
    Row("flight/test_campaign_cluster.py::test_a_cluster_of_processes_flies_the_same_rows", 0, "as the next"),
    Row("flight/test_campaign_cluster.py::test_a_scheduler_and_two_workers_fly_the_same_rows_and_the_loss_of_one_worker_costs_none",
        0, "flight/test_campaign.py flies the same rows in processes of this machine"),
    Row("flight/test_campaign_cluster.py::test_a_worker_of_another_program_is_refused", 0, "a check of two words"),
    Row("e2e/test_dead_man.py::test_a_controller_that_raises_or_blocks_the_program_ends_in_a_bring_down", 0,
        "flight/test_dead_man.py in virtual time, at every instant"),
    Row("e2e/test_hostile_words.py::test_an_autopilot_that_refuses_in_escape_sequences_steers_no_terminal_and_forges_no_line",
        0, "unit/test_printable.py tries the words"),
    Row("e2e/test_props_off.py::test_the_whole_test_is_gone_through_and_kept_and_preflight_finds_it", 0,
        "flight/test_props_off.py goes through it in virtual time"),
    Row("e2e/test_report_page.py::test_the_page_opens_without_an_error_and_without_asking_anybody_for_anything", 0,
        "flight/test_report.py reads the page"),
    Row("e2e/test_stop_all.py::test_a_flight_with_the_same_body_is_told_and_kill_asks_before_and_reaches_what_stands_ready",
        0, "unit/test_stop_all.py and the other test of it"),
    Row("e2e/test_watchers.py::test_dashboard_and_broker_show_a_flight_and_their_deaths_do_not_touch_it", 0,
        "test_bystanders.py compares every byte that leaves"),
    Row("e2e/test_identify_command.py::test_the_commands_of_the_how_to_lead_from_a_flight_to_a_vehicle_file", 0,
        "flight/test_identify.py finds the same figures; this is the page's order of commands"),
    Row("e2e/test_readme.py::test_a_command_in_the_documents_works", 5, "every tenth"),
    Row("e2e/test_recorder_process.py::test_a_kill_at_any_moment_leaves_a_recording_of_all_but_the_last_half_second", 1,
        "ten of the fifty moments"),
    Row("e2e/test_real_time.py::test_fly_refuses_every_address_that_is_not_loopback_without_a_fence_and_says_why", 3,
        "unit/test_checks.py refuses each"),
    Row("e2e/test_sim_command.py::test_bad_usage_exits_2_with_a_clear_last_line", 5, "unit tests refuse each"),
    Row("e2e/test_tui.py::test_nothing_is_drawn_outside_a_terminal_of_any_size", 1, "sizes"),
    Row("e2e/test_frozen_terminal.py::test_motors_stop_though_nobody_reads", 1, "a terminal, and not a pipe as well"),
    Row("e2e/test_served_sources.py::test_a_served_room_has_other_bodies_hides_ours_and_mixes_them_up", 2, "sources"),
    Row("e2e/test_mqtt_requests.py::test_a_flight_is_held_moved_and_landed_by_mqtt_and_the_death_of_the_broker_delays_no_command",
        0, "the tests before it ask by MQTT, and test_bystanders.py compares every byte beside a broker that dies"),
    Row("e2e/test_rehearsal.py::test_the_checks_of_a_room_pass_at_the_desk_by_each_kind_of_wire", 1, "wires"),
    Row("e2e/test_rf_flight.py::test_serve_and_fly_meet_on_a_pseudo_terminal", 0,
        "test_two_computers.py flies by a served module, too"),
    Row("e2e/test_rf_flight.py::test_a_flight_is_told_that_its_stand_by_is_gone_and_what_became_of_the_bring_down", 1,
        "who dies first; test_pacer_standby.py kills either"),
    Row("e2e/test_real_time.py::test_the_daemon_lands_on_sigterm_and_its_status_shows_the_flight", 0,
        "test_dead_man.py and test_vehicles.py end flights by this signal"),
    Row("e2e/test_tui.py::test_at_every_width_the_banner_the_numbers_and_the_way_out_are_whole", 2,
        "the least and the largest width"),
    Row("e2e/test_tui.py::test_every_order_has_its_key_and_its_name_at_every_width", 1, "the least width"),
    Row("e2e/test_sim_command.py::test_ctrl_c_while_worker_processes_start_is_told_in_one_line", 1, "instants"),
    Row("e2e/test_props_off.py::test_however_it_ends_the_vehicle_is_disarmed_and_nothing_is_kept", 1, "ends"),
)  # fmt: skip
"""Said of each row: what of it `make test` tries, or what else tries the rest."""


def spread(tried: int, cases: int) -> set[int]:
    """The numbers of the cases that are tried: ``tried`` of ``cases``, the first among them, and the last of many."""
    tried = min(tried, cases)
    return {round(k * (cases - 1) / (tried - 1)) for k in range(tried)} if tried > 1 else set(range(tried))


@pytest.hookimpl(tryfirst=True)  # before ``-m`` chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is left out."""
    cases: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        name = item.nodeid.removeprefix("tests/").partition("[")[0]
        cases[name].append(item)
    for row in ROWS:
        found = cases[row.test]
        tried = spread(row.tried, len(found))
        for number, item in enumerate(found):
            if number not in tried:
                item.add_marker(pytest.mark.matrix)
