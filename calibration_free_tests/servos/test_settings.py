"""What a bench file may say of a servo, and how positions become ticks."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from calibration_free_tests.servos.workbench import pan_settings, zoom_settings
from drivers.dynamixel import DynamixelAxis, DynamixelSettings
from drivers.dynamixel.table import MOST_TURNS, ServoState, note_of, parse_state
from sim_backends.simulated_clock import SimulatedClock


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"model": "AX-12"}, "is none of XL330"),
        ({"baud": 12345}, "baud 12345 is none of"),
        ({"id": 254}, "less than or equal to 252"),
        ({"watchdog_ms": 150}, "multiple of 20"),
        ({"model": "XL430-W250", "mode": "current_based"}, "measures no current"),
        ({"current_limit_ma": 100.0}, "acts in mode current_based only"),
        ({"mode": "position"}, "use mode extended"),
        ({"tolerance_deg": 0.04}, "finer than half a tick"),
        ({"speed_deg_per_s": 1.0}, "speed_deg_per_s should be 1.37 or more"),
        ({"acceleration_deg_per_s2": 20.0}, "acceleration_deg_per_s2 should be 21.5 or more"),
        ({"role": {"lower_deg": 10.0, "upper_deg": 10.0}}, "should be below upper_deg"),
        ({"role": {"upper_deg": float("nan")}}, "finite"),
        ({"role": {"kind": "tilt"}}, "'pan', 'zoom'"),
        ({"role": {"sign": 2}}, "1 or -1"),
        ({"speed": 3.0}, "Extra inputs"),
        ({"id": "1"}, "valid integer"),
    ],
)
def test_settings_that_cannot_be_are_refused_with_what_is_wrong(changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        pan_settings(**changes)


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        (((0.0, 0.0),), "at least 2"),
        (((0.0, 0.0), (0.9, 10.0)), "should rise from 0 to 1"),
        (((0.0, 0.0), (0.5, 5.0), (0.5, 6.0), (1.0, 9.0)), "should rise from 0 to 1"),
        (((0.0, 0.0), (0.5, 5.0), (1.0, 4.0)), "should all rise or all fall"),
    ],
)
def test_a_zoom_table_must_be_monotone_from_end_to_end(table: Any, complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        zoom_settings(role={"table": table})


def test_settings_are_read_from_json_as_from_a_bench_file() -> None:
    settings = zoom_settings()
    assert DynamixelSettings.model_validate_json(settings.model_dump_json()) == settings


falling = ((0.0, 200.0), (0.3, 150.0), (1.0, -40.0))


@given(st.floats(0.0, 1.0), st.booleans())
def test_zoom_and_ring_angle_are_inverse(zoom: float, falls: bool) -> None:
    role = zoom_settings(mode="extended", role={"table": falling} if falls else {}).role
    assert role.to_position(role.to_angle_deg(zoom)) == pytest.approx(zoom, abs=1e-12)


def test_zoom_settings_between_entries_lie_on_straight_lines() -> None:
    role = zoom_settings().role
    assert [role.to_angle_deg(zoom) for zoom in (0.0, 0.125, 0.25, 0.7, 0.85, 1.0)] == [
        0.0,
        15.0,
        30.0,
        60.0,
        90.0,
        120.0,
    ]
    assert role.to_position(-30.0) == -0.25  # a ring that was turned too far by hand shows it


@given(st.floats(-300.0, 300.0), st.sampled_from([1, -1]), st.floats(0.5, 20.0))
def test_pan_angle_and_ticks_are_inverse(angle_deg: float, sign: int, gear_ratio: float) -> None:
    role = pan_settings(role={"sign": sign, "gear_ratio": gear_ratio}).role
    ticks = role.ticks_at(angle_deg)
    assert role.angle_deg_at(ticks) == pytest.approx(angle_deg, abs=1e-9)
    assert ticks == pytest.approx(2048 + sign * gear_ratio * angle_deg * 4096 / 360)


def state_with_note(note: int) -> ServoState:
    return parse_state(bytes(104) + note.to_bytes(6, "little"))


@given(st.integers(-MOST_TURNS, MOST_TURNS))
def test_a_note_tells_its_turns_in_addresses_that_every_servo_takes(turns: int) -> None:
    note = note_of(turns)
    assert state_with_note(note).turns == turns
    words = [note >> shift & 0xFFFF for shift in (0, 16, 32)]
    assert all(64 <= word <= 227 for word in words)


@pytest.mark.parametrize("words", [(224, 225, 226), (208, 209, 210), (0, 0, 0), (120, 97, 96)])
def test_what_a_servo_holds_at_power_up_is_no_note(words: tuple[int, int, int]) -> None:
    assert state_with_note(words[0] | words[1] << 16 | words[2] << 32).turns is None


def test_an_axis_reads_as_at_its_end_by_a_tick_at_most() -> None:
    """However wide its own tolerance: what stands beyond must not read as within."""
    axis = DynamixelAxis(pan_settings(port="none", tolerance_deg=2.0), SimulatedClock())
    role = axis.settings.role
    end = role.ticks_at(role.to_angle_deg(role.upper))
    outward = math.copysign(1.0, end - role.ticks_at(role.to_angle_deg(role.lower)))
    assert axis._position(end + 0.9 * outward) == role.upper
    for beyond in (1.1, 10.0, 20.0):
        assert axis._position(end + beyond * outward) > role.upper
