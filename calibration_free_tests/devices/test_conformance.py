"""The simple devices, and the real drivers on their emulated wires, keep the contracts of live devices."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from calibration_free_tests.camera.emulated_bench import Bench as CameraBench
from calibration_free_tests.devices.conformance import AxisConformance, CameraConformance, GantryConformance
from calibration_free_tests.gantry.simulated_bench import ALL, name_of
from calibration_free_tests.gantry.simulated_bench import Bench as GantryBench
from calibration_free_tests.servos.workbench import Workbench, pan_settings, zoom_settings
from rig.devices import Clock, LiveAxis, LiveCamera, LiveGantry
from sim_backends.camera_emulator import CameraTiming
from sim_backends.grbl_emulator.dialects import Dialect
from sim_backends.simple_devices import (
    SimpleAxis,
    SimpleAxisSettings,
    SimpleCamera,
    SimpleCameraSettings,
    SimpleGantry,
    SimpleGantrySettings,
)
from sim_backends.simulated_clock import SimulatedClock


class OnSimulatedTime:
    @pytest.fixture
    def clock(self) -> Clock:
        return SimulatedClock()


class TestSimpleGantry(OnSimulatedTime, GantryConformance):
    @pytest.fixture
    def gantry(self, clock: Clock) -> LiveGantry:
        return SimpleGantry(SimpleGantrySettings(), clock)


class TestSimplePan(OnSimulatedTime, AxisConformance):
    here, there = -40.0, 70.0

    @pytest.fixture
    def axis(self, clock: Clock) -> LiveAxis:
        return SimpleAxis(SimpleAxisSettings(), clock)


class TestSimpleZoom(OnSimulatedTime, AxisConformance):
    @pytest.fixture
    def axis(self, clock: Clock) -> LiveAxis:
        return SimpleAxis(SimpleAxisSettings(lower=0.0, upper=1.0, speed_per_s=1.0), clock)


class TestSimpleCamera(OnSimulatedTime, CameraConformance):
    @pytest.fixture
    def camera(self, clock: Clock) -> LiveCamera:
        return SimpleCamera(SimpleCameraSettings(), clock)


class TestGrbl(GantryConformance):
    here, there, outside = (-11.0, -12.0, -13.0), (-40.0, -22.5, -3.25), (1.0, -12.0, -13.0)

    @pytest.fixture(params=ALL, ids=name_of)
    def bench(self, request: pytest.FixtureRequest) -> GantryBench:
        dialect: Dialect = request.param
        return GantryBench(dialect)

    @pytest.fixture
    def gantry(self, bench: GantryBench) -> Iterator[LiveGantry]:
        yield bench.gantry
        bench.gantry.close()
        assert bench.monitor.violations == []

    @pytest.fixture
    def clock(self, bench: GantryBench) -> Clock:
        return bench.clock


class OnAServoBus(AxisConformance):
    mode = "extended"

    @pytest.fixture
    def bench(self) -> Workbench:
        made = Workbench(pan_settings(mode=self.mode), zoom_settings())
        for axis in made.axes:
            # A servo that is new to the bench must be told where it stands, once.
            axis.connect()
            if not axis.status().referenced:
                axis.reference(0.0)
            axis.close()
        return made

    @pytest.fixture
    def clock(self, bench: Workbench) -> Clock:
        return bench.clock


class TestDynamixelPan(OnAServoBus):
    here, there = -40.0, 170.0

    @pytest.fixture
    def axis(self, bench: Workbench) -> Iterator[LiveAxis]:
        yield bench.axes[0]
        bench.axes[0].close()
        assert bench.monitor.violations == []


class TestDynamixelPanByCurrent(TestDynamixelPan):
    mode = "current_based"


class TestDynamixelZoom(OnAServoBus):
    tolerance = 0.002

    @pytest.fixture
    def axis(self, bench: Workbench) -> Iterator[LiveAxis]:
        yield bench.axes[1]
        bench.axes[1].close()
        assert bench.monitor.violations == []


class TestOpenCvCamera(CameraConformance):
    @pytest.fixture(params=[1, 8], ids=["buffer of 1", "buffer of 8"])
    def bench(self, request: pytest.FixtureRequest) -> CameraBench:
        return CameraBench(CameraTiming(buffer_frames=request.param))

    @pytest.fixture
    def camera(self, bench: CameraBench) -> Iterator[LiveCamera]:
        yield bench.camera
        bench.camera.close()

    @pytest.fixture
    def clock(self, bench: CameraBench) -> Clock:
        return bench.clock
