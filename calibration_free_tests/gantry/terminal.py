"""A person's terminal on an emulated controller: types lines, reads what comes back; no driver in between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sim_backends.faults import Fault
from sim_backends.grbl_emulator.dialects import GRBL_1_1, Dialect
from sim_backends.grbl_emulator.eeprom import BENCH
from sim_backends.grbl_emulator.machine import GrblMachine
from sim_backends.grbl_emulator.mechanics import Mechanics
from sim_backends.grbl_emulator.monitor import Monitor
from sim_backends.simulated_clock import SimulatedClock
from sim_backends.simulated_port import SimulatedPort
from sim_backends.wired_device import WiredDevice

LOWER, UPPER = (-400.0, -300.0, -200.0), (0.0, 0.0, 0.0)


class Terminal:
    """An emulated controller, its wire, a clock and an open port."""

    def __init__(
        self,
        dialect: Dialect = GRBL_1_1,
        settings: Mapping[int, float] = BENCH,
        script: Sequence[Fault] = (),
        *,
        mechanics: Mechanics | None = None,
        start_delay_s: float = 0.0,
    ) -> None:
        self.clock = SimulatedClock()
        self.monitor = Monitor(LOWER, UPPER)
        self.machine = GrblMachine(
            dialect, settings=settings, mechanics=mechanics, monitor=self.monitor, start_delay_s=start_delay_s
        )
        self.device = WiredDevice(self.machine, script)
        self.clock.attach(self.device)
        self.clock.sleep_s(0.05)
        self.port = SimulatedPort(self.device, self.clock)

    def listen(self, seconds: float = 0.1) -> list[str]:
        """Wait, and return the lines that came."""
        self.clock.sleep_s(seconds)
        return [line for line in self.port.read(self.port.in_waiting).decode("latin-1").split("\r\n") if line]

    def type(self, text: str | bytes, seconds: float = 0.1) -> list[str]:
        """Send a line, or real-time bytes as they are, and return what came back."""
        self.port.write(text if isinstance(text, bytes) else text.encode() + b"\n")
        return self.listen(seconds)

    def ask(self) -> str:
        """The answer to ``?``."""
        return self.type(b"?", 0.02)[-1]

    def home(self) -> None:
        """Home it."""
        assert self.type("$H", 60.0)[-1:] == ["ok"]
