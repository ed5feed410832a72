"""Faults that a bench may have, how each is planted in the emulated one, and what the doctor has to say of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from calibration_free_tests.camera.test_identity import BY_PATH, Computer
from calibration_free_tests.doctor.sample import BUS_PORT, GANTRY_PORT, HeldElsewhere, Workbench
from drivers.camera_identity import find_camera
from drivers.serial_ports import resolve_port
from rig.doctor import DiskLook, Finding, Verdict
from rig.errors import InputError
from rig.runtime import FileLatch
from sim_backends.camera_emulator import CameraTiming
from sim_backends.camera_faults import CameraFault, CameraFaultKind
from sim_backends.dynamixel_emulator import table
from sim_backends.dynamixel_emulator.servo import OVERLOAD
from sim_backends.faults import Fault, FaultKind
from sim_backends.grbl_emulator.dialects import FLUIDNC, GRBL_1_1, GRBLHAL, Dialect

FAIL, WARN = Verdict.FAIL, Verdict.WARN
Plant = Callable[[Workbench], Mapping[str, Any] | None]


@dataclass(frozen=True)
class Planted:
    """A fault.

    Attributes:
        name: in words.
        line: subject and what of the line that has to name it.
        verdict: of that line.
        told, remedy: what that line has to say, in part.
        plant: changes the bench; may return changes of the `rig.doctor.Surroundings`.
        built: what the bench is built with.
        dialects: firmwares on which it is planted.
        besides: lines that rightly complain of it as well.
    """

    name: str
    line: tuple[str, str]
    verdict: Verdict
    told: str
    remedy: str
    plant: Plant = lambda bench: None
    built: Mapping[str, Any] | None = None
    dialects: tuple[Dialect, ...] = (GRBL_1_1,)
    besides: frozenset[tuple[str, str]] = frozenset()

    def findings(self, folder: Path, dialect: Dialect) -> list[Finding]:
        """What the doctor says of a bench that has it."""
        bench = Workbench(folder, dialect, **(self.built or {}))
        changes = self.plant(bench) or {}
        with bench.untouched():
            return bench.findings(**changes)

    def named(self, findings: list[Finding]) -> bool:
        """Its line says what is wrong, as badly as it is."""
        return any(f.ok is self.verdict and self.told in f.told for f in self._lines(findings))

    def remedied(self, findings: list[Finding]) -> bool:
        """Its line says what to do about it."""
        return any(self.remedy in f.remedy for f in self._lines(findings))

    def false_alarms(self, findings: list[Finding]) -> list[Finding]:
        """Lines that complain though nothing is wrong there."""
        expected = {self.line, *self.besides}
        return [f for f in findings if f.ok in (FAIL, WARN) and (f.subject, f.what) not in expected]

    def _lines(self, findings: list[Finding]) -> list[Finding]:
        return [f for f in findings if (f.subject, f.what) == self.line]


def _file(*path: str, value: Any) -> Plant:
    """Say something else in the bench file."""

    def plant(bench: Workbench) -> None:
        entry = bench.file
        for key in path[:-1]:
            entry = entry[key]
        entry[path[-1]] = value

    return plant


def _register(register: table.Register, value: int) -> Plant:
    """Set a register of the pan servo."""

    def plant(bench: Workbench) -> None:
        bench.pan.memory[register] = value

    return plant


def _attribute(what: Callable[[Workbench], Any], **values: Any) -> Plant:
    def plant(bench: Workbench) -> None:
        for name, value in values.items():
            setattr(what(bench), name, value)

    return plant


def _missing(bench: Workbench) -> Mapping[str, Any]:
    return {"find_port": lambda name: resolve_port(name) if name == GANTRY_PORT else name}


def _swapped(bench: Workbench) -> None:
    bench.file["devices"]["gantry"]["port"] = BUS_PORT
    for role in ("pan", "zoom"):
        bench.file["devices"][role]["port"] = GANTRY_PORT
        bench.file["devices"][role]["baud"] = 115200


def _emergency_stop(bench: Workbench) -> None:
    bench.machine.apply_fault(Fault(FaultKind.ALARM, at_s=0.0, number=10))


def _torque_left_on(bench: Workbench) -> None:
    bench.pan.write(table.TORQUE.address, b"\x01")


def _turned_too_far(bench: Workbench) -> None:
    bench.reference(bench.pan)
    bench.pan.turn_by_hand(1500)


def _unreadable(bench: Workbench) -> None:
    bench.pan.memory[table.RETURN_LEVEL] = 0


def _another_camera(bench: Workbench) -> Mapping[str, Any]:
    computer = Computer(bench.folder / "computer")
    computer.plug(1, usb_id="046d:0825")
    bench.file["devices"]["camera"] |= {"source": BY_PATH.format(1, 0), "usb_id": "046d:0826"}
    return {"find_camera": lambda settings: find_camera(settings, computer.root)}


def _latched(bench: Workbench) -> None:
    from rig.bench import load_bench

    FileLatch(bench.world.runtime() / f"{load_bench(bench.bench_file).key}.stopped").set("by somebody")


def _not_private(bench: Workbench) -> Mapping[str, Any]:
    def runtime() -> Path:
        raise InputError("the runtime folder is not private", where="/tmp/rig-0", remedy="Remove it, or set another")

    return {"runtime": runtime}


def _disk(free_bytes: float, bytes_per_s: float) -> Plant:
    return lambda bench: {"disk": lambda folder: DiskLook(int(free_bytes), bytes_per_s)}


def _no_disk(bench: Workbench) -> Mapping[str, Any]:
    def disk(folder: Path) -> DiskLook:
        raise OSError(30, "Read-only file system")

    return {"disk": disk}


BOTH, ALL = (GRBL_1_1, GRBLHAL), (GRBL_1_1, GRBLHAL, FLUIDNC)
FAULTS = [
    Planted(
        "the gantry is not plugged in", ("gantry", "port"), FAIL, "no such port", "Check cable and power", _missing
    ),
    Planted(
        "no permission for the port",
        ("gantry", "permission"),
        FAIL,
        "permission denied",
        "sudo usermod -aG",
        lambda bench: {"may_use": lambda device: device != GANTRY_PORT},
    ),
    Planted(
        "another process uses the servos",
        ("pan", "in use"),
        FAIL,
        "in use by process 4711",
        "Stop that process",
        lambda bench: {"refuse_held": HeldElsewhere({BUS_PORT: "4711"})},
        besides=frozenset({("zoom", "in use")}),
    ),
    Planted(
        "one port for two devices",
        ("gantry", "port"),
        FAIL,
        "the port of the",
        "Give each its own port",
        _file("devices", "gantry", "port", value=BUS_PORT),
        besides=frozenset({("pan", "port"), ("zoom", "port")}),
    ),
    Planted(
        "gantry and servo ports swapped",
        ("pan", "answers"),
        FAIL,
        "GRBL 1.1h.20190825 answers on",
        "Swap the ports of gantry and pan",
        _swapped,
        besides=frozenset({("gantry", "firmware"), ("zoom", "answers")}),
    ),
    Planted(
        "another baud rate of the gantry",
        ("gantry", "firmware"),
        FAIL,
        "answers at 115200 baud, not at 9600",
        "Set devices.gantry.baud to 115200",
        _file("devices", "gantry", "baud", value=9600),
        dialects=ALL,
    ),
    Planted(
        "the gantry's controller has no power",
        ("gantry", "firmware"),
        FAIL,
        "nothing answers",
        "Check that the controller has power",
        lambda bench: bench.machine.apply_fault(Fault(FaultKind.HANG, at_s=0.0)),
    ),
    Planted(
        "the emergency stop is pressed",
        ("gantry", "state"),
        FAIL,
        "ALARM:10: the emergency stop is pressed",
        "Clear the cause",
        _emergency_stop,
        dialects=(GRBLHAL,),
    ),
    Planted(
        "homing is off",
        ("gantry", "homing"),
        FAIL,
        "off ($22=0)",
        "send `$22=1`",
        built={"firmware": {22: 0}},
        dialects=BOTH,
    ),
    Planted(
        "homing is off in FluidNC",
        ("gantry", "homing"),
        FAIL,
        "off ($22=0)",
        "homing: cycle of each axis in the controller's config.yaml",
        built={"firmware": {22: 0}},
        dialects=(FLUIDNC,),
    ),
    Planted(
        "homing takes longer than it is given",
        ("gantry", "homing"),
        FAIL,
        "may take 270 s",
        "Set deadlines.home_s to 324",
        built={"firmware": {25: 300}},
    ),
    Planted(
        "soft limits are off",
        ("gantry", "soft limits"),
        WARN,
        "off ($20=0)",
        "Send `$20=1`",
        built={"firmware": {20: 0}},
        dialects=BOTH,
    ),
    Planted(
        "hard limits are off",
        ("gantry", "hard limits"),
        WARN,
        "off ($21=0)",
        "send `$21=1`",
        built={"firmware": {21: 0}},
        dialects=BOTH,
    ),
    Planted(
        "the firmware's travel is shorter than the bench file's",
        ("gantry", "travel"),
        FAIL,
        "mm ($130=200)",
        "Keep devices.gantry.x within -200 .. 0",
        built={"firmware": {130: 200}},
        dialects=ALL,
    ),
    Planted(
        "homing ends on the switches",
        ("gantry", "limit switches"),
        FAIL,
        "0 mm off the switches ($27)",
        "Send `$27=2`",
        built={"firmware": {27: 0}},
    ),
    Planted(
        "the firmware is slower than the bench file",
        ("gantry", "speed"),
        WARN,
        "the firmware allows 500 ($110)",
        "Set devices.gantry.x.feed_mm_per_min to 500",
        built={"firmware": {110: 500}},
        dialects=ALL,
    ),
    Planted(
        "the acceleration is still the factory's",
        ("gantry", "acceleration"),
        FAIL,
        "x takes 8.3 s to stop",
        "Send `$120=167`",
        built={"firmware": {120: 10}},
    ),
    Planted(
        "steps per mm cannot be right",
        ("gantry", "steps"),
        FAIL,
        "$102=5 steps/mm",
        "send `$102=the true steps per mm`",
        built={"firmware": {102: 5}},
    ),
    Planted(
        "status reports in inches",
        ("gantry", "status reports"),
        WARN,
        "in inches ($13=1)",
        "Send `$13=0`",
        built={"firmware": {13: 1}},
        dialects=BOTH,
    ),
    Planted(
        "status reports of work coordinates",
        ("gantry", "status reports"),
        WARN,
        "work coordinates ($10=0)",
        "Send `$10=1`",
        built={"firmware": {10: 0}},
        dialects=BOTH,
    ),
    Planted(
        "the motors let go at rest",
        ("gantry", "holding at rest"),
        WARN,
        "let go 25 ms after a move ($1)",
        "Send `$1=255`",
        built={"firmware": {1: 25}},
    ),
    Planted(
        "limits of rig frame and gantry disagree",
        ("bench file", "limits"),
        FAIL,
        "axes.x_mm reaches -498.0 .. -101.0",
        "correct its sign and offset_mm",
        _file("axes", "x_mm", "offset_mm", value=500.0),
    ),
    Planted(
        "the pan's limits disagree",
        ("bench file", "pan limits"),
        FAIL,
        "axes.theta_deg reaches -150.0 .. 90.0",
        "Narrow axes.theta_deg",
        _file("axes", "theta_deg", "lower", value=-150.0),
    ),
    Planted(
        "long jogs before homing",
        ("bench file", "before homing"),
        WARN,
        "jogs of 50 mm",
        "Set safety.unhomed_jog_mm",
        _file("safety", "unhomed_jog_mm", value=50.0),
    ),
    Planted(
        "a place is believed as found",
        ("bench file", "before homing"),
        WARN,
        "as_found believes",
        "Set safety.homing to each_session",
        _file("safety", "homing", value="as_found"),
    ),
    Planted(
        "an axis may press its switch",
        ("gantry", "limit switches"),
        WARN,
        "x may go to 0.1 mm from its switch",
        "Keep devices.gantry.x.upper_mm",
        _file("devices", "gantry", "x", "upper_mm", value=-0.1),
    ),
    Planted(
        "times are estimated too short",
        ("gantry", "speed"),
        WARN,
        "axes.x_mm.speed_mm_per_s is 100",
        "Set axes.x_mm.speed_mm_per_s to 83.3",
        _file("axes", "x_mm", "speed_mm_per_s", value=100.0),
    ),
    Planted(
        "more steps a second than GRBL manages",
        ("gantry", "steps"),
        WARN,
        "33333 steps/s",
        "use coarser microsteps",
        built={"firmware": {100: 400}},
    ),
    Planted(
        "a servo that does not answer to writes",
        ("pan", "kept settings"),
        FAIL,
        "its status return level is 1",
        "Set it to 2",
        _register(table.RETURN_LEVEL, 1),
    ),
    Planted(
        "no keep-out box",
        ("bench file", "keep-out"),
        WARN,
        "nothing but the axes' limits",
        "safety.keep_out",
        _file("safety", value={}),
    ),
    Planted(
        "another id than the servo's",
        ("pan", "answers"),
        FAIL,
        "nobody has the id 7; there is id 1 (XM430-W350)",
        "Set devices.pan.id",
        _file("devices", "pan", "id", value=7),
    ),
    Planted(
        "another baud rate of the servos",
        ("pan", "answers"),
        FAIL,
        "answers at 57600 baud, not at 1000000",
        "Set devices.pan.baud to 57600",
        _register(table.BAUD_CODE, table.BAUD_RATES.index(57600)),
    ),
    Planted(
        "another model than the bench file's",
        ("pan", "model"),
        FAIL,
        "is a XM430-W350, and the bench file says XL430-W250",
        "set devices.pan.model",
        _file("devices", "pan", "model", value="XL430-W250"),
        besides=frozenset({("pan", "voltage")}),
    ),
    Planted(
        "a servo in another operating mode",
        ("pan", "operating mode"),
        FAIL,
        "its operating mode is 3, and extended is 4",
        "with DYNAMIXEL Wizard, or change mode",
        _register(table.OPERATING_MODE, table.POSITION),
    ),
    Planted(
        "a homing offset in a servo",
        ("pan", "kept settings"),
        FAIL,
        "its homing offset is 300",
        "use zero_ticks",
        _register(table.HOMING_OFFSET, 300),
    ),
    Planted(
        "a servo that answers pings alone",
        ("pan", "answers"),
        FAIL,
        "answers pings, but not reads",
        "status return level (address 68) to 2",
        _unreadable,
    ),
    Planted(
        "a servo's own limit is narrower than the travel",
        ("zoom", "limits"),
        FAIL,
        "limits its position to 0 .. 3000 ticks, and the travel is 2048 .. 3413",
        "widen the servo's limits",
        lambda bench: bench.zoom.memory.__setitem__(table.MAX_POSITION, 3000),
    ),
    Planted(
        "a servo's velocity limit is below the speed",
        ("pan", "limits"),
        FAIL,
        "allows 14",
        "Set devices.pan.speed_deg_per_s to 14 or less",
        _register(table.VELOCITY_LIMIT, 10),
    ),
    Planted(
        "a servo is overloaded",
        ("pan", "hardware error"),
        FAIL,
        "reports overload",
        "Remove the cause, then reboot it",
        lambda bench: bench.pan.fail(OVERLOAD),
    ),
    Planted(
        "the servos' supply is too weak",
        ("pan", "voltage"),
        WARN,
        "9.5 V",
        "Check the power supply",
        _attribute(lambda bench: bench.pan, voltage_v=9.5),
    ),
    Planted(
        "a servo is nearly too hot",
        ("pan", "temperature"),
        WARN,
        "75 °C",
        "Let it cool",
        _attribute(lambda bench: bench.pan, temperature_c=75.0),
    ),
    Planted(
        "a servo does not protect itself",
        ("pan", "overload"),
        WARN,
        "its shutdown register is 0",
        "Set the shutdown register (address 63) to 52",
        _register(table.SHUTDOWN, 0),
    ),
    Planted(
        "torque was left on", ("pan", "torque"), WARN, "on, though nobody uses the bench", "rig status", _torque_left_on
    ),
    Planted(
        "the pan stands outside its travel",
        ("pan", "position"),
        WARN,
        "outside its travel -100 .. 100",
        "Turn it back by hand",
        _turned_too_far,
    ),
    Planted(
        "the adapter's latency timer is long",
        ("pan", "answer time"),
        WARN,
        "latency timer 200 ms",
        "lower latency_timer_ms",
        _attribute(lambda bench: bench, latency_ms=200),
        besides=frozenset({("zoom", "answer time")}),
    ),
    Planted(
        "another camera is plugged in",
        ("camera", "identity"),
        FAIL,
        "another camera is plugged in here: usb_id is 046d:0825, not 046d:0826",
        "Plug the bench's camera in here",
        _another_camera,
    ),
    Planted(
        "the camera gives nothing",
        ("camera", "pictures"),
        FAIL,
        "the first picture has not come",
        "Close other programs that use the camera",
        built={"camera_faults": (CameraFault(CameraFaultKind.HANG, 0.0),)},
    ),
    Planted(
        "the lens is covered",
        ("camera", "exposure"),
        FAIL,
        "the last is black",
        "Is the lens covered",
        built={"camera_faults": (CameraFault(CameraFaultKind.BLACK, 0.0),)},
    ),
    Planted(
        "the picture is over-exposed",
        ("camera", "exposure"),
        FAIL,
        "the last is over-exposed",
        "Shorten exposure_s",
        built={"camera_faults": (CameraFault(CameraFaultKind.OVER_EXPOSED, 0.0),)},
    ),
    Planted(
        "the camera is frozen",
        ("camera", "fresh picture"),
        FAIL,
        "the last is frozen",
        "Unplug the camera",
        built={"camera_faults": (CameraFault(CameraFaultKind.FREEZE, 0.0),)},
    ),
    Planted(
        "the camera is slower than asked",
        ("camera", "frame rate"),
        WARN,
        "15.0 frames a second, not the 30 asked for",
        "pixel_format: MJPG",
        built={"timing": CameraTiming(frame_rate_hz=15.0)},
    ),
    Planted(
        "the exposure cannot be locked",
        ("camera", "locks"),
        FAIL,
        "exposure is not locked at 0.01",
        "Set exposure_s to a value that the device takes",
        _attribute(lambda bench: bench, stubborn=frozenset({cv2.CAP_PROP_AUTO_EXPOSURE})),
    ),
    Planted(
        "the white balance stays automatic",
        ("camera", "locks"),
        WARN,
        "white_balance is not locked",
        "list white_balance under automatic",
        _attribute(lambda bench: bench, stubborn=frozenset({cv2.CAP_PROP_AUTO_WB})),
    ),
    Planted("the disk is full", ("disk", "output folder"), FAIL, "0.1 GB free", "Make room", _disk(1e8, 1e8)),
    Planted("the disk is slow", ("disk", "output folder"), WARN, "2 MB/s", "Write to a local disk", _disk(1e11, 2e6)),
    Planted("the disk is read-only", ("disk", "output folder"), FAIL, "Read-only", "--out-folder", _no_disk),
    Planted("STOP is latched", ("runtime", "STOP"), FAIL, "latched: by somebody", "rig stop", _latched),
    Planted(
        "the runtime folder is open to others", ("runtime", "folder"), FAIL, "not private", "Remove it", _not_private
    ),
]
