"""Scans on the whole emulated bench while faults strike: what a person does about each, and what a judge sees.

A fault may end a scan; the person then reconnects, unlocks, homes and says where the pan stands, as the errors ask for,
and goes on with the poses that are missing. A stuck carriage is left out: a controller without feedback cannot show it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from calibration_free_tests.emulation.sample import config, small, striped
from drivers.frame_checks import BadFrameError
from rig.bench import BenchConfig
from rig.emulation import EmulatedBench
from rig.errors import RigError
from rig.guard import State
from rig.hal import Frame, RigPose
from rig.imagegrid import GridFrame
from rig.scan import Scan, numbered
from sim_backends.camera_faults import CameraFault, CameraFaultKind
from sim_backends.faults import WIRE_KINDS, FaultKind, random_script
from sim_backends.frame_counter import read_counter
from sim_backends.grbl_emulator.dialects import GRBL_1_1, GRBLHAL
from sim_backends.simulated_clock import SimulatedClock

# Faults of the wire come oftener: most of the others end a scan, and then there is little to be judged.
WIRE = sorted(WIRE_KINDS, key=list(FaultKind).index) * 4
GANTRY_KINDS = [*WIRE, FaultKind.BANNER, FaultKind.ALARM, FaultKind.UNPLUG, FaultKind.HANG, FaultKind.POWER_CYCLE]
SERVO_KINDS = [*WIRE, FaultKind.UNPLUG, FaultKind.HANG, FaultKind.STUCK_AXIS, FaultKind.OVERHEAT, FaultKind.POWER_CYCLE]
CAMERA_KINDS = list(CameraFaultKind)
POSES = [
    RigPose(x, y, z, theta, zoom)
    for z, y, x, theta, zoom in product((60.0, 90.0), (80.0, 120.0), (150.0, 190.0), (-20.0, 5.0), (0.0, 0.6))
]
QUIET_S = 40.0
"""Nothing strikes before the bench has been made ready for the first time."""
COUNTER_PX = 4
SCAN_S = 1200.0
"""No scan may take longer: some 30 pictures, each of which may be waited for to the camera's deadline, three times."""
COMMAND_S = 260.0
"""No command may: homing's deadline, a time-out or two of each device, and a STOP that is not answered."""
TRIES = 400


@dataclass
class Tally:
    """What a run came to; the worst errors of the poses that were stored, against the truth while exposing."""

    faults: int = 0
    frames: int = 0
    scans: int = 0
    ended_early: int = 0
    worst_mm: float = 0.0
    worst_deg: float = 0.0
    worst_zoom: float = 0.0
    longest_scan_s: float = 0.0
    longest_command_s: float = 0.0
    forbidden: list[str] = field(default_factory=list)
    seconds: float = 0.0


class JudgingStore:
    """A `rig.scan.FrameStore` that looks up when each picture was really exposed, and where."""

    def __init__(self, bench: EmulatedBench, tally: Tally) -> None:
        self._bench, self._tally = bench, tally
        self._in_hand: GridFrame | None = None
        self.files: set[str] = set()

    def put(self, frame: Frame, file: str) -> None:
        counter = read_counter(frame.image, COUNTER_PX)
        assert counter is not None, f"{file} shows no frame of the camera's"
        exposure = self._bench.camera.exposure_of(counter)
        assert exposure.ended_at is not None
        for true in (exposure.began_at, exposure.ended_at):
            self._judge(frame.rig_pose, true)
        self._tally.frames += 1
        self.files.add(file)
        self._in_hand = GridFrame(frame.rig_pose, file, "")

    def collect(self) -> GridFrame | None:
        stored, self._in_hand = self._in_hand, None
        return stored

    def _judge(self, told: RigPose, true: RigPose) -> None:
        tally = self._tally
        off_mm = max(abs(told.x_mm - true.x_mm), abs(told.y_mm - true.y_mm), abs(told.z_mm - true.z_mm))
        tally.worst_mm = max(tally.worst_mm, off_mm)
        tally.worst_deg = max(tally.worst_deg, abs(told.theta_deg - true.theta_deg))
        tally.worst_zoom = max(tally.worst_zoom, abs(told.zoom - true.zoom))


class Person:
    """Scans over and over until all faults have struck, and puts the bench in order again after each."""

    def __init__(self, seed: int, *, faults: int, every_s: float) -> None:
        """A third of the faults strikes the servos' bus; beside them the camera has faults of its own.

        Args:
            seed: of everything.
            faults: on the serial lines.
            every_s: mean time between them.
        """
        rng = np.random.default_rng(seed)
        times = QUIET_S + np.cumsum(rng.exponential(every_s, faults))
        on_bus = rng.random(faults) < 1 / 3
        scripts = {
            "gantry": random_script(rng, list(times[~on_bus]), GANTRY_KINDS),
            "pan": random_script(rng, list(times[on_bus]), SERVO_KINDS),
        }
        camera = _camera_faults(rng, float(times[-1]), 40.0 * every_s)
        self.last_s = float(times[-1])
        self.bench = EmulatedBench(
            unhurried(small(config())),
            striped,
            clock=SimulatedClock(),
            scripts=scripts,
            camera_faults=camera,
            counter_px=COUNTER_PX,
            dialect=GRBL_1_1 if seed % 2 else GRBLHAL,
            start_delay_s=float(rng.choice([0.0, 0.02])),
            seed=seed,
        )
        self.guard = self.bench.open()
        self.tally = Tally()

    @property
    def _now_s(self) -> float:
        assert self.bench.clock is not None
        return self.bench.clock.now_s()

    def work(self) -> Tally:
        """Scan until the last fault has struck; returns what it came to."""
        while self._now_s < self.last_s:
            store, begun = JudgingStore(self.bench, self.tally), self.tally.scans
            while len(store.files) < len(POSES) and self._now_s < self.last_s:
                self._put_in_order()
                self._scan(store)
            assert self.tally.scans > begun
        with suppress(RigError):
            self.guard.close()
        monitor = self.bench.gantry.monitor
        assert monitor is not None
        self.tally.forbidden += [f"{v.at_s:.3f} s: {v.what}: {v.line}" for v in monitor.blamed_on_host]
        self.tally.forbidden += [line for bus in self.bench.buses.values() for line in bus.monitor.violations]
        self.tally.faults = sum(len(line.wire.fired) for line in self.bench.lines.values())
        self.tally.seconds = self._now_s
        return self.tally

    def _scan(self, store: JudgingStore) -> None:
        assert self.bench.clock is not None
        missing = [target for target in numbered(POSES) if target.file not in store.files]
        scan = Scan(self.guard, missing, store, clock=self.bench.clock, bad_frames=(BadFrameError,))
        began_s = self._now_s
        self.tally.scans += 1
        try:
            for _ in scan:
                pass
        except RigError as error:
            self.tally.ended_early += 1
            store.collect()
            if "onnect again" in str(error):
                with suppress(RigError):
                    self.guard.close()
        took_s = self._now_s - began_s
        assert took_s <= SCAN_S
        self.tally.longest_scan_s = max(self.tally.longest_scan_s, took_s)

    def _put_in_order(self) -> None:
        """Whatever is wrong, as far as a person can right it."""
        for _ in range(TRIES):
            if self._try(self._righted):
                return
            assert self.bench.clock is not None
            self.bench.clock.sleep_s(0.5)
        raise AssertionError(f"the bench did not become usable again: {self.guard.status()}")

    def _righted(self) -> bool:
        guard = self.guard
        self._cool_servos()
        guard.status()
        steps: dict[State, Callable[[], object]] = {
            State.STOPPED: guard.release,
            State.HELD: guard.resume,
            State.DISCONNECTED: self._connect,
            State.ALARM: self._leave_alarm,
            State.UNHOMED: self._find_place,
        }
        if guard.state is State.IDLE:
            return True
        steps[guard.state]()
        return guard.state is State.IDLE

    def _connect(self) -> None:
        try:
            self.guard.connect()
        except RigError:
            # As the error says: a controller that has met a limit answers nothing before it is reset, as by a STOP.
            self.guard.stop()
            raise

    def _leave_alarm(self) -> None:
        try:
            self.guard.unlock()
        except RigError:
            # As the errors say: an alarm that lost the position asks for homing, one that cannot be left for a STOP.
            try:
                self.guard.home()
            except RigError:
                self.guard.stop()
                raise

    def _find_place(self) -> None:
        status = self.guard.status().rig
        assert status is not None
        if status.gantry is not None and not (status.gantry.homed and self.guard._watch.homed):
            self.guard.home()
        for axis, at in status.axes.items():
            if not at.referenced:
                limit = getattr(self.guard.rules.travel, axis)
                self.guard.reference(axis, min(max(getattr(self.bench.pose, axis), limit.lower), limit.upper))

    def _cool_servos(self) -> None:
        """A servo that has latched an error is left to cool, and switched off and on."""
        for servo in self.bench.servos.values():
            if servo.error_bits:
                servo.temperature_c = 30.0
                servo.power_cycle(self._now_s, 0.5)

    def _try(self, action: Callable[[], bool]) -> bool:
        began_s = self._now_s
        try:
            return action()
        except RigError:
            return False
        finally:
            self.tally.longest_command_s = max(self.tally.longest_command_s, self._now_s - began_s)
            assert self._now_s - began_s <= COMMAND_S


def unhurried(of: BenchConfig) -> BenchConfig:
    """The bench with servos that are asked less often while they move: many hours are simulated."""
    asked = {
        role: replace(of.devices[role], settings=of.devices[role].settings.model_copy(update={"poll_s": 0.1}))
        for role in ("pan", "zoom")
    }
    return replace(of, devices={**of.devices, **asked})


def _camera_faults(rng: np.random.Generator, until_s: float, every_s: float) -> list[CameraFault]:
    times = np.cumsum(rng.exponential(every_s, max(1, int(until_s / every_s)))) + QUIET_S
    return [
        CameraFault(CAMERA_KINDS[int(rng.integers(len(CAMERA_KINDS)))], float(at_s), float(rng.choice([0.2, 1.0, 4.0])))
        for at_s in times
    ]


def check(tally: Tally) -> None:
    """The three invariants; that every run ends within its bound, the person has looked after."""
    assert tally.forbidden == []
    assert tally.worst_mm <= 0.05
    assert tally.worst_deg <= 0.1
