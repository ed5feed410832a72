"""The emulated bus on its serial line."""

from __future__ import annotations

from collections.abc import Sequence

from sim_backends.dynamixel_emulator.bus import EmulatedBus
from sim_backends.dynamixel_emulator.packets import HEADER
from sim_backends.faults import Fault
from sim_backends.wired_device import WiredDevice


class BusLine(WiredDevice):
    """A `WiredDevice` with servos. Simulated time stops for whole packets, not for each byte: ten times as fast."""

    def __init__(self, bus: EmulatedBus, script: Sequence[Fault] = (), *, baud: int = 1_000_000) -> None:
        """Connect a bus; bytes take as long as they do at ``baud``, and `Fault.at_message` counts packets."""
        super().__init__(bus, script, boundary=HEADER, seconds_per_byte=10.0 / baud)

    def next_event_s(self) -> float | None:
        """When the last byte on its way arrives at either end, an answer begins, or a fault strikes."""
        times = [
            self._to_machine[-1].at_s if self._to_machine else None,
            self._to_host[-1].at_s if self._to_host else None,
            self.wire.next_due_s(),
            self._plugs_in_s,
            self.machine.next_event_s(),
        ]
        return min((time for time in times if time is not None), default=None)
