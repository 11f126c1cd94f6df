"""What `make test` leaves to `make test-all`: the one place that decides, with the reason."""

from __future__ import annotations

import re
from collections.abc import Iterable
from fnmatch import translate

import pytest

COLLECTED = pytest.StashKey[list[str]]()
"""Where pytest's settings hold the node IDs of all tests that were found, chosen or not."""

DRAWN = "counts over many drawn records"
BENCH = "a bench of another kind, diagnosed as a whole"
BENCHES = (
    "bench_without_a_mode",
    "bouc_wen",
    "free_axes",
    "free_axis",
    "gross",
    "imitated_delay",
    "lagging",
    "linear_benches",
    "many_segments",
    "paper_case",
    "record_kinds",
    "robustness",
    "rubbing_axis",
    "spring",
    "unlisted_force",
)
SEARCHED = "a whole search, as others that stay"
CLUSTER = "a whole study on a cluster; a worker that is refused stays"
MORE = "more cases of a test of which some stay"
LINE = "one of many faults of a line, which takes as long as the line"

BLIND = "end_to_end/test_blind_families.py::test_a_hidden_cause_is_named_and_adding_it_pays"

THOROUGH = (
    (f"{BLIND}*", "a diagnosis each; one family of every site where effects act stays"),
    ("end_to_end/test_blind_families.py::test_two_hidden_causes_*", "pairs take a minute each"),
    *((f"end_to_end/test_{name}.py::*", "measured data take minutes") for name in ("mirror", "tanks", "robot_arm")),
    ("end_to_end/test_design.py::*", "a whole design and what it reaches; test_schema.py and pages run the command"),
    *((f"end_to_end/test_{name}.py::*", BENCH) for name in BENCHES),
    ("end_to_end/test_extended_model.py::*", "a diagnosis and chops on what it corrected"),
    ("analysis/diagnosis/test_investigation.py::test_an_instrument_beside_the_bench_decides_*", SEARCHED),
    ("analysis/diagnosis/test_investigation.py::test_what_a_slow_loop_leaves_tied_*", SEARCHED),
    ("analysis/diagnosis/test_investigation.py::test_two_gains_stay_tied_*", SEARCHED),
    ("analysis/diagnosis/test_investigation.py::test_the_rounds_and_the_budget_are_kept", SEARCHED),
    ("analysis/diagnosis/verdict/test_generic_alternative.py::test_a_right_name_is_never_behind_*", SEARCHED),
    ("analysis/diagnosis/verdict/test_unlisted_alternative.py::test_a_cause_that_is_left_out_is_*", SEARCHED),
    ("analysis/paper/test_rounding.py::test_what_is_stored_*", "a thousand draws; the same by another route stays"),
    ("analysis/diagnosis/evidence/test_confirmed.py::test_the_name_of_a_lone_*", SEARCHED),
    ("analysis/study/test_kinds.py::*diagnosis*", SEARCHED),
    (
        "analysis/diagnosis/response/test_diagnose_response.py::test_what_no_linear_effect_*",
        "more than a minute of search",
    ),
    ("analysis/diagnosis/search/test_pairs.py::test_friction_is_found_beside_a_rounded_command", SEARCHED),
    ("analysis/diagnosis/search/test_named_friction.py::*", SEARCHED),
    *(
        (f"campaigns/facts/test_{fact}*{part}]", DRAWN)
        for fact in (
            "loop.py::test_no_open_loop_",
            "delay.py::test_what_is_told_",
            "clock.py::test_one_clock_",
            "coherence.py::test_a_quiet_linear_",
            "unbroken.py::test_recordings_of_",
        )
        for part in (1, 2, 3)
    ),
    ("analysis/diagnosis/variance/test_causes.py::test_one_rate_for_all_kinds_holds_on_noise_alone", DRAWN),
    ("analysis/diagnosis/variance/test_broadband.py::test_none_is_found_in_coloured_noise_alone", DRAWN),
    ("analysis/diagnosis/variance/test_broadband.py::test_an_amplifier_*", DRAWN),
    ("analysis/diagnosis/variance/test_broadband.py::test_a_torque_of_all_frequencies_*", DRAWN),
    ("analysis/diagnosis/variance/test_lines.py::*", DRAWN),
    ("analysis/diagnosis/test_runs.py::test_noise_is_no_line", DRAWN),
    ("analysis/diagnosis/verdict/test_drifting.py::test_noise_is_no_drift*", DRAWN),
    ("analysis/diagnosis/verdict/test_lack_of_fit.py::test_coloured_noise_is_not_found_again_in_itself", DRAWN),
    ("analysis/diagnosis/evidence/test_evidence.py::test_noise_alone_is_significant_as_often_*", DRAWN),
    ("analysis/diagnosis/noise/test_louder.py::test_what_stands_out_only_in_the_loudest_rows_*", DRAWN),
    ("analysis/diagnosis/noise/test_slow_noise.py::*", DRAWN),
    ("analysis/diagnosis/evidence/test_slow_noise.py::test_slow_noise_is_significant_as_often_*", DRAWN),
    ("analysis/diagnosis/verdict/test_lack_of_fit.py::test_noise_alone_makes_p_values_uniform", DRAWN),
    ("analysis/diagnosis/nominal/test_prior.py::test_covariance_is_that_of_models_*", DRAWN),
    ("analysis/identification/test_rational.py::test_magnitude_alone_finds_modes_of_either_sign", DRAWN),
    ("analysis/diagnosis/search/test_several_modes.py::test_two_missing_modes_*", SEARCHED),
    ("analysis/identification/test_axes.py::test_what_one_drive_adds_to_another_axis_*", SEARCHED),
    ("analysis/identification/test_identify.py::test_multisines_give_all_axes_at_once_*", SEARCHED),
    ("analysis/identification/test_fsm.py::test_one_model_per_level_*", "the measured mirror"),
    ("analysis/study/test_cluster.py::test_trials_of_every_kind_*", "every kind of trial three times over"),
    ("analysis/study/test_cluster.py::test_a_pause_leaves_the_cluster_*", CLUSTER),
    ("analysis/study/test_cluster.py::test_a_killed_worker_*", CLUSTER),
    ("analysis/study/test_cluster.py::test_a_killed_scheduler_*", CLUSTER),
    ("analysis/study/test_cluster.py::test_a_cluster_without_workers_*", CLUSTER),
    ("analysis/study/test_cluster.py::test_a_trial_that_has_cost_too_many_workers_*", CLUSTER),
    ("analysis/study/test_run.py::test_a_study_that_is_killed_again_and_again_*", "kills a study many times"),
    ("benchmarks/test_speed.py::test_all_compute_the_same*diagnosis*", "a panel of diagnoses"),
    ("benchmarks/test_speed.py::test_all_compute_the_same*paper*", "the whole report, which others make in small"),
    ("benchmarks/test_speed.py::test_all_compute_the_same*log-commands*", "commands on a long log"),
    (
        "benchmarks/test_speed.py::test_all_compute_the_same*frequency-response*",
        "its kernel for several cores takes half a minute to compile",
    ),
    ("benchmarks/test_speed.py::test_all_compute_the_same*new-process*", "compiles all of a bench again"),
    ("benchmarks/test_study_cost.py::test_trials_that_do_nothing_go_through_a_cluster", "starts a cluster to time it"),
    ("benchmarks/test_study_cost.py::test_one_small_study_*", "a study that is timed"),
    ("analysis/challenge/test_end_to_end.py::*", "test_schema.py and the blind families run the commands"),
    ("analysis/challenge/second/test_end_to_end.py::*", "a whole diagnosis; test_schema.py runs the commands"),
    ("analysis/challenge/test_make.py::*", "makes many cases; test_schema.py and the blind families make one each"),
    ("campaigns/log/test_hostile.py::test_mutated_logs_*", "as the mutated HDF5 sources, which stay"),
    ("campaigns/playing/test_campaign_run.py::test_killed_and_resumed_*30 Hz*", "killed in one place of three"),
    ("campaigns/playing/test_campaign_run.py::test_killed_and_resumed_*chop*", "killed in one place of three"),
    ("campaigns/serial/test_disk.py::test_a_disk_that_others_fill_*", "the disk that is too small stays"),
    ("campaigns/serial/test_disk.py::test_a_campaign_that_a_full_disk_ended_*", "the disk that is too small stays"),
    ("campaigns/serial/test_disk.py::test_a_log_that_another_program_writes_*a]", "the other way to open it stays"),
    ("campaigns/importing/test_imports_drawn.py::test_two_thousand_*", "four of each form stay"),
    (
        "campaigns/importing/test_dialects_drawn.py::test_ten_thousand_*",
        "a drawn count; the other tests of the file stay",
    ),
    ("campaigns/importing/test_hostile.py::test_mutated_sources_*mat*", "as the mutated HDF5 sources, which stay"),
    ("campaigns/serial/test_faulty_line.py::test_a_damaged_line_gives_right_data*tcp*", LINE),
    ("campaigns/serial/test_faulty_line.py::test_a_bench_that_stalls_again_and_again_*", LINE),
    ("campaigns/serial/test_faulty_line.py::test_a_process_that_dies_is_told_as_such", LINE),
    ("campaigns/serial/test_interrupts.py::test_hosts_that_knock_at_once_*", LINE),
    ("mccdcli/commands/test_diagnose.py::test_a_model_that_is_wrong_*", "the tutorial diagnoses a wrong model"),
    ("mccdcli/commands/test_diagnose.py::test_a_model_that_is_right_*", "the nulls of the blind families stay"),
    ("analysis/identification/test_axes.py::test_the_friction_of_one_axis_*", "a whole fit, as others that stay"),
    ("analysis/identification/test_axes.py::test_readings_of_one_body_*", "a whole fit, as others that stay"),
    ("analysis/identification/test_axes.py::test_a_torque_that_is_always_there_*", "a whole fit, as others that stay"),
    ("analysis/diagnosis/answer/test_page_browser.py::test_hours_of_data_*", "a page of hours of data"),
    (
        "analysis/study/test_run.py::test_a_file_that_may_not_grow_*",
        "a full disk; those of logs and campaigns stay",
    ),
    ("benchmarks/test_speed_profile.py::test_stacks_name_who_*", "profiles a benchmark"),
    ("contract/test_tables.py::test_identical_logs_give_identical_bytes*", "makes all tables twice"),
    ("mccdcli/commands/test_investigate.py::test_a_bench_that_is_as_its_model_*", "a page and test_schema.py run it"),
    (
        "sim_backend/kernel/test_loop.py::test_a_process_that_only_loads_code_*",
        "a whole bench that loads only stays in test_object_code.py",
    ),
    (
        "sim_backend/kernel/test_loop.py::test_a_process_that_compiles_nothing_*",
        "a whole bench that loads only stays in test_object_code.py",
    ),
    ("benchmarks/test_speed.py::test_all_compute_the_same*long-log*", "a long log"),
    ("benchmarks/test_speed.py::test_all_compute_the_same*thermal*", "a whole thermal test"),
    ("campaigns/serial/test_client.py::test_throughput_*tcp*", LINE),
    ("campaigns/serial/test_interrupts.py::test_a_killed_host_is_caught_*tcp*", LINE),
    ("mccdcli/test_hostile.py::test_drawn_cases_*0]", "hostile command lines; twenty stay"),
    ("sim_backend/test_damaged_cache.py::test_no_flipped_bit_*17]", "fifty flipped bits, one of each kind stays"),
    ("sim_backend/test_damaged_cache.py::test_files_*_cut]", "compiles anew; what is no file of ours stays"),
    ("sim_backend/test_damaged_cache.py::test_files_*_empty]", "compiles anew; what is no file of ours stays"),
    ("sim_backend/test_damaged_cache.py::test_files_*_link]", "compiles anew; what is no file of ours stays"),
    ("sim_backend/test_damaged_cache.py::test_what_belongs_*file]", "compiles anew; the folder stays"),
    ("sim_backend/test_jit.py::test_processes_that_fill_one_cache_*", "four processes compile at once"),
    ("sim_backend/test_jit.py::test_no_kernel_compiles_the_text_*", "compiles many kernels anew"),
    ("campaigns/serial/test_faulty_line.py::test_drawn_faults_keep_the_promises*", LINE),
    ("analysis/challenge/second/test_make.py::test_the_same_seed_*", "makes many cases twice; whole cases stay"),
    (
        "analysis/diagnosis/response/test_diagnose_response.py::test_a_cause_is_named_where_nothing_*",
        "a whole search, as others that stay",
    ),
    ("analysis/challenge/second/test_integrate.py::test_a_law_moves_the_bench_*", MORE),
    ("analysis/challenge/test_limits.py::test_signature_grows_*", MORE),
    (
        "analysis/challenge/test_sealed.py::test_a_diagnosis_opens_its_own_case_*",
        "what one opens is seen by tests that stay",
    ),
    ("analysis/challenge/second/test_limits.py::test_a_line_is_seen_*control1]", MORE),
    ("packaging/test_plugin.py::test_a_diagnosis_names_*", "a whole diagnosis; models, plans and strategies stay"),
    ("packaging/test_plugin.py::test_a_package_that_does_not_keep_its_promise_*", MORE),
    ("packaging/test_plugin.py::test_a_strategy_that_returns_no_sound_stages_*", MORE),
    ("end_to_end/test_learning_is_watched.py::test_nothing_goes_on_*", MORE),
    ("end_to_end/test_learning_is_watched.py::test_the_papers_learning_*90.0]", MORE),
    ("end_to_end/test_one_error.py::*", "a whole diagnosis, as others that stay"),
    ("analysis/diagnosis/variance/test_broadband.py::test_a_hum_of_a_reading_*0]", DRAWN),
    ("analysis/diagnosis/variance/test_broadband.py::test_the_ring_of_a_start_*", SEARCHED),
    ("analysis/diagnosis/answer/test_page_browser.py::test_identical_data_*", "draws a page again"),
    ("campaigns/importing/test_dialects_drawn.py::test_a_table_comes_back_*", DRAWN),
    ("analysis/diagnosis/test_investigation.py::test_a_model_that_is_right_*", "pages and test_schema.py investigate"),
    ("analysis/diagnosis/evidence/test_evidence.py::test_the_p_values_of_the_spectra_*", DRAWN),
    ("analysis/diagnosis/verdict/test_generic_alternative.py::test_only_a_rival_that_is_sure_*", SEARCHED),
    ("analysis/diagnosis/verdict/test_drifting.py::test_a_drift_is_heard_*", MORE),
    ("analysis/diagnosis/response/test_diagnose_response.py::test_a_linear_cause_is_named_*", MORE),
    ("analysis/diagnosis/response/test_diagnose_response.py::test_of_two_drives_and_two_readings_*", SEARCHED),
    *((f"analysis/identification/test_sweep_fit.py::test_{n}*", DRAWN) for n in ("a_drawn_", "an_amp", "the_static_")),
    ("analysis/identification/test_input_delay.py::test_modes_that_imitate_a_delay_*", MORE),
    ("analysis/identification/test_closed_loop.py::test_its_numbers_are_right_*", DRAWN),
    ("analysis/design/test_output.py::test_the_power_of_a_bench_*", "designs twice; the price of a move stays"),
    ("analysis/identification/test_refined.py::test_the_error_is_the_noise_*", MORE),
    ("analysis/identification/test_from_table.py::test_modes_are_found_in_any_form*", MORE),
    ("analysis/diagnosis/answer/test_page_browser.py::test_it_loads_without_errors_*1400-dark*", MORE),
    ("analysis/diagnosis/answer/test_page_browser.py::test_it_loads_without_errors_*390-light*", MORE),
    ("analysis/identification/test_whole_delay.py::test_two_modes_are_found_*14]", "a whole fit, as others that stay"),
    ("analysis/study/test_run.py::test_the_number_of_threads_*5]", MORE),
    ("analysis/study/test_run.py::test_told_to_end_*", "Ctrl-C stays"),
    ("campaigns/facts/test_loop.py::test_a_loop_that_moves_much_*", DRAWN),
    ("campaigns/facts/test_loop.py::test_with_its_reference_*", DRAWN),
    ("campaigns/facts/test_clock.py::test_two_clocks_are_told_*", DRAWN),
    ("campaigns/facts/test_clock.py::test_a_resonance_that_softens_*", DRAWN),
    ("campaigns/importing/test_bombs.py::test_a_bomb_is_refused_*", MORE),
    ("campaigns/log/test_kill.py::test_a_killed_writer_*", MORE),
    ("campaigns/log/test_trust.py::test_a_sidecar_that_is_no_file_*", MORE),
    (
        "campaigns/serial/test_client.py::test_a_bench_that_is_not_there*serial*",
        "waits five seconds, as its like of TCP",
    ),
    ("campaigns/serial/test_conformance.py::test_a_firmware_that_bends_the_rules_*", LINE),
    ("campaigns/serial/test_disk.py::test_a_disk_without_room_for_a_header_*", MORE),
    ("campaigns/serial/test_hostile_bench.py::test_a_flood_is_bounded_in_time*", LINE),
    ("campaigns/serial/test_hostile_bench.py::test_blocks_that_drip_in_*tcp]", LINE),
    ("campaigns/serial/test_interrupts.py::test_a_second_interrupt_*signals1]", MORE),
    ("campaigns/serial/test_strangers.py::test_what_does_not_greet_*", LINE),
    ("campaigns/serial/test_strangers.py::test_a_greeting_has_its_time_*", LINE),
    (
        "mccdcli/commands/test_bench_serial.py::test_mistakes_end_in_one_line*cannot be opened]",
        "waits five seconds, as TCP",
    ),
    ("benchmarks/test_peers_identify.py::test_a_run_writes_a_page_*", "a benchmark that identifies a whole case"),
    *(
        (f"analysis/challenge/second/test_make.py::test_{name}_*", "makes many cases; test_schema.py makes some")
        for name in (
            "logs_are_whole",
            "the_nominal_model_has",
            "nothing_public_tells",
            "sizes_are_within",
            "the_truth_has",
        )
    ),
    ("mccd/test_programs.py::test_a_diagnosis_as_table_*", "the notebook diagnoses by the same verb"),
    ("mccd/test_programs.py::test_records_of_another_shape_*", "takes a diagnosis"),
    *(
        (
            f"mccdcli/commands/test_own_controller.py::test_{name}_*",
            "identifies and designs, as test_tables.py's report",
        )
        for name in ("it_is_designed_from", "it_is_used_the_next_time", "that_of_another_bench")
    ),
    ("mccdcli/test_hostile.py::test_a_campaign_with_one_amplitude_*", "a report; one that lacks runs stays"),
    ("contract/test_tables.py::test_known_misses_pass_*", "builds the report again; what is known is judged without"),
    ("end_to_end/test_markup.py::test_a_diagnosis_shows_markup_*[13]]", MORE),
    ("end_to_end/test_markup.py::test_a_report_shows_markup_*", "a report; a note with markup stays in test_tables.py"),
    *(
        (f"packaging/test_release.py::test_{name}_*", "builds wheel and source archive, as `make release` does")
        for name in ("both_archives", "the_wheel_holds", "the_source_archive", "an_installed_wheel")
    ),
    ("benchmarks/test_speed_profile.py::test_a_sampled_command_*", "profiles a command"),
    *(
        (
            f"analysis/live/test_live_browser.py::test_{name}*",
            "the page is followed, and seen on a phone, in tests that stay",
        )
        for name in (
            "it_fits_and_can_be_read*1400",
            "it_fits_and_can_be_read*390-light",
            "what_is_no_number",
            "a_log_that_goes",
        )
    ),
    (
        "mccdcli/test_schema.py::test_a_result_is_as_its_schema_says*diagnose]",
        "diagnoses again what investigate has; that answer is held to the schema, and --json to it in "
        "test_diagnose_frf.py",
    ),
    ("analysis/diagnosis/response/test_diagnose_response.py::test_coherence_tells_*0.0002]", MORE),
    ("analysis/identification/test_timefit.py::test_coloured_noise_in_open_and_closed_*0.0]", MORE),
    ("analysis/identification/test_growth.py::test_both_modes_of_a_chirp_*", MORE),
    ("analysis/identification/test_input_delay.py::test_what_a_late_input_leaves_*1.0]", MORE),
    ("analysis/diagnosis/verdict/test_scatter.py::test_noise_of_any_colour_does_not_follow_*1.0]", MORE),
    ("analysis/diagnosis/evidence/test_gain.py::test_noise_stays_as_large_*400]", MORE),
    ("analysis/study/test_engines.py::test_trials_side_by_side_*1]", MORE),
    ("analysis/study/test_engines.py::test_the_size_of_tasks_*10.0]", MORE),
    (
        "analysis/study/test_cluster.py::test_a_worker_with_other_threads_*",
        "another refused worker stays; other threads are refused in test_run.py too",
    ),
    ("analysis/diagnosis/evidence/test_unseen_phase.py::*", SEARCHED),
    ("analysis/diagnosis/variance/test_late_readings.py::test_nothing_is_late_in_sixty_*", DRAWN),
    ("analysis/diagnosis/variance/test_late_readings.py::test_what_makes_all_rows_late_*delay]", MORE),
    ("campaigns/facts/test_unbroken.py::test_recordings_of_*", DRAWN),
    ("analysis/diagnosis/noise/test_arithmetic.py::test_no_cause_is_named_in_what_*", MORE),
    ("analysis/diagnosis/noise/test_arithmetic.py::test_a_fault_is_seen_where_there_is_no_noise*True]", MORE),
    ("analysis/diagnosis/records/test_checks.py::test_a_right_model_of_averaged_*", MORE),
    ("analysis/diagnosis/fitting/test_modes.py::test_a_mode_that_rings_from_before_*", MORE),
    ("analysis/diagnosis/fitting/test_modes.py::test_a_mode_that_was_bent_*", "a whole fit, as others that stay"),
    (
        "analysis/diagnosis/fitting/test_modes.py::test_a_mode_is_where_a_whole_fit_*",
        "a whole fit, as others that stay",
    ),
    ("analysis/diagnosis/evidence/test_tuning_errors.py::test_a_size_on_unseen_rows_*1.0-True]", MORE),
    ("analysis/diagnosis/evidence/test_tuning_errors.py::test_what_is_left_of_unseen_rows_*", DRAWN),
    ("analysis/diagnosis/verdict/test_lack_of_fit.py::test_noise_that_is_loud_around_a_wave_*", DRAWN),
    ("analysis/diagnosis/evidence/test_gain.py::test_noise_is_told_*0.9999*", MORE),
    ("analysis/diagnosis/evidence/test_gain.py::test_the_interval_holds_*", DRAWN),
    ("analysis/design/test_parts.py::test_every_drawn_plant_*", DRAWN),
    ("analysis/design/test_parts.py::test_twice_the_noise_*", "designs twice; its noise is held to a simulation"),
    ("analysis/diagnosis/variance/test_broadband.py::test_a_band_is_found_and_measured*", DRAWN),
    ("analysis/diagnosis/verdict/test_generic_alternative.py::test_a_column_that_is_the_law_itself_*", SEARCHED),
    ("analysis/diagnosis/response/test_diagnose_response.py::test_a_table_of_commands_*", SEARCHED),
    ("analysis/diagnosis/response/test_diagnose_response.py::test_a_gain_is_that_of_drive_or_sensor_*", SEARCHED),
    ("analysis/diagnosis/verdict/test_scatter.py::test_noise_of_any_colour_does_not_follow_*0.0]", MORE),
    ("analysis/identification/test_long_records.py::test_what_is_not_linear_*", "a whole fit, as others that stay"),
    ("analysis/diagnosis/variance/test_uneven_noise.py::test_even_noise_raises_no_alarm", DRAWN),
    ("analysis/diagnosis/variance/test_repeats.py::test_nothing_is_lost_in_sixty_*", DRAWN),
    ("analysis/diagnosis/evidence/test_confirmed.py::test_what_only_the_fitted_*", SEARCHED),
    ("campaigns/importing/test_bombs.py::test_a_map_that_selects_one_array_*", MORE),
    ("campaigns/importing/test_engine.py::test_the_example_map_*", "the measured mirror"),
    ("benchmarks/test_peers_diagnosis.py::test_a_run_writes_a_page_*", "a benchmark that diagnoses a whole case"),
    ("mccdcli/test_links.py::*", "every output of every command; test_written_where_named.py stays"),
    ("mccd/test_programs.py::test_a_design_as_table_*", "designs; test_schema.py runs the command"),
)
"""Patterns of node IDs below tests/, and why these tests are left to the longer run."""

STAY = (
    # the quickest family of each site: command, drive, structure, reading, model, record
    f"{BLIND}*amplifier-saturation]",
    f"{BLIND}*position-dependent-force-constant]",
    f"{BLIND}*coulomb-friction]",
    f"{BLIND}*sensor-quantisation]",
    f"{BLIND}*damping-shift]",
    f"{BLIND}*sample-clock-error]",
    # smooth and abrupt laws, laws with a state, of the command, of time and of another axis
    *(
        f"analysis/challenge/second/test_integrate.py::test_a_law_moves_the_bench_*{law}]"
        for law in ("cubic-hardening", "one-sided-stop", "smooth-loop", "rounded-command", "hum", "crosstalk")
    ),
    # again one of each site
    *(
        f"analysis/challenge/test_limits.py::test_signature_grows_*{family}]"
        for family in ("ActuatorGain", "ForceConstant", "CubicStiffness", "SensorGain", "StiffnessShift", "ClockError")
    ),
    "end_to_end/test_record_kinds.py::test_a_period_*",
    "end_to_end/test_record_kinds.py::test_both_commands_*",
    "packaging/test_plugin.py::test_a_package_that_does_not_keep_its_promise_*broken*",
    "packaging/test_plugin.py::test_a_package_that_does_not_keep_its_promise_*cubic-stiffness*own*",
    "packaging/test_plugin.py::test_a_strategy_that_returns_no_sound_stages_*Thing = 3-*",
    "packaging/test_plugin.py::test_a_strategy_that_returns_no_sound_stages_*n_samples=2.5*",
    "end_to_end/test_learning_is_watched.py::test_nothing_goes_on_*all at once-0.0]",
    "analysis/diagnosis/evidence/test_unseen_phase.py::test_its_phase_*0.4]",
    "analysis/diagnosis/noise/test_arithmetic.py::test_no_cause_is_named_in_what_few_digits_leave*32 bits-False]",
    "analysis/diagnosis/noise/test_arithmetic.py::test_no_cause_is_named_in_what_rounding_leaves*False]",
    "analysis/diagnosis/records/test_checks.py::test_a_right_model_of_averaged_*7]",
    "analysis/diagnosis/fitting/test_modes.py::test_a_mode_that_rings_from_before_*3e-06-0.02]",
    "analysis/diagnosis/variance/test_broadband.py::test_a_hum_of_a_reading_*8.0-2.0]",
    "analysis/diagnosis/verdict/test_drifting.py::test_a_drift_is_heard_*warming up-some walk]",
    "analysis/diagnosis/response/test_diagnose_response.py::test_a_linear_cause_is_named_*lag]",
    "analysis/identification/test_sweep_fit.py::test_an_amplifier_behind_a_drawn_pole_*4-2.4]",
    "analysis/identification/test_sweep_fit.py::test_the_static_gain_is_known_*1]",
    "analysis/identification/test_input_delay.py::test_modes_that_imitate_a_delay_*white*",
    "analysis/identification/test_closed_loop.py::test_its_numbers_are_right_*drifting-10000]",
    "analysis/identification/test_refined.py::test_the_error_is_the_noise_*periodic, late*",
    "analysis/identification/test_from_table.py::test_modes_are_found_in_any_form*unwrapped degrees]",
    "analysis/identification/test_from_table.py::test_modes_are_found_in_any_form*real and imaginary]",
    "analysis/identification/test_growth.py::test_both_modes_of_a_chirp_*7.83-11.8-0.57]",
    "campaigns/facts/test_loop.py::test_a_loop_that_moves_much_*white]",
    "campaigns/facts/test_loop.py::test_with_its_reference_*white]",
    "campaigns/facts/test_clock.py::test_two_clocks_are_told_*-500.0-white]",
    "campaigns/facts/test_clock.py::test_two_clocks_are_told_*100.0-multisine]",
    "campaigns/facts/test_clock.py::test_a_resonance_that_softens_*white]",
    # one of each kind of file
    *(
        f"campaigns/importing/test_bombs.py::test_a_bomb_is_refused_*{bomb}]"
        for bomb in ("npz-two-names", "npy-holes", "text-one-line", "mat-holes", "h5-lying-chunks", "nc-holes")
    ),
    "campaigns/importing/test_bombs.py::test_a_bomb_is_refused_*tdms-holes]",
    "campaigns/importing/test_bombs.py::test_a_bomb_is_refused_*parquet-one-value]",
    "campaigns/log/test_kill.py::test_a_killed_writer_*0]",
    "campaigns/log/test_kill.py::test_a_killed_writer_*1]",
    "campaigns/log/test_trust.py::test_a_sidecar_that_is_no_file_*show-pipe]",
    "campaigns/log/test_trust.py::test_a_sidecar_that_is_no_file_*summary-endless]",
    "campaigns/log/test_trust.py::test_a_sidecar_that_is_no_file_*verify-folder]",
    "campaigns/serial/test_conformance.py::test_a_firmware_that_bends_the_rules_*takes any lock]",
    "campaigns/serial/test_disk.py::test_a_disk_without_room_for_a_header_*4]",
    "campaigns/serial/test_hostile_bench.py::test_a_flood_is_bounded_in_time*piece0]",
    "campaigns/serial/test_strangers.py::test_what_does_not_greet_*GET*",
    "campaigns/serial/test_strangers.py::test_a_greeting_has_its_time_**ID]",
    "mccdcli/test_hostile.py::test_drawn_cases_*0-20]",
)
"""Patterns of tests that run in `make test` all the same: of each kind that is left to the longer run, at least one."""


def _any_of(patterns: Iterable[str]) -> re.Pattern[str]:
    """Return one expression for all: every worker asks for each of thousands of tests.

    In a pattern "[" begins a set of letters, so parameters are matched by "*".
    """
    return re.compile("|".join(translate(f"tests/{pattern}") for pattern in patterns))


_THOROUGH, _STAY = _any_of(pattern for pattern, _ in THOROUGH), _any_of(STAY)


def is_thorough(nodeid: str) -> bool:
    """Tell whether a test runs in `make test-all` only."""
    return _THOROUGH.match(nodeid) is not None and _STAY.match(nodeid) is None
