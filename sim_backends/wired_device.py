"""An emulated serial device at the end of a faulty wire: what a transport, simulated port or pseudo-terminal, sees."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Protocol

from sim_backends.faults import Fault, FaultKind, FaultyWire, Side, WireByte


class SerialMachine(Protocol):
    """A device as its wire sees it: a state machine that time and bytes drive."""

    def receive(self, byte: WireByte) -> None:
        """A byte arrives; time has been advanced to its arrival."""
        ...

    def advance_to(self, now_s: float) -> None:
        """Let time pass."""
        ...

    def next_event_s(self) -> float | None:
        """When something happens next without a byte."""
        ...

    def take_output(self) -> list[tuple[float, bytes]]:
        """What was written since the last call, and when."""
        ...

    def apply_fault(self, fault: Fault) -> None:
        """A fault of the device strikes now; one that it cannot have is ignored."""
        ...


class WiredDevice:
    """A machine, its wire with a fault script, and the cable's plug.

    The host's side is `host_writes`, `host_takes` and `plugged`; each pull of the plug makes a new `pull_count`, by
    which a port that was open before knows that it is dead for good.
    """

    def __init__(
        self,
        machine: SerialMachine,
        script: Sequence[Fault] = (),
        *,
        boundary: bytes = b"\n",
        seconds_per_byte: float = 10.0 / 115200.0,
    ) -> None:
        """Connect a machine to a wire; arguments as `FaultyWire`."""
        self.machine = machine
        self.wire = FaultyWire(script, boundary=boundary, seconds_per_byte=seconds_per_byte)
        self.plugged, self.pull_count = True, 0
        self.written: list[tuple[float, bytes]] = []
        self._now_s = 0.0
        self._plugs_in_s: float | None = None
        self._to_machine: deque[WireByte] = deque()
        self._to_host: deque[WireByte] = deque()
        self._arrived = bytearray()

    def host_writes(self, data: bytes, now_s: float) -> None:
        """The host writes; what it writes is also kept in `written`, with its time."""
        self.advance_to(now_s)
        self.written.append((now_s, data))
        if self.plugged:
            self._to_machine += self.wire.carry(Side.TO_DEVICE, data, now_s)

    def host_waiting(self) -> int:
        """How many bytes have reached the host and were not taken."""
        return len(self._arrived)

    def host_takes(self, count: int) -> bytes:
        """Take bytes that have reached the host."""
        taken = bytes(self._arrived[:count])
        del self._arrived[:count]
        return taken

    def unplug(self, seconds: float = 0.0) -> None:
        """Pull the plug, for a while (0: for good); what is on the wire is lost."""
        self.plugged = False
        self.pull_count += 1
        self._plugs_in_s = self._now_s + seconds if seconds > 0.0 else None
        self._to_machine.clear()
        self._to_host.clear()
        self._arrived.clear()

    def plug_in(self) -> None:
        """Put the plug back."""
        self.plugged, self._plugs_in_s = True, None

    def next_event_s(self) -> float | None:
        """When something happens next, a byte's arrival at the host among it."""
        times = [
            self._to_machine[0].at_s if self._to_machine else None,
            self._to_host[0].at_s if self._to_host else None,
            self.wire.next_due_s(),
            self._plugs_in_s,
            self.machine.next_event_s(),
        ]
        return min((time for time in times if time is not None), default=None)

    def advance_to(self, now_s: float) -> None:
        """Let time pass, everything in its order."""
        while (event := self.next_event_s()) is not None and event <= now_s:
            self._step_to(max(event, self._now_s))
        self._step_to(max(now_s, self._now_s))

    def _step_to(self, now_s: float) -> None:
        self._now_s = now_s
        self.machine.advance_to(now_s)
        for fault in self.wire.due(now_s):
            if fault.kind is FaultKind.UNPLUG:
                self.unplug(fault.seconds)
            else:
                self.machine.apply_fault(fault)
        if self._plugs_in_s is not None and self._plugs_in_s <= now_s:
            self.plug_in()
        while self._to_machine and self._to_machine[0].at_s <= now_s:
            self.machine.receive(self._to_machine.popleft())
        for at_s, data in self.machine.take_output():
            if self.plugged:
                self._to_host += self.wire.carry(Side.FROM_DEVICE, data, at_s)
        while self._to_host and self._to_host[0].at_s <= now_s:
            self._arrived.append(self._to_host.popleft().value)
