"""A bench file's emulators, driven through the guard on simulated time: the camera sees what the true axes show."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel

from calibration_free_tests.emulation.sample import EXAMPLES, config, make_ready, near, simulated, small, striped
from rig.bench import BenchConfig, LiveBenchFile, load_bench
from rig.emulation import EmulatedBench
from rig.errors import HardwareError, InputError
from rig.guard import State
from rig.hal import RigPose
from sim_backends.camera_faults import CameraFault, CameraFaultKind
from sim_backends.faults import Fault, FaultKind
from sim_backends.grbl_emulator.dialects import GRBLHAL
from sim_backends.simulated_clock import SimulatedClock

PLACE = RigPose(200.0, 120.0, 80.0, 30.0, 0.5)


def test_a_bench_is_homed_moved_and_looked_through_on_simulated_time() -> None:
    bench = simulated()
    with bench.open() as guard:
        assert guard.state is State.ALARM  # a controller that has just been switched on wants to be homed
        make_ready(guard)
        assert guard.state is State.IDLE
        back = guard.move_to(PLACE)
        assert near(back, bench.pose)
        frame = guard.capture()
        noise = frame.image.astype(float) - striped(bench.pose)
        assert np.abs(noise).mean() < 4.0
        guard.jog(dx_mm=5.0)
        assert bench.pose.x_mm == pytest.approx(205.0, abs=0.002)
    assert bench.gantry.monitor is not None
    assert bench.gantry.monitor.violations == []
    assert bench.gantry.monitor.moves_seen > 1
    (bus,) = bench.buses.values()
    assert bus.monitor.violations == []
    assert bus.monitor.goals > 1


def test_the_truth_is_told_through_signs_and_offsets_of_the_bench() -> None:
    as_told = config()
    assert isinstance(as_told.file, LiveBenchFile)
    axes = as_told.file.axes
    axes = axes.model_copy(update={"x_mm": axes.x_mm.model_copy(update={"offset_mm": 410.0})})
    skew = replace(as_told, file=as_told.file.model_copy(update={"axes": axes}))
    bench = simulated(small(skew))
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(PLACE)
    assert near(bench.pose, PLACE)
    # What the controller counts is another place.
    assert abs(bench.gantry.mechanics.position[0] + 400.0 - PLACE.x_mm) > 1.0


def test_a_bench_that_was_left_homed_is_found_homed_by_the_next_process() -> None:
    bench = simulated()
    with bench.open() as guard:
        make_ready(guard)
        guard.move_to(PLACE)
    with bench.open() as guard:
        assert guard.state is State.IDLE
        assert near(guard.pose, PLACE)


def test_an_axis_at_the_end_of_its_travel_keeps_none_of_the_others_from_being_jogged() -> None:
    bench = simulated()
    with bench.open() as guard:
        make_ready(guard)
        for zoom, theta_deg in ((0.0, -60.0), (1.0, 60.0)):
            back = guard.move_to(replace(PLACE, zoom=zoom, theta_deg=theta_deg))
            assert 0.0 <= back.zoom <= 1.0  # an image grid takes no others
            guard.jog(dx_mm=5.0)


def test_a_fault_script_strikes_the_device_that_it_is_for() -> None:
    stuck = Fault(FaultKind.STUCK_AXIS, at_s=20.0, number=0)
    bench = simulated(scripts={"pan": [stuck]})
    with bench.open() as guard:
        make_ready(guard)
        assert bench.clock is not None
        bench.clock.sleep_s(21.0 - bench.clock.now_s())
        with pytest.raises(HardwareError, match="pan"):
            guard.move_to(PLACE)


def test_a_camera_fault_strikes_the_camera() -> None:
    bench = simulated(camera_faults=[CameraFault(CameraFaultKind.BLACK, 20.0)])
    with bench.open() as guard:
        make_ready(guard)
        guard.capture()
        assert bench.clock is not None
        bench.clock.sleep_s(21.0 - bench.clock.now_s())
        with pytest.raises(HardwareError, match="black"):
            guard.capture()


def test_the_controller_may_be_of_another_family() -> None:
    with simulated(dialect=GRBLHAL).open() as guard:
        assert guard.identities["gantry"].kind == "grblHAL"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("bench_*.yaml")), ids=lambda p: p.stem)
def test_every_example_of_a_bench_has_an_emulation(path: Path) -> None:
    bench = simulated(small(load_bench(path)))
    with bench.open() as guard:
        guard.home()
        if "pan" in bench.servos:
            guard.reference("theta_deg", 0.0)
        if "zoom" in bench.servos and guard.state is not State.IDLE:
            guard.reference("zoom", 0.0)
        there = replace(guard.pose, x_mm=guard.pose.x_mm - 20.0, z_mm=guard.pose.z_mm - 10.0)
        guard.move_to(there)
        assert near(bench.pose, there, mm=0.06, deg=0.1, zoom=0.01)
        guard.capture()


def test_a_mock_bench_has_nothing_to_emulate() -> None:
    with pytest.raises(InputError, match="mock bench"):
        simulated(load_bench(EXAMPLES / "mock.yaml"))


def test_a_device_of_another_driver_is_refused_by_name() -> None:
    told = config()
    other = replace(told.devices["pan"], driver="mine", make=object)
    with pytest.raises(InputError, match=r"devices\.pan\.driver: there is no emulator of the driver 'mine'"):
        simulated(replace(told, devices={**told.devices, "pan": other}))


def test_machine_coordinates_that_grbl_cannot_have_are_refused_with_the_axis() -> None:
    told = config()
    gantry = told.devices["gantry"]
    x = gantry.settings.x.model_copy(update={"upper_mm": 10.0})  # type: ignore[attr-defined]  # of the GRBL driver
    settings = gantry.settings.model_copy(update={"x": x})
    upwards: BenchConfig = replace(told, devices={**told.devices, "gantry": replace(gantry, settings=settings)})
    with pytest.raises(InputError, match=r"devices\.gantry\.x: .*-400 \.\. 10"):
        EmulatedBench(upwards, striped, clock=SimulatedClock())


def test_the_full_example_names_every_key_of_a_live_bench_and_of_its_drivers() -> None:
    text = (EXAMPLES / "bench_grbl_dynamixel.yaml").read_text()
    told = load_bench(EXAMPLES / "bench_grbl_dynamixel.yaml")
    assert isinstance(told.file, LiveBenchFile)
    parts: list[BaseModel] = [told.file, told.file.axes, told.file.safety, told.file.views]
    parts += [device.settings for device in told.devices.values()]
    names = {field.alias or name for part in parts for name, field in type(part).model_fields.items()}
    # For cameras that have one: a USB serial number.
    missing = {name for name in names - {"usb_serial"} if not re.search(rf"\b{name}:", text)}
    assert missing == set()
