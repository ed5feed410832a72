"""What every live gantry, axis and camera must do: derive a class and give it the fixtures that it asks for.

A ``gantry``, ``axis`` or ``camera`` fixture gives a device that is not connected, at rest, on the ``clock`` fixture's
clock, and closes it. Positions and tolerances are attributes that a derived class overrides. test_conformance.py
shows how; a driver of your own needs no more than one such class.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.devices import Clock, LiveAxis, LiveCamera, LiveGantry, Motion, Triple
from rig.errors import HardwareError, UnreachableError


class GantryConformance:
    """The contract of `LiveGantry`, machine coordinates."""

    here: Triple = (1.0, 1.0, 1.0)
    there: Triple = (11.0, 6.0, 3.0)
    outside: Triple = (1e6, 1.0, 1.0)
    tolerance_mm = 0.05

    def test_nothing_is_answered_before_connecting(self, gantry: LiveGantry) -> None:
        for ask in (gantry.status, gantry.home, lambda: gantry.move_to(*self.here), gantry.unlock):
            with pytest.raises(HardwareError, match=r"[Cc]onnect"):
                ask()

    def test_connecting_identifies_and_moves_nothing(self, gantry: LiveGantry) -> None:
        identity = gantry.connect()
        assert identity.kind
        assert identity.where
        assert gantry.status().motion in (Motion.IDLE, Motion.ALARM)

    def test_before_homing_there_is_no_position_and_no_move(self, gantry: LiveGantry) -> None:
        gantry.connect()
        status = gantry.status()
        assert not status.homed
        assert status.position_mm is None
        assert status.trouble
        with pytest.raises(HardwareError):
            gantry.move_to(*self.here)

    def test_homing_gives_a_position(self, gantry: LiveGantry, clock: Clock) -> None:
        gantry.connect()
        status = gantry.home()
        assert status.homed
        assert status.position_mm is not None
        assert status.motion is Motion.IDLE
        assert status.read_at_s <= clock.now_s()
        assert not status.trouble

    def test_a_move_ends_where_it_was_told_to_and_is_read_back(self, gantry: LiveGantry) -> None:
        gantry.connect()
        gantry.home()
        for target in (self.here, self.there, self.here):
            assert gantry.move_to(*target) == pytest.approx(target, abs=self.tolerance_mm)
            status = gantry.status()
            assert status.position_mm == pytest.approx(target, abs=self.tolerance_mm)
            assert status.motion is Motion.IDLE

    @pytest.mark.parametrize("value", [math.nan, math.inf])
    def test_what_is_no_number_or_outside_is_refused_and_moves_nothing(self, gantry: LiveGantry, value: float) -> None:
        gantry.connect()
        gantry.home()
        before = gantry.move_to(*self.here)
        for target in ((value, *self.here[1:]), self.outside):
            with pytest.raises(UnreachableError):
                gantry.move_to(*target)
        assert gantry.status().position_mm == pytest.approx(before, abs=self.tolerance_mm)

    def test_a_jog_is_a_step_from_where_it_stands(self, gantry: LiveGantry) -> None:
        gantry.connect()
        gantry.home()
        gantry.move_to(*self.here)
        dx, dy, dz = (b - a for a, b in zip(self.here, self.there, strict=True))
        assert gantry.jog(dx, dy, dz) == pytest.approx(self.there, abs=self.tolerance_mm)
        far = self.outside[0] - self.there[0]
        with pytest.raises(UnreachableError):
            gantry.jog(far, 0.0, 0.0)
        with pytest.raises(UnreachableError):
            gantry.jog(math.nan, 0.0, 0.0)
        assert gantry.status().position_mm == pytest.approx(self.there, abs=self.tolerance_mm)

    def test_what_is_not_locked_may_be_unlocked(self, gantry: LiveGantry) -> None:
        gantry.connect()
        gantry.home()
        status = gantry.unlock()
        assert (status.motion, status.homed) == (Motion.IDLE, True)

    def test_stopping_at_rest_is_confirmed_and_it_goes_on_after_it(self, gantry: LiveGantry) -> None:
        gantry.connect()
        gantry.home()
        report = gantry.stop()
        assert report.sent_at_s is not None
        assert report.confirmed
        assert report.position_kept
        assert gantry.move_to(*self.here) == pytest.approx(self.here, abs=self.tolerance_mm)

    def test_closing_twice_is_no_error_and_connecting_again_works(self, gantry: LiveGantry) -> None:
        gantry.connect()
        gantry.home()
        gantry.close()
        gantry.close()
        with pytest.raises(HardwareError):
            gantry.status()
        gantry.connect()
        assert gantry.status().motion in (Motion.IDLE, Motion.ALARM)

    def test_stopping_what_is_not_connected_never_raises(self, gantry: LiveGantry) -> None:
        gantry.stop()


class AxisConformance:
    """The contract of `LiveAxis`, degrees or zoom settings."""

    here = 0.25
    there = 0.75
    outside = 1e6
    tolerance = 0.15

    def test_nothing_is_answered_before_connecting(self, axis: LiveAxis) -> None:
        with pytest.raises(HardwareError):
            axis.status()

    def test_connecting_and_enabling_move_nothing(self, axis: LiveAxis) -> None:
        assert axis.connect().kind
        before = axis.status()
        assert not before.torque
        assert before.referenced
        assert before.position is not None
        after = axis.enable()
        assert after.torque
        assert after.position == pytest.approx(before.position, abs=self.tolerance)

    def test_nothing_moves_without_torque(self, axis: LiveAxis) -> None:
        axis.connect()
        assert not axis.status().torque
        with pytest.raises(HardwareError):
            axis.move_to(self.here)

    def test_a_move_ends_where_it_was_told_to_and_is_read_back(self, axis: LiveAxis) -> None:
        axis.connect()
        axis.enable()
        for target in (self.here, self.there, self.here):
            assert axis.move_to(target) == pytest.approx(target, abs=self.tolerance)
            status = axis.status()
            assert status.position == pytest.approx(target, abs=self.tolerance)
            assert status.motion is Motion.IDLE

    def test_what_is_no_number_or_outside_is_refused_and_moves_nothing(self, axis: LiveAxis) -> None:
        axis.connect()
        axis.enable()
        before = axis.move_to(self.here)
        for target in (math.nan, math.inf, self.outside):
            with pytest.raises(UnreachableError):
                axis.move_to(target)
        assert axis.status().position == pytest.approx(before, abs=self.tolerance)

    def test_a_rebooted_axis_is_flagged_and_never_driven_until_it_is_told_where_it_stands(self, axis: LiveAxis) -> None:
        axis.connect()
        axis.enable()
        before = axis.move_to(self.here)
        status = axis.reboot()
        assert not status.referenced
        assert status.position is None
        assert status.trouble
        for ask in (axis.enable, lambda: axis.move_to(self.there)):
            with pytest.raises(HardwareError):
                ask()
        assert axis.reference(before).referenced
        axis.enable()
        assert axis.move_to(self.there) == pytest.approx(self.there, abs=self.tolerance)

    def test_stopping_at_rest_is_confirmed(self, axis: LiveAxis) -> None:
        axis.connect()
        axis.enable()
        report = axis.stop()
        assert report.sent_at_s is not None
        assert report.confirmed
        assert report.position_kept

    def test_closing_twice_is_no_error_and_connecting_again_works(self, axis: LiveAxis) -> None:
        axis.connect()
        axis.close()
        axis.close()
        axis.connect()


class CameraConformance:
    """The contract of `LiveCamera`."""

    def test_nothing_is_captured_before_connecting(self, camera: LiveCamera, clock: Clock) -> None:
        with pytest.raises(HardwareError):
            camera.capture(clock.now_s())

    def test_a_picture_was_exposed_after_it_was_asked_for(self, camera: LiveCamera, clock: Clock) -> None:
        camera.connect()
        sequence = -1
        for _ in range(5):
            asked_s = clock.now_s()
            picture = camera.capture(asked_s)
            assert asked_s < picture.exposed_at_s <= clock.now_s()
            assert picture.sequence > sequence
            sequence = picture.sequence
            assert picture.image.dtype == np.uint8
            assert picture.image.ndim == 2 or picture.image.shape[2] == 3

    def test_a_picture_of_the_future_is_waited_for(self, camera: LiveCamera, clock: Clock) -> None:
        camera.connect()
        after_s = clock.now_s() + 0.5
        assert camera.capture(after_s).exposed_at_s > after_s

    def test_the_latest_picture_is_there_for_previews(self, camera: LiveCamera, clock: Clock) -> None:
        camera.connect()
        captured = camera.capture(clock.now_s())
        latest = camera.latest()
        assert latest is not None
        assert latest.sequence >= captured.sequence

    def test_closing_twice_is_no_error_and_connecting_again_works(self, camera: LiveCamera, clock: Clock) -> None:
        camera.connect()
        camera.close()
        camera.close()
        camera.connect()
        camera.capture(clock.now_s())
