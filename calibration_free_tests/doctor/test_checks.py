"""Checks on values alone, where an emulated bench does not get to."""

from __future__ import annotations

import pytest

from calibration_free_tests.doctor.sample import HEALTHY_FIRMWARE
from calibration_free_tests.gantry.simulated_bench import settings as gantry_settings
from drivers.camera_locks import Lock
from drivers.camera_settings import CameraSettings
from drivers.dynamixel.settings import ZoomRole, position_at
from drivers.frame_checks import PictureLook
from drivers.grbl_settings import GrblAxis
from rig.doctor import Verdict
from rig.doctor.camera import check_exposure, check_locks, check_rate
from rig.doctor.controller import Controller
from rig.doctor.firmware import CHECKS, check_firmware


def controller(kind: str, firmware: dict[int, float], **changes: object) -> Controller:
    return Controller(kind, firmware, gantry_settings(**changes), (80.0, 80.0, 40.0))


def test_each_check_of_the_firmware_gives_the_line_of_its_name() -> None:
    found = check_firmware(controller("GRBL", dict(HEALTHY_FIRMWARE)))
    assert [finding.what for finding in found] == list(CHECKS)


def test_what_a_controller_does_not_tell_is_left_to_a_person_and_never_passed() -> None:
    found = check_firmware(controller("FluidNC", {}))
    assert [finding.what for finding in found] == list(CHECKS)
    assert {finding.ok for finding in found} == {Verdict.WARN}
    assert all("FluidNC does not tell $" in finding.told for finding in found)


def test_a_machine_that_cannot_home_is_no_fault_where_the_bench_file_says_so() -> None:
    found = CHECKS["homing"](controller("GRBL", {**HEALTHY_FIRMWARE, 22: 0}, homing="none"))
    assert found.ok is Verdict.PASS


@pytest.mark.parametrize(
    ("kind", "firmware", "lower_mm", "upper_mm", "verdict"),
    [
        ("GRBL", {}, 1.0, 398.0, Verdict.FAIL),
        ("GRBL", {23: 1}, -398.0, -1.0, Verdict.PASS),
        ("grblHAL", {22: 9, 23: 1}, 1.0, 398.0, Verdict.PASS),
        ("grblHAL", {22: 9, 23: 1}, -398.0, -1.0, Verdict.FAIL),
        ("grblHAL", {22: 9, 23: 0}, -398.0, -1.0, Verdict.PASS),
        ("FluidNC", {}, 1.0, 398.0, Verdict.PASS),
        ("FluidNC", {}, -200.0, 198.0, Verdict.FAIL),
    ],
)
def test_machine_coordinates_lie_where_the_firmware_puts_its_zero(
    kind: str, firmware: dict[int, float], lower_mm: float, upper_mm: float, verdict: Verdict
) -> None:
    axis = GrblAxis(lower_mm=lower_mm, upper_mm=upper_mm, feed_mm_per_min=5000.0)
    found = CHECKS["travel"](controller(kind, {**HEALTHY_FIRMWARE, **firmware}, x=axis))
    assert found.ok is verdict


def test_other_bits_of_a_setting_are_kept_in_the_remedy() -> None:
    found = CHECKS["homing"](controller("grblHAL", {**HEALTHY_FIRMWARE, 22: 8}))
    assert "`$22=9`" in found.remedy


@pytest.mark.parametrize(
    ("level", "saturated", "verdict"),
    [(200.0, 0.0, Verdict.PASS), (50.0, 0.0, Verdict.WARN), (255.0, 0.2, Verdict.WARN)],
)
def test_pictures_in_which_corners_are_hard_to_see_are_told(level: float, saturated: float, verdict: Verdict) -> None:
    assert check_exposure(PictureLook((64, 48), level / 2, level, saturated, 10.0)).ok is verdict


@pytest.mark.parametrize(
    ("period_s", "wanted_hz", "verdict"),
    [
        (1 / 30, 30.0, Verdict.PASS),
        (1 / 20, 30.0, Verdict.WARN),
        (1 / 20, None, Verdict.PASS),
        (0.5, None, Verdict.WARN),
        (None, 30.0, Verdict.WARN),
    ],
)
def test_frame_rates_are_held_against_what_was_asked(
    period_s: float | None, wanted_hz: float | None, verdict: Verdict
) -> None:
    assert check_rate(period_s, wanted_hz).ok is verdict


def test_a_control_that_the_device_lacks_is_a_fault_only_where_a_value_is_told() -> None:
    lacking = (Lock("focus", held=False, value=None, trouble="the device offers no such control"),)
    source = "/dev/v4l/by-path/pci-0-usb-0:1:1.0-video-index0"
    assert check_locks(lacking, CameraSettings(source=source)).ok is Verdict.PASS
    assert check_locks(lacking, CameraSettings(source=source, focus=3.0)).ok is Verdict.FAIL


def test_what_an_http_camera_does_with_its_exposure_cannot_be_seen_and_is_no_fault() -> None:
    lacking = [Lock(name, False, None, "the device offers no such control") for name in ("exposure", "focus")]
    found = check_locks(lacking, CameraSettings(source="http://camera.local/stream.mjpg", exposure_s=0.01))
    assert found.ok is Verdict.PASS
    assert "set the exposure in the camera itself to 0.01 s" in found.told


def test_an_axis_at_the_end_of_its_travel_reads_as_there_though_no_tick_lies_there() -> None:
    role = ZoomRole(kind="zoom", table=((0.0, -60.0), (1.0, 60.0)))
    end = role.ticks_at(-60.0)
    assert position_at(role, round(end)) == 0.0
    assert position_at(role, end - 5.0) < 0.0
