"""Fault scripts: what goes wrong between a host and an emulated serial device, and when.

A script is a sequence of `Fault`. Each waits for one trigger (a byte, a message, a time) and acts once. Faults of the
wire (drop, duplicate, flip, split, delay, garble) are applied by a `FaultyWire`, through which all bytes of both
directions pass; faults of the device (banner, alarm, unplug, …) are handed by it to the emulator when they are due.
Times are seconds on the emulator's clock.
"""

from __future__ import annotations

import bisect
import enum
import heapq
import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np


class Side(enum.Enum):
    """Which way a byte goes."""

    TO_DEVICE = "to the device"
    FROM_DEVICE = "from the device"


class FaultKind(enum.Enum):
    """What can go wrong. A device ignores the kinds that it cannot have."""

    DROP = "drop"
    """`count` bytes vanish."""
    DUPLICATE = "duplicate"
    """`count` bytes arrive, then arrive again."""
    FLIP = "flip"
    """One byte arrives with the bits of `mask` flipped."""
    GARBLE = "garble"
    """`count` bytes are replaced by noise, drawn from the seed `mask`."""
    SPLIT = "split"
    """`count` bytes arrive, the rest of the message `seconds` later."""
    DELAY = "delay"
    """This byte and all behind it arrive `seconds` later."""
    BANNER = "banner"
    """The controller restarts (brown-out) and says so; the link stays up."""
    ALARM = "alarm"
    """The controller raises alarm `number`."""
    UNPLUG = "unplug"
    """The cable is pulled, for `seconds` (0: for good)."""
    HANG = "hang"
    """The firmware does nothing for `seconds` (0: for good)."""
    STUCK_AXIS = "stuck axis"
    """Axis or servo `number` does not follow for `seconds` (0: for good)."""
    OVERHEAT = "overheat"
    """Servo `number` becomes too hot."""
    POWER_CYCLE = "power cycle"
    """Power goes and comes back after `seconds`; the link stays up, as an adapter that is powered from USB does."""


WIRE_KINDS = frozenset(
    {FaultKind.DROP, FaultKind.DUPLICATE, FaultKind.FLIP, FaultKind.GARBLE, FaultKind.SPLIT, FaultKind.DELAY}
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault and its trigger; give exactly one of `at_byte`, `at_message` and `at_s`.

    Attributes:
        kind: what goes wrong.
        side: the direction that the trigger counts in, and that a fault of the wire acts on.
        at_byte: acts on the byte of this number, counted from 0 in its direction.
        at_message: acts on the first byte after so many boundaries (line ends, packet headers) have passed.
        at_s: acts at this time; a fault of the wire acts on the first byte that is sent from then on.
        count, seconds, mask, number: see `FaultKind`.
    """

    kind: FaultKind
    side: Side = Side.TO_DEVICE
    at_byte: int | None = None
    at_message: int | None = None
    at_s: float | None = None
    count: int = 1
    seconds: float = 0.0
    mask: int = 1
    number: int = 0

    def __post_init__(self) -> None:
        triggers = [t for t in (self.at_byte, self.at_message, self.at_s) if t is not None]
        if len(triggers) != 1:
            raise ValueError(f"{self.kind.value}: give one of at_byte, at_message, at_s, not {len(triggers)}")
        if self.count < 1 or self.seconds < 0.0:
            raise ValueError(f"{self.kind.value}: count must be at least 1 and seconds not negative")


@dataclass(frozen=True, slots=True)
class WireByte:
    """A byte on its way.

    Attributes:
        at_s: when it arrives.
        value: 0..255.
        altered: the wire changed or repeated it, or swallowed the byte before it.
        sent_at_s: when the sender handed it to the wire, which may have kept it.
    """

    at_s: float
    value: int
    altered: bool
    sent_at_s: float


_Numbered = tuple[float, int, "Fault"]
"""When, the place in the script, and what."""


@dataclass
class _Lane:
    """One direction: what has passed, and which fault of the wire is at work.

    ``waiting`` are the faults still to come, by bytes, messages and time, the next of each kind first; ``ready`` those
    whose moment has come, in the script's order.
    """

    waiting: tuple[list[_Numbered], ...] = field(default_factory=lambda: ([], [], []))
    ready: list[tuple[int, Fault]] = field(default_factory=list)
    bytes_seen: int = 0
    messages_seen: int = 0
    tail: bytes = b""
    free_at_s: float = 0.0
    swallowed: bool = False
    active: Fault | None = None
    left: int = 0
    echo: bytearray = field(default_factory=bytearray)
    noise: random.Random = field(default_factory=lambda: random.Random(0))


class FaultyWire:
    """Both directions of a serial line, with a script of faults. Bytes never overtake each other."""

    def __init__(
        self, script: Sequence[Fault] = (), *, boundary: bytes = b"\n", seconds_per_byte: float = 10.0 / 115200.0
    ) -> None:
        """Set the wire up.

        Args:
            script: the faults; their order does not matter.
            boundary: the bytes that `Fault.at_message` counts: a line's end, or the header that opens a packet.
            seconds_per_byte: how long a byte is on the wire.
        """
        self._boundary, self._seconds_per_byte = boundary, seconds_per_byte
        self._lanes = {side: _Lane() for side in Side}
        self._due: list[tuple[float, int, Fault]] = []
        self._serial = 0
        self.fired: list[Fault] = []
        for fault in script:
            self.add(fault)

    def add(self, fault: Fault) -> None:
        """Add a fault to the script while it runs; triggers count from the beginning, as for all others."""
        if fault.kind not in WIRE_KINDS and fault.at_s is not None:
            self._schedule(fault.at_s, fault)
        else:
            self._serial += 1
            triggers = (fault.at_byte, fault.at_message, fault.at_s)
            kind, when = next((kind, when) for kind, when in enumerate(triggers) if when is not None)
            heapq.heappush(self._lanes[fault.side].waiting[kind], (when, self._serial, fault))

    def bytes_sent(self, side: Side) -> int:
        """How many bytes have been sent in a direction: the number of the next one."""
        return self._lanes[side].bytes_seen

    def carry(self, side: Side, data: bytes, now_s: float) -> list[WireByte]:
        """Send bytes; returns what will arrive, and when, in order."""
        lane = self._lanes[side]
        if self._nothing_happens(lane, len(data), now_s):
            return self._carry_all(lane, data, now_s)
        arriving: list[WireByte] = []
        for value in data:
            arriving += self._carry_byte(lane, value, now_s)
        return arriving

    def due(self, now_s: float) -> list[Fault]:
        """Faults of the device whose time has come since the last call, in order."""
        ready = []
        while self._due and self._due[0][0] <= now_s:
            ready.append(heapq.heappop(self._due)[2])
        self.fired += ready
        return ready

    def next_due_s(self) -> float | None:
        """When the next fault of the device is due, as far as that is known."""
        return self._due[0][0] if self._due else None

    def _schedule(self, at_s: float, fault: Fault) -> None:
        self._serial += 1
        heapq.heappush(self._due, (at_s, self._serial, fault))

    def _nothing_happens(self, lane: _Lane, count: int, now_s: float) -> bool:
        """No fault is at work, and none can begin within so many bytes."""
        until_s = max(lane.free_at_s, now_s) + count * self._seconds_per_byte
        reach = (lane.bytes_seen + count, lane.messages_seen + count, until_s)
        coming = any(heap and heap[0][0] <= end for heap, end in zip(lane.waiting, reach, strict=True))
        return lane.active is None and not (lane.ready or lane.swallowed or coming)

    def _carry_all(self, lane: _Lane, data: bytes, now_s: float) -> list[WireByte]:
        """What `_carry_byte` does where no fault is near, for all bytes at once."""
        lane.bytes_seen += len(data)
        tail = lane.tail[-(len(self._boundary) - 1) :] if len(self._boundary) > 1 else b""
        lane.messages_seen += (tail + data).count(self._boundary)
        lane.tail = (lane.tail + data)[-len(self._boundary) :]
        return self._deliver(lane, data, max(lane.free_at_s, now_s), now_s)

    def _carry_byte(self, lane: _Lane, value: int, now_s: float) -> list[WireByte]:
        start_s = max(lane.free_at_s, now_s)
        _trigger(lane, start_s)
        for numbered in lane.ready.copy():
            fault = numbered[1]
            if fault.kind in WIRE_KINDS and lane.active is not None:
                continue  # one at a time: it acts on the first byte after the other is done
            lane.ready.remove(numbered)
            if fault.kind in WIRE_KINDS:
                lane.active, lane.left, lane.noise = fault, fault.count, random.Random(fault.mask)
                lane.echo.clear()
                self.fired.append(fault)
            else:
                self._schedule(start_s, fault)
        lane.bytes_seen += 1
        lane.tail = (lane.tail + bytes([value]))[-len(self._boundary) :]
        if lane.tail == self._boundary:
            lane.messages_seen += 1
        return self._act(lane, value, start_s, now_s)

    def _act(self, lane: _Lane, value: int, start_s: float, sent_at_s: float) -> list[WireByte]:
        fault = lane.active
        lane.left -= 1
        if fault is not None and lane.left <= 0:
            lane.active = None
        match fault.kind if fault is not None else None:
            case FaultKind.DROP:
                lane.swallowed = True
                lane.free_at_s = start_s + self._seconds_per_byte
                return []
            case FaultKind.DELAY if fault is not None:
                start_s += fault.seconds
                lane.active = None
            case FaultKind.FLIP if fault is not None:
                value, lane.swallowed, lane.active = (value ^ fault.mask) & 0xFF, True, None
            case FaultKind.GARBLE:
                value, lane.swallowed = lane.noise.randrange(256), True
            case FaultKind.DUPLICATE:
                lane.echo.append(value)
        arriving = self._deliver(lane, [value], start_s, sent_at_s)
        if fault is not None and lane.active is None:
            if fault.kind is FaultKind.SPLIT:
                lane.free_at_s += fault.seconds
            if fault.kind is FaultKind.DUPLICATE:
                lane.swallowed = True
                arriving += self._deliver(lane, lane.echo, lane.free_at_s, sent_at_s)
        return arriving

    def _deliver(self, lane: _Lane, values: Iterable[int], start_s: float, sent_at_s: float) -> list[WireByte]:
        arriving = []
        altered, lane.swallowed = lane.swallowed, False
        for value in values:
            lane.free_at_s = start_s + self._seconds_per_byte
            arriving.append(WireByte(lane.free_at_s, value, altered, sent_at_s))
            start_s = lane.free_at_s
        return arriving


def _trigger(lane: _Lane, now_s: float) -> None:
    """Make ready what is due at the next byte; scripts may hold thousands of faults, so only the next are looked at."""
    for heap, reached in zip(lane.waiting, (lane.bytes_seen, lane.messages_seen, now_s), strict=True):
        while heap and heap[0][0] <= reached:
            _, serial, fault = heapq.heappop(heap)
            bisect.insort(lane.ready, (serial, fault), key=lambda numbered: numbered[0])


def random_script(
    rng: np.random.Generator, times_s: Sequence[float], kinds: Sequence[FaultKind], *, alarms: Sequence[int] = (1, 2)
) -> tuple[Fault, ...]:
    """One random fault of the given kinds at each of the times, either direction, short counts and pauses."""
    script = []
    for at_s in times_s:
        kind = kinds[int(rng.integers(len(kinds)))]
        side = Side.TO_DEVICE if rng.random() < 0.5 else Side.FROM_DEVICE
        mask = 1 << int(rng.integers(8)) if kind is FaultKind.FLIP else int(rng.integers(1 << 30))
        script.append(
            Fault(
                kind,
                side,
                at_s=float(at_s),
                count=int(rng.integers(1, 12)),
                seconds=float(rng.choice([0.02, 0.2, 1.0, 3.0])),
                mask=mask,
                number=int(rng.choice(list(alarms))) if kind is FaultKind.ALARM else int(rng.integers(3)),
            )
        )
    return tuple(script)
