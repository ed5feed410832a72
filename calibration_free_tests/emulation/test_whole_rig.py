"""What shows only with all devices together and real drivers: what is sent, kept and tried again, and how fast."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.bench_scan_emulated import SCANS, Instant, run
from calibration_free_tests.emulation.sample import config, make_ready, near, simulated
from drivers.dynamixel import DynamixelAxis, DynamixelSettings
from drivers.frame_checks import BadFrameError
from rig.errors import HardwareError, InputError
from rig.guard import State
from rig.hal import RigPose
from rig.scan import Scan, numbered, serpentine
from sim_backends.camera_faults import CameraFault, CameraFaultKind
from sim_backends.faults import Fault, FaultKind
from sim_backends.simulated_clock import SimulatedClock

PLACE = RigPose(200.0, 120.0, 80.0, 30.0, 0.5)


def test_a_device_that_stands_where_it_is_sent_is_asked_and_not_sent_again() -> None:
    bench = simulated()
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(PLACE)
        assert bench.gantry.monitor is not None
        before = bench.gantry.monitor.moves_seen
        guard.move_to(replace(PLACE, theta_deg=10.0))
        assert bench.gantry.monitor.moves_seen == before
        guard.jog(dx_mm=1.0)
        guard.move_to(PLACE)
        assert near(bench.pose, PLACE)
        assert bench.gantry.monitor.moves_seen == before + 2


def test_a_controller_that_restarts_is_not_believed_to_stand_where_it_was_sent() -> None:
    bench = simulated(scripts={"gantry": [Fault(FaultKind.BANNER, at_s=30.0)]})
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(PLACE)
        assert bench.clock is not None
        bench.clock.sleep_s(31.0 - bench.clock.now_s())
        with pytest.raises(HardwareError):
            guard.move_to(PLACE)


def test_servos_that_held_over_the_end_of_a_session_are_driven_in_the_next() -> None:
    bench = simulated()
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(PLACE)
    assert bench.servos["pan"].torque  # torque_at_close: hold
    with bench.open() as guard:
        guard.move_to(replace(PLACE, theta_deg=-20.0))
        assert near(bench.pose, replace(PLACE, theta_deg=-20.0))


def test_a_servo_that_its_watchdog_has_stopped_moves_again_once_unlocked() -> None:
    bench = simulated(scripts={"pan": [Fault(FaultKind.HANG, at_s=30.0, seconds=0.25)]})
    assert bench.clock is not None
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(PLACE)
        bench.clock.sleep_s(29.6 - bench.clock.now_s())
        with pytest.raises(HardwareError, match="pan"):
            guard.move_to(replace(PLACE, theta_deg=-50.0))
        assert guard.state is State.ALARM
        guard.unlock()
        guard.move_to(PLACE)
        assert near(bench.pose, PLACE)


def test_point_26_a_servo_that_ran_hot_is_rebooted_on_request_once_it_is_cool() -> None:
    bench = simulated(scripts={"pan": [Fault(FaultKind.OVERHEAT, at_s=30.0)]})
    assert bench.clock is not None
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(PLACE)
        bench.clock.sleep_s(30.5 - bench.clock.now_s())
        with pytest.raises(HardwareError, match=r"pan: .*overheating.*`rig home --reboot pan`"):
            guard.move_to(replace(PLACE, theta_deg=-20.0))
        assert guard.reboot("theta_deg") is State.ALARM  # still hot
        assert "overheating" in " ".join(guard.glance().troubles)
        bench.servos["pan"].temperature_c = 35.0
        assert guard.reboot("theta_deg") is State.UNHOMED
        assert not bench.servos["pan"].torque
        before = bench.pose
        guard.reference("theta_deg", PLACE.theta_deg)
        assert guard.state is State.IDLE
        assert near(bench.pose, before)
        guard.move_to(replace(PLACE, theta_deg=-20.0))
        assert near(bench.pose, replace(PLACE, theta_deg=-20.0))
    assert all(bus.monitor.violations == [] for bus in bench.buses.values())


def test_a_scan_takes_bad_pictures_of_a_live_camera_again() -> None:
    bench = simulated(camera_faults=[CameraFault(CameraFaultKind.BLACK, 20.0, 3.0)])
    assert bench.clock is not None
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(PLACE)
        bench.clock.sleep_s(20.5 - bench.clock.now_s())
        targets = list(numbered([PLACE]))
        scan = Scan(guard, targets, Instant(), clock=bench.clock, bad_frames=(BadFrameError,), pause_s=3.0)
        assert len(list(scan)) == 1
        assert bench.clock.now_s() > 23.0


def test_servos_of_one_port_share_its_bus_and_need_one_baud_rate() -> None:
    told = [config().devices[role].settings for role in ("pan", "zoom")]
    settings = [one for one in told if isinstance(one, DynamixelSettings)]
    pan, zoom = DynamixelAxis.together(settings, SimulatedClock())
    assert pan.bus is zoom.bus
    other = settings[1].model_copy(update={"baud": 57600})
    with pytest.raises(InputError, match="two baud rates on one port, 1000000 and 57600"):
        DynamixelAxis.together([settings[0], other], SimulatedClock())


def test_a_scan_takes_hardly_longer_than_motion_settling_and_pictures() -> None:
    poses, rate_hz = serpentine(SCANS["3 x 3 x 1 x 3"]), 30.0
    took_s, moved_s, settle_s, picture_s = run(poses, rate_hz)
    assert took_s <= 1.05 * (moved_s + len(poses) * (settle_s + picture_s))
