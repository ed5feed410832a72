"""The bus: reads packets byte by byte, lets the servos carry them out, and says what they answer and when."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from sim_backends.dynamixel_emulator import table
from sim_backends.dynamixel_emulator.monitor import Monitor
from sim_backends.dynamixel_emulator.packets import (
    BROADCAST,
    ErrorCode,
    Instruction,
    Packet,
    PacketReader,
    fast_sync_packet,
    status_packet,
)
from sim_backends.dynamixel_emulator.servo import Servo
from sim_backends.faults import Fault, FaultKind, WireByte

TOO_HOT_C = 95.0


class EmulatedBus:
    """Servos on one line: a `sim_backends.wired_device.SerialMachine`. It never waits and reads no clock.

    Attributes:
        host_baud: the rate that the host has set; ``None``: the servos' own. At another rate they hear only noise.
        hung_until_s: until then no servo hears anything.
    """

    def __init__(self, servos: Sequence[Servo], monitor: Monitor | None = None) -> None:
        """Servos in any order; ids may clash, and then both answer."""
        self.servos = list(servos)
        self.monitor = monitor or Monitor({})
        self.host_baud: int | None = None
        self.hung_until_s = 0.0
        self._now_s = 0.0
        self._reader = PacketReader()
        self._waiting: dict[Servo, tuple[int, bytes]] = {}
        self._replies: deque[tuple[float, bytes]] = deque()

    def servo(self, servo_id: int) -> Servo:
        """The servo of that id."""
        return next(servo for servo in self.servos if servo.servo_id == servo_id)

    # SerialMachine.

    def advance_to(self, now_s: float) -> None:
        """Let time pass for all servos."""
        self._now_s = max(self._now_s, now_s)
        for servo in self.servos:
            servo.advance_to(self._now_s)

    def next_event_s(self) -> float | None:
        """When the next answer begins."""
        return self._replies[0][0] if self._replies else None

    def take_output(self) -> list[tuple[float, bytes]]:
        """Answers that have begun, each with its time."""
        begun = []
        while self._replies and self._replies[0][0] <= self._now_s:
            begun.append(self._replies.popleft())
        return begun

    def receive(self, byte: WireByte) -> None:
        """Take one byte."""
        at_s = byte.at_s
        packet = self._reader.feed(byte.value, at_s)
        if packet is None or at_s < self.hung_until_s:
            return
        awake = [s for s in self.servos if s.awake(at_s) and self.host_baud in (s.baud, None)]
        for servo in awake:
            if packet.servo_id in (servo.servo_id, BROADCAST):
                servo.heard(at_s)
        if packet.intact:
            self._replies += self._carry_out(packet, awake, at_s)
        else:
            self._replies += self._refuse(packet, awake, at_s)

    def apply_fault(self, fault: Fault) -> None:
        """Hang, and stuck, overheated or power-cycled servos; ``number`` counts through the servos."""
        until_s = self._now_s + fault.seconds if fault.seconds else math.inf
        servo = self.servos[fault.number % len(self.servos)]
        match fault.kind:
            case FaultKind.HANG:
                self.hung_until_s = until_s
            case FaultKind.STUCK_AXIS:
                servo.jam(until_s)
            case FaultKind.OVERHEAT:
                servo.temperature_c = TOO_HOT_C
            case FaultKind.POWER_CYCLE:
                servo.power_cycle(self._now_s, fault.seconds)

    # Instructions.

    def _refuse(self, packet: Packet, awake: list[Servo], at_s: float) -> list[tuple[float, bytes]]:
        return self._answers([(s, ErrorCode.CRC, b"") for s in awake if s.servo_id == packet.servo_id], at_s)

    def _carry_out(self, packet: Packet, awake: list[Servo], at_s: float) -> list[tuple[float, bytes]]:
        match packet.instruction:
            case Instruction.SYNC_READ | Instruction.FAST_SYNC_READ:
                return self._sync_read(packet, awake, at_s)
            case Instruction.SYNC_WRITE:
                self._sync_write(packet.parameters, awake, at_s)
                return []
            case Instruction.BULK_READ:
                wanted = [_bulk_entry(packet.parameters[n : n + 5]) for n in range(0, len(packet.parameters), 5)]
                return self._read_in_turn(wanted, awake, at_s)
        mine = [s for s in awake if packet.servo_id in (s.servo_id, BROADCAST)]
        answers = [(servo, *self._one(servo, packet, at_s)) for servo in sorted(mine, key=lambda s: s.servo_id)]
        if packet.servo_id == BROADCAST and packet.instruction != Instruction.PING:
            return []
        return self._answers([a for a in answers if _answers_at_all(a[0], packet.instruction)], at_s)

    def _one(self, servo: Servo, packet: Packet, at_s: float) -> tuple[int, bytes]:
        """Carry out an instruction for one servo; error code and parameters of its answer."""
        given = packet.parameters
        match packet.instruction:
            case Instruction.PING:
                return 0, servo.memory[table.MODEL_NUMBER].to_bytes(2, "little") + bytes([servo.memory[table.FIRMWARE]])
            case Instruction.READ if len(given) == 4:
                return self._read(servo, _word(given), _word(given[2:]))
            case Instruction.WRITE if len(given) > 2:
                return self._write(servo, _word(given), given[2:], at_s), b""
            case Instruction.REG_WRITE if len(given) > 2:
                self._waiting[servo] = (_word(given), given[2:])
                servo.memory[table.REGISTERED] = 1
                return 0, b""
            case Instruction.ACTION:
                return self._act(servo, at_s), b""
            case Instruction.REBOOT:
                servo.power_cycle(at_s)
                return 0, b""
            case Instruction.FACTORY_RESET:
                self.monitor.factory_reset(servo, at_s)
                return ErrorCode.RESULT_FAIL, b""
        return ErrorCode.INSTRUCTION, b""

    def _act(self, servo: Servo, at_s: float) -> int:
        if servo not in self._waiting:
            return ErrorCode.RESULT_FAIL
        servo.memory[table.REGISTERED] = 0
        return self._write(servo, *self._waiting.pop(servo), at_s)

    def _read(self, servo: Servo, address: int, length: int) -> tuple[int, bytes]:
        error, data = servo.read(address, length)
        if not error:
            self.monitor.shown(servo, address, length)
        return error, data

    def _write(self, servo: Servo, address: int, data: bytes, at_s: float) -> int:
        self.monitor.writing(servo, address, data, at_s)
        return servo.write(address, data)

    def _sync_write(self, given: bytes, awake: list[Servo], at_s: float) -> None:
        address, length = _word(given), _word(given[2:])
        for start in range(4, len(given) - length, 1 + length):
            for servo in awake:
                if servo.servo_id == given[start]:
                    self._write(servo, address, given[start + 1 : start + 1 + length], at_s)

    def _sync_read(self, packet: Packet, awake: list[Servo], at_s: float) -> list[tuple[float, bytes]]:
        address, length = _word(packet.parameters), _word(packet.parameters[2:])
        wanted = [(servo_id, address, length) for servo_id in packet.parameters[4:]]
        if packet.instruction == Instruction.SYNC_READ:
            return self._read_in_turn(wanted, awake, at_s)
        found = [s for servo_id, _, _ in wanted for s in awake if s.servo_id == servo_id]
        if len(found) != len(wanted):
            return []
        answers = []
        for servo in found:
            error, data = self._read(servo, address, length)
            answers.append((error | servo.error_bits, servo.servo_id, data))
        return [(at_s + _delay_s(found[0]), fast_sync_packet(answers))]

    def _read_in_turn(
        self, wanted: list[tuple[int, int, int]], awake: list[Servo], at_s: float
    ) -> list[tuple[float, bytes]]:
        """Each waits for the one before it to answer, so those behind a mute one are silent too."""
        answers = []
        for servo_id, address, length in wanted:
            mine = [s for s in awake if s.servo_id == servo_id]
            if not mine:
                break
            answers += [(servo, *self._read(servo, address, length)) for servo in mine]
        return self._answers(answers, at_s)

    def _answers(self, answers: list[tuple[Servo, int, bytes]], at_s: float) -> list[tuple[float, bytes]]:
        replies = []
        for servo, error, data in answers:
            at_s += _delay_s(servo)
            replies.append((at_s, status_packet(servo.servo_id, error | servo.error_bits, data)))
        return replies


def _word(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")


def _bulk_entry(data: bytes) -> tuple[int, int, int]:
    return data[0], _word(data[1:]), _word(data[3:])


def _delay_s(servo: Servo) -> float:
    return servo.memory[table.RETURN_DELAY] * 2e-6


def _answers_at_all(servo: Servo, instruction: int) -> bool:
    """The status return level: 0 answers pings only, 1 reads too, 2 everything."""
    return servo.memory[table.RETURN_LEVEL] >= _LEVEL.get(instruction, 2)


_LEVEL: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1}
