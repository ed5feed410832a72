"""A fault script does what it says to the bytes, once, at its trigger, and to nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from sim_backends.faults import Fault, FaultKind, FaultyWire, Side, random_script
from sim_backends.simulated_clock import SimulatedClock

LINE = b"G1X10\n"


def through(fault: Fault, data: bytes = LINE * 2) -> tuple[bytes, list[float]]:
    wire = FaultyWire([fault], seconds_per_byte=0.001)
    arrived = wire.carry(fault.side, data, 0.0)
    assert [b.at_s for b in arrived] == sorted(b.at_s for b in arrived)
    return bytes(b.value for b in arrived), [b.at_s for b in arrived]


def test_a_wire_without_faults_changes_nothing_and_takes_its_time() -> None:
    wire = FaultyWire(seconds_per_byte=0.001)
    arrived = wire.carry(Side.TO_DEVICE, LINE, 5.0)
    assert bytes(b.value for b in arrived) == LINE
    assert arrived[-1].at_s == pytest.approx(5.006)
    assert not any(b.altered for b in arrived)


@pytest.mark.parametrize(
    ("kind", "arrives"),
    [
        (FaultKind.DROP, b"G1X0\nG1X10\n"),
        (FaultKind.DUPLICATE, b"G1X110\nG1X10\n"),
        (FaultKind.FLIP, b"G1X90\nG1X10\n"),
    ],
)
def test_a_fault_of_the_wire_alters_the_byte_at_its_trigger(kind: FaultKind, arrives: bytes) -> None:
    assert through(Fault(kind, at_byte=3, mask=0x08))[0] == arrives


def test_a_fault_may_wait_for_a_message() -> None:
    assert through(Fault(FaultKind.DROP, at_message=1, count=2))[0] == b"G1X10\nX10\n"
    assert through(Fault(FaultKind.DUPLICATE, at_message=1, count=6))[0] == LINE * 3


def test_a_packet_header_may_be_the_boundary() -> None:
    packet = b"\xff\xff\xfd\x00abc"
    wire = FaultyWire([Fault(FaultKind.FLIP, at_message=2, mask=1)], boundary=b"\xff\xff\xfd\x00")
    arrived = wire.carry(Side.TO_DEVICE, packet * 2, 0.0)
    assert bytes(b.value for b in arrived) == packet + b"\xff\xff\xfd\x00`bc"


def test_garble_replaces_as_many_bytes_as_told_and_the_same_each_time() -> None:
    fault = Fault(FaultKind.GARBLE, at_byte=2, count=3, mask=7)
    got = through(fault)[0]
    assert len(got) == 2 * len(LINE)
    assert got[:2] == LINE[:2]
    assert got[5:] == (LINE * 2)[5:]
    assert got[2:5] != LINE[2:5]
    assert through(fault)[0] == got


def test_split_and_delay_keep_the_bytes_and_the_order() -> None:
    data, times = through(Fault(FaultKind.SPLIT, at_byte=0, count=3, seconds=0.5))
    assert data == LINE * 2
    assert times[2] < 0.01
    assert times[3] > 0.5
    data, times = through(Fault(FaultKind.DELAY, at_byte=3, seconds=0.5))
    assert data == LINE * 2
    assert times[2] < 0.01
    assert times[3] > 0.5


def test_bytes_that_the_wire_altered_are_marked() -> None:
    wire = FaultyWire([Fault(FaultKind.DROP, at_byte=3)])
    marks = [b.altered for b in wire.carry(Side.TO_DEVICE, LINE, 0.0)]
    assert marks == [False, False, False, True, False]


def test_a_fault_of_the_device_is_handed_over_once_when_due() -> None:
    unplug, alarm = Fault(FaultKind.UNPLUG, at_s=2.0), Fault(FaultKind.ALARM, at_byte=3, number=1)
    wire = FaultyWire([unplug, alarm])
    assert wire.due(1.0) == []
    assert wire.next_due_s() == 2.0
    wire.carry(Side.TO_DEVICE, LINE, 1.0)
    assert wire.due(1.5) == [alarm]
    assert wire.due(2.5) == [unplug]
    assert wire.due(9.0) == []


def test_a_fault_acts_in_its_own_direction_only() -> None:
    wire = FaultyWire([Fault(FaultKind.DROP, Side.FROM_DEVICE, at_byte=0)])
    assert len(wire.carry(Side.TO_DEVICE, LINE, 0.0)) == len(LINE)
    assert len(wire.carry(Side.FROM_DEVICE, LINE, 0.0)) == len(LINE) - 1


def test_a_fault_needs_exactly_one_trigger() -> None:
    with pytest.raises(ValueError, match="one of at_byte"):
        Fault(FaultKind.DROP)
    with pytest.raises(ValueError, match="one of at_byte"):
        Fault(FaultKind.DROP, at_byte=1, at_s=1.0)


def test_random_scripts_repeat_with_their_seed() -> None:
    def script() -> tuple[Fault, ...]:
        return random_script(np.random.default_rng(4), [1.0, 2.0, 3.0], list(FaultKind))

    assert script() == script()
    assert len(script()) == 3


class Ticker:
    """A device that does something every half second."""

    def __init__(self) -> None:
        self.ticks: list[float] = []

    def next_event_s(self) -> float:
        return 0.5 * (len(self.ticks) + 1)

    def advance_to(self, now_s: float) -> None:
        while self.next_event_s() <= now_s:
            self.ticks.append(self.next_event_s())


def test_the_simulated_clock_carries_devices_and_calls_in_order() -> None:
    clock, ticker = SimulatedClock(), Ticker()
    clock.attach(ticker)
    seen: list[tuple[float, int]] = []
    clock.call_at(1.2, lambda: seen.append((clock.now_s(), len(ticker.ticks))))
    clock.sleep_s(2.0)
    assert clock.now_s() == 2.0
    assert ticker.ticks == [0.5, 1.0, 1.5, 2.0]
    assert seen == [(1.2, 2)]


def test_waiting_on_the_simulated_clock_ends_when_it_has_happened() -> None:
    clock, ticker = SimulatedClock(), Ticker()
    clock.attach(ticker)
    assert clock.wait_until(lambda: len(ticker.ticks) == 3, 60.0)
    assert clock.now_s() == 1.5
    assert not clock.wait_until(lambda: len(ticker.ticks) == 99, 4.0)
    assert clock.now_s() == 4.0
