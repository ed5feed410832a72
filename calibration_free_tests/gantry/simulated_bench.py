"""A gantry driver on an emulated controller, on simulated time: what most tests of the driver stand on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from calibration_free_tests.gantry.terminal import Terminal
from drivers.grbl import GrblGantry
from drivers.grbl_settings import GrblAxis, GrblSettings
from drivers.serial_link import SerialPort
from sim_backends.faults import Fault
from sim_backends.grbl_emulator.dialects import FLUIDNC, GRBL_1_1, GRBLHAL, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH
from sim_backends.grbl_emulator.mechanics import Mechanics
from sim_backends.simulated_port import SimulatedPort

BOTH = [GRBL_1_1, GRBLHAL]
ALL = [GRBL_1_1, GRBLHAL, FLUIDNC]


def name_of(dialect: Dialect) -> str:
    """For the ids of parametrised tests."""
    return dialect.name


def settings(**changes: Any) -> GrblSettings:
    """The bench of the emulator's settings, 2 mm inside its soft limits."""
    values: dict[str, Any] = {
        "port": "simulated",
        "x": GrblAxis(lower_mm=-398.0, upper_mm=-1.0, feed_mm_per_min=5000.0),
        "y": GrblAxis(lower_mm=-298.0, upper_mm=-1.0, feed_mm_per_min=5000.0),
        "z": GrblAxis(lower_mm=-198.0, upper_mm=-1.0, feed_mm_per_min=2500.0),
    }
    return GrblSettings(**{**values, **changes})


class Bench:
    """An emulated controller and a driver that is not connected yet."""

    def __init__(
        self,
        dialect: Dialect = GRBL_1_1,
        script: Sequence[Fault] = (),
        *,
        firmware: Mapping[int, float] = BENCH,
        mechanics: Mechanics | None = None,
        start_delay_s: float = 0.02,
        unplugged: Exception | None = None,
        **changes: Any,
    ) -> None:
        self.terminal = Terminal(dialect, firmware, script, mechanics=mechanics, start_delay_s=start_delay_s)
        self.clock, self.device = self.terminal.clock, self.terminal.device
        self.machine, self.monitor = self.terminal.machine, self.terminal.monitor
        self.settings = settings(**changes)
        self.unplugged = unplugged
        self.gantry = GrblGantry(self.settings, self.clock, open_port=self.open_port)

    def open_port(self, wanted: GrblSettings) -> SerialPort:
        """A new port on the emulator."""
        return SimulatedPort(
            self.device, self.clock, port=wanted.port, baudrate=wanted.baud, timeout=0.02, unplugged=self.unplugged
        )

    def homed(self) -> GrblGantry:
        """Connected and homed."""
        self.gantry.connect()
        self.gantry.home()
        return self.gantry

    @property
    def truth(self) -> tuple[float, float, float]:
        """Where the carriages really are."""
        return self.machine.mechanics.position

    def lines_written(self) -> list[str]:
        """The lines that the driver has written, real-time bytes left out."""
        text = b"".join(data for _, data in self.device.written).translate(None, b"?!~\x18\x82\x85\x90")
        return text.decode("ascii").splitlines()

    def bytes_written(self) -> bytes:
        """Everything that the driver has written."""
        return b"".join(data for _, data in self.device.written)

    def at_in(self, seconds: float, action: Any) -> None:
        """Do something in the middle of what the driver is about to do."""
        self.clock.call_at(self.clock.now_s() + seconds, action)
