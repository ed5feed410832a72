"""Which tests prove the 34 points of what the drivers must show. A mapped test that vanishes, or no longer runs on both
GRBL dialects, makes this fail."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
CONNECTING, MOVING = "gantry/test_connecting.py", "gantry/test_moving.py"
ALARMS, RESTARTS, STOPPING = "gantry/test_alarms.py", "gantry/test_restarts.py", "gantry/test_stopping.py"
SERVOS, PORT = "servos/test_hardware_points.py", "servos/test_real_port.py"
GUARD, STOP, WIRE, BLOCKED = (f"guard/test_{name}.py" for name in ("guard", "stop", "on_the_wire", "blocked"))
DIALECTS = ("BOTH", "ALL")


@dataclass(frozen=True)
class Point:
    """One of the 34; ``dialects``: it concerns the controller's dialect, so one of its tests must run on both."""

    what: str
    proofs: dict[str, tuple[str, ...]]
    dialects: bool = False


POINTS = {
    1: Point(
        "connect identifies the firmware; an unknown device is refused",
        {
            CONNECTING: (
                "test_connecting_identifies_the_firmware",
                "test_an_unknown_firmware_is_refused",
                "test_a_garbled_identification_is_no_identification",
            )
        },
        dialects=True,
    ),
    2: Point(
        "connect never homes, unlocks, resets or moves",
        {
            CONNECTING: ("test_connecting_homes_unlocks_resets_and_moves_nothing",),
            GUARD: ("test_connecting_moves_nothing_homes_nothing_and_enables_no_torque",),
        },
        dialects=True,
    ),
    3: Point(
        "a banner that we did not cause ends homed and drops what was queued",
        {
            ALARMS: (
                "test_a_banner_that_we_did_not_cause_ends_homed_and_what_was_queued",
                "test_a_restart_ends_homed_even_where_the_controller_comes_back_idle",
            ),
            RESTARTS: (
                "test_a_restart_in_a_mute_alarm_is_seen_by_asking_for_the_status",
                "test_a_restart_in_mid_move_is_not_believed_though_its_banner_was_garbled",
            ),
            GUARD: ("test_a_restart_that_nobody_asked_for_loses_home",),
        },
        dialects=True,
    ),
    4: Point(
        "ambiguous ports are an error",
        {
            CONNECTING: (
                "test_ambiguous_ports_are_an_error",
                "test_identical_adapters_make_their_shared_name_ambiguous",
            ),
            SERVOS: ("test_point_4_two_adapters_that_could_be_meant_are_an_error",),
        },
    ),
    5: Point(
        "swapped ports are noticed before any motion",
        {
            CONNECTING: ("test_swapped_ports_are_noticed_before_any_motion",),
            SERVOS: ("test_point_5_a_gantry_on_the_servos_port_is_noticed",),
        },
    ),
    6: Point(
        "a second process is refused, naming the holder's PID",
        {
            CONNECTING: ("test_a_second_process_is_refused_with_the_holders_number",),
            "gantry/test_pty.py": ("test_a_second_process_is_refused_on_a_real_terminal",),
            PORT: ("test_point_6_a_second_process_is_refused_and_told_who_has_the_port",),
            "cli/test_sharing.py": (
                "test_a_second_process_is_refused_with_the_name_of_the_first_and_disturbs_nothing",
            ),
        },
    ),
    7: Point(
        "permission denied says what to do and is never a fallback to a mock",
        {
            CONNECTING: ("test_a_port_that_cannot_be_opened_says_what_to_do",),
            PORT: ("test_point_7_without_permission_the_error_says_what_to_do",),
            "camera/test_identity.py": (
                "test_a_camera_that_cannot_be_opened_says_what_to_do",
                "test_a_camera_that_is_not_there_is_never_replaced_by_another_source",
            ),
        },
    ),
    8: Point(
        "a move returns only when done",
        {
            MOVING: (
                "test_a_move_returns_only_when_it_is_at_rest_at_its_target",
                "test_an_idle_from_before_the_motion_is_not_taken_for_its_end",
            ),
            SERVOS: ("test_point_8_a_move_returns_only_once_at_rest_at_the_goal",),
        },
        dialects=True,
    ),
    9: Point(
        "a lost ok gives a bounded time-out and no blind resend",
        {MOVING: ("test_a_lost_ok_ends_in_bounded_time_and_nothing_is_sent_again",)},
        dialects=True,
    ),
    10: Point(
        "an extra or truncated ok stops and resynchronises",
        {MOVING: ("test_a_wrong_answer_stops_and_brings_back_into_step",)},
        dialects=True,
    ),
    11: Point(
        "garbled status lines are dropped; the position never jumps",
        {MOVING: ("test_garbled_status_lines_are_dropped_and_the_position_never_jumps",)},
        dialects=True,
    ),
    12: Point(
        "stale status is shown as stale and blocks moves",
        {
            MOVING: ("test_an_old_status_is_shown_as_stale_and_blocks_moves",),
            GUARD: ("test_a_stale_status_blocks_every_move_and_is_shown_as_stale",),
        },
        dialects=True,
    ),
    13: Point(
        "homing's silence is no disconnect; after failed homing the position is unknown",
        {
            ALARMS: ("test_the_silence_of_homing_is_no_disconnect", "test_after_failed_homing_the_position_is_unknown"),
            GUARD: ("test_homing_makes_poses_possible_and_failed_homing_loses_them",),
        },
        dialects=True,
    ),
    14: Point(
        "host limits hold even where the firmware's are off",
        {
            MOVING: ("test_our_limits_hold_where_the_firmwares_are_off",),
            SERVOS: ("test_point_14_a_wish_outside_the_travel_is_refused_before_a_byte_is_sent",),
            GUARD: ("test_what_is_out_of_limits_is_refused_before_anything_is_sent",),
        },
        dialects=True,
    ),
    15: Point(
        "no absolute move before homing without an explicit override",
        {
            MOVING: ("test_no_absolute_move_before_homing_without_an_override",),
            GUARD: ("test_before_homing_nothing_moves_and_the_remedy_is_told",),
            "guard/test_homing.py": ("test_the_gantrys_word_is_taken_only_where_the_bench_says_so",),
        },
        dialects=True,
    ),
    16: Point(
        "an alarm in mid-scan stops capture; the frame is not kept; code and remedy are shown",
        {
            ALARMS: ("test_an_alarm_in_the_middle_of_a_move_shows_its_code_and_remedy",),
            GUARD: ("test_a_picture_is_dropped_if_the_rig_did_not_stand_still_and_in_order",),
            WIRE: ("test_an_alarm_while_a_picture_is_taken_drops_it_and_shows_code_and_remedy",),
            "scan/test_runner.py": ("test_a_failing_device_stops_the_scan_after_the_picture_in_hand_is_safe",),
        },
        dialects=True,
    ),
    17: Point(
        "recovery knows which alarms need 0x18 and which re-homing; $X is never sent by itself",
        {
            ALARMS: (
                "test_an_alarm_that_keeps_the_position_is_left_by_reset_and_unlock",
                "test_an_alarm_that_loses_the_position_asks_for_homing",
                "test_the_table_of_alarms_knows_which_keep_the_position",
            ),
            GUARD: ("test_an_alarm_needs_a_person_and_the_way_out_depends_on_it",),
        },
        dialects=True,
    ),
    18: Point(
        "overrun after releasing a jog is bounded; a dead operator process stops it within 300 ms",
        {
            STOPPING: (
                "test_a_jog_ends_within_three_tenths_of_a_second_after_its_operator",
                "test_a_jog_that_is_interrupted_overruns_little_and_keeps_the_position",
            ),
            BLOCKED: ("test_a_process_that_is_killed_while_it_jogs_leaves_little_motion",),
        },
        dialects=True,
    ),
    19: Point(
        "STOP reaches the wire despite a blocked queue, and says so when it could not be confirmed",
        {
            STOPPING: (
                "test_stop_holds_then_resets_and_keeps_the_position",
                "test_stop_reaches_the_wire_while_another_thread_holds_the_lock",
                "test_stop_says_so_when_nothing_confirms_it",
            ),
            BLOCKED: (
                "test_stop_goes_out_past_a_full_planner_and_a_blocked_disk",
                "test_stop_goes_out_past_a_blocked_camera",
            ),
            STOP: ("test_a_stop_that_was_not_confirmed_says_so_and_by_which_device",),
        },
        dialects=True,
    ),
    20: Point(
        "unplugging in mid-move is noticed within 1 s on any exception; reconnecting resumes nothing",
        {
            STOPPING: ("test_a_pulled_plug_is_noticed_within_a_second",),
            SERVOS: ("test_point_20_unplugging_in_mid_move_is_noticed_and_reconnecting_resumes_nothing",),
            GUARD: ("test_a_device_that_goes_away_ends_in_disconnected_and_reconnecting_resumes_nothing",),
        },
        dialects=True,
    ),
    21: Point(
        "hung firmware is a time-out, not a hang",
        {
            STOPPING: (
                "test_hung_firmware_ends_in_a_time_out",
                "test_firmware_that_hangs_between_a_line_and_its_ok_ends_in_a_time_out",
            ),
            SERVOS: ("test_point_21_hung_servos_are_a_time_out_not_a_hang",),
        },
        dialects=True,
    ),
    22: Point(
        "units, WCO, G20 and G91 left over by others never change where we go",
        {
            MOVING: ("test_what_others_left_behind_changes_nothing",),
            CONNECTING: ("test_inches_in_reports_are_read_as_what_they_are",),
        },
        dialects=True,
    ),
    23: Point(
        "servo model, id, mode and torque are checked before the first goal",
        {
            SERVOS: (
                "test_point_23_another_servo_or_setup_than_told_is_refused",
                "test_point_23_model_and_place_are_told_and_nothing_moves_before_torque_was_enabled",
            )
        },
    ),
    24: Point(
        "enabling torque moves nothing",
        {SERVOS: ("test_point_24_enabling_torque_moves_nothing_whatever_goal_was_left",)},
    ),
    25: Point(
        "a rebooted servo is flagged",
        {
            SERVOS: (
                "test_point_25_a_servo_that_reboots_is_flagged_and_not_driven_before_it_is_referenced",
                "test_point_25_a_reboot_while_nobody_was_connected_is_known_too",
            ),
            GUARD: ("test_a_servo_that_has_rebooted_is_flagged_and_not_driven_until_it_is_referenced",),
        },
    ),
    26: Point(
        "overload, heat or voltage names the servo and halts; a reboot only on request",
        {
            SERVOS: (
                "test_point_26_a_hardware_error_names_the_servo_and_halts",
                "test_point_26_a_reboot_on_request_clears_the_error_and_loses_the_reference",
            ),
            GUARD: ("test_a_hot_servo_is_an_alarm_that_names_it_and_is_never_rebooted_by_itself",),
        },
    ),
    27: Point(
        "bad CRC, time-out, partial packet: reads retried a bounded number of times, writes checked",
        {SERVOS: ("test_point_27_garbled_packets_are_read_again_and_writes_are_checked",)},
    ),
    28: Point(
        "one mute servo gives a partial result that names it",
        {
            SERVOS: ("test_point_28_one_mute_servo_gives_the_others_and_is_named",),
            GUARD: ("test_one_mute_servo_gives_a_partial_status_that_names_it",),
        },
    ),
    29: Point(
        "after any exception the bus is still usable",
        {SERVOS: ("test_point_29_after_any_exception_the_bus_is_usable_again",)},
    ),
    30: Point(
        "a stuck servo or a missed target fails instead of capturing",
        {
            MOVING: ("test_a_target_that_is_missed_fails",),
            SERVOS: ("test_point_30_a_stuck_servo_fails_the_move",),
            GUARD: (
                "test_a_place_that_reads_back_wrong_stops_everything",
                "test_a_stuck_axis_fails_by_name_and_nothing_is_captured_after_it",
            ),
        },
        dialects=True,
    ),
    31: Point(
        "a watchdog trip is noticed; clearing it moves nothing",
        {SERVOS: ("test_point_31_a_watchdog_trip_is_noticed_and_clearing_it_moves_nothing",)},
    ),
    32: Point(
        "exit, Ctrl-C twice and a failed start follow one documented torque policy; failure is reported",
        {
            STOPPING: (
                "test_closing_in_the_middle_of_a_move_stops_it",
                "test_an_interrupt_in_the_middle_of_a_move_stops_it",
            ),
            SERVOS: (
                "test_point_32_closing_follows_the_torque_policy",
                "test_point_32_a_failed_start_follows_the_torque_policy",
                "test_point_32_a_policy_that_cannot_be_followed_is_reported_once",
            ),
            GUARD: ("test_a_torque_policy_that_could_not_be_followed_is_told_at_the_end",),
            "cli/test_benching.py": ("test_ctrl_c_twice_is_a_latched_stop",),
        },
        dialects=True,
    ),
    33: Point(
        "frames are exposed after settling",
        {
            "camera/test_freshness.py": (
                "test_frames_are_exposed_after_settling",
                "test_ten_thousand_moves_bring_no_stale_frame",
            ),
            GUARD: ("test_a_picture_is_exposed_after_settling_and_after_it_was_asked_for",),
        },
    ),
    34: Point(
        "a one-sided approach removes backlash, per axis, optional",
        {
            GUARD: ("test_a_one_sided_approach_comes_to_every_place_from_its_own_side",),
            WIRE: ("test_a_one_sided_approach_removes_the_backlash_of_the_machine",),
        },
        dialects=True,
    ),
}


@lru_cache
def functions(file: str) -> dict[str, ast.FunctionDef]:
    """The tests of a file, by name."""
    tree = ast.parse((TESTS / file).read_text(encoding="utf-8"))
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def runs_on_both_dialects(test: ast.FunctionDef) -> bool:
    return any(
        isinstance(mark, ast.Call)
        and ast.unparse(mark.func) == "pytest.mark.parametrize"
        and ast.literal_eval(mark.args[0]) == "dialect"
        and ast.unparse(mark.args[1]) in DIALECTS
        for mark in test.decorator_list
    )


def marks_of(file: str, test: ast.FunctionDef) -> str:
    """The marks of a test and of its file, as written."""
    tree = ast.parse((TESTS / file).read_text(encoding="utf-8"))
    of_file = [ast.unparse(node) for node in tree.body if isinstance(node, ast.Assign)]
    own = [ast.unparse(mark) for mark in test.decorator_list]
    return " ".join([*own, *(mark for mark in of_file if mark.startswith("pytestmark"))])


def test_every_point_has_its_proofs() -> None:
    assert list(POINTS) == list(range(1, 35))
    assert all(point.proofs and all(point.proofs.values()) for point in POINTS.values())


@pytest.mark.parametrize("number", POINTS)
def test_the_proofs_of_a_point_are_there_and_on_both_dialects_where_it_concerns_them(number: int) -> None:
    point = POINTS[number]
    named = [(file, name) for file, names in point.proofs.items() for name in names]
    missing = [f"{file}::{name}" for file, name in named if name not in functions(file)]
    assert missing == []
    marks = {f"{file}::{name}": marks_of(file, functions(file)[name]) for file, name in named}
    assert [test for test, mark in marks.items() if "skip" in mark or "xfail" in mark] == []
    assert any("soak" not in mark for mark in marks.values())
    if point.dialects:
        assert any(runs_on_both_dialects(functions(file)[name]) for file, name in named)
