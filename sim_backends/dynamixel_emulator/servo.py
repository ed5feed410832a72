"""One servo: its registers, its shaft, and what heat, load, a stuck gear, silence or a power cycle do to them.

The shaft is where it is: ``shaft_ticks`` counts whole turns for ever, while the servo's own count is lost with its
power. Everything happens at times that are passed in, never earlier than the last. Where the manual leaves room the
servo does the worse thing: it keeps an old goal over torque off and goes there when torque comes back, and goes on to
its goal when a tripped watchdog is cleared.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from sim_backends.dynamixel_emulator import table
from sim_backends.dynamixel_emulator.packets import ALERT, ErrorCode
from sim_backends.dynamixel_emulator.profile import Motion, motion, rest
from sim_backends.dynamixel_emulator.table import Memory, Model, Register

VOLTAGE, HEAT, ENCODER, SHOCK, OVERLOAD = 0x01, 0x04, 0x08, 0x10, 0x20
"""Bits of the hardware error status."""
_BOOT_S = 0.3
_OVERLOAD_S = 1.0
_NO_LIMIT = 1e6
"""Acceleration, ticks/s², where the profile asks for none."""


class Servo:
    """A servo on an emulated bus."""

    def __init__(self, model: Model, servo_id: int, *, baud: int = 1_000_000, shaft_ticks: float = 2048.0) -> None:
        """A servo as it comes from the factory, at power-up, but with this id and baud rate."""
        self.model, self.memory = model, Memory(model)
        self.memory[table.SERVO_ID] = servo_id
        self.memory[table.BAUD_CODE] = table.BAUD_RATES.index(baud)
        self.temperature_c, self.voltage_v = 30.0, model.voltage_v
        self.mute_until_s = 0.0
        self.lost_turns = 0
        """Whole turns that the servo's own count lacks."""
        self._motion: Motion = rest(shaft_ticks, 0.0)
        self._stuck_until_s = 0.0
        self._strained_since_s: float | None = None
        self._heard_s = self._now_s = 0.0
        self._booted_s = 0.0
        self._power_up()

    # What the world sees.

    @property
    def servo_id(self) -> int:
        """Its id on the bus."""
        return self.memory[table.SERVO_ID]

    @property
    def baud(self) -> int:
        """Bits per second that it listens at."""
        return table.BAUD_RATES[self.memory[table.BAUD_CODE]]

    @property
    def shaft_ticks(self) -> float:
        """Where the shaft really is, at the time of the last event; 4096 a turn."""
        return self._motion.at(self._now_s)[0]

    @property
    def present(self) -> int:
        """What the servo believes of it: the present position register."""
        return round(self.shaft_ticks) - self.lost_turns * table.TICKS_PER_TURN + self.memory[table.HOMING_OFFSET]

    @property
    def torque(self) -> bool:
        """It holds."""
        return self.memory[table.TORQUE] == 1

    @property
    def stuck(self) -> bool:
        """The shaft does not turn whatever the motor does."""
        return self._now_s < self._stuck_until_s

    @property
    def error_bits(self) -> int:
        """What is to be or-ed into each status packet."""
        return ALERT if self.memory[table.HARDWARE_ERROR] else 0

    def awake(self, now_s: float) -> bool:
        """It hears and answers: not starting up, not mute."""
        return now_s >= self._booted_s and now_s >= self.mute_until_s

    # What happens to it.

    def advance_to(self, now_s: float) -> None:
        """Let time pass: the watchdog, strain and heat."""
        self._trip_watchdog(now_s)
        was_stuck = self.stuck
        self._strain(now_s)
        self._now_s = max(self._now_s, now_s)
        if was_stuck and not self.stuck:
            self._strained_since_s = None
            self._head_for_goal()
        if self.temperature_c > self.memory[table.TEMPERATURE_LIMIT]:
            self.fail(HEAT)
        if not self.memory[table.MIN_VOLTAGE] <= round(self.voltage_v * 10) <= self.memory[table.MAX_VOLTAGE]:
            self.fail(VOLTAGE)

    def heard(self, now_s: float) -> None:
        """An instruction was on the bus: the watchdog starts anew."""
        self._heard_s = now_s

    def fail(self, bits: int) -> None:
        """Latch a hardware error; torque goes where the shutdown register says so."""
        self.memory[table.HARDWARE_ERROR] |= bits
        if bits & (self.memory[table.SHUTDOWN] | ENCODER):
            self._let_go()

    def jam(self, until_s: float) -> None:
        """The shaft is stuck from now on."""
        self._motion = rest(self.shaft_ticks, self._now_s)
        self._stuck_until_s = until_s
        if self.torque:
            self._head_for_goal()

    def turn_by_hand(self, ticks: float) -> None:
        """Somebody turns the shaft while it is free."""
        self._motion = rest(self.shaft_ticks + ticks, self._now_s)

    def power_cycle(self, now_s: float, off_s: float = 0.0) -> None:
        """Power goes and comes back, or it reboots: RAM and the count of turns are lost."""
        self.advance_to(now_s)
        self._booted_s = now_s + off_s + _BOOT_S
        self._motion = rest(self.shaft_ticks, self._now_s)
        self._power_up()

    # What it is told and asked. All of it at the time of the last `advance_to`.

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Error code and bytes."""
        if length < 1 or address + length > table.SIZE:
            return ErrorCode.DATA_RANGE, b""
        self._show()
        return ErrorCode.NONE, self.memory.read(address, length)

    def write(self, address: int, data: bytes) -> int:
        """Error code; where it is not 0 nothing was changed."""
        changes = list(_registers(address, data))
        error = next((e for e in (self._refusal(r, v) for r, v in changes) if e), 0)
        if error:
            return error
        for register, value in changes:
            if register is not None:
                self._set(register, value)
        return ErrorCode.NONE

    # Within.

    def _power_up(self) -> None:
        self.memory.reset(table.RAM)
        self.lost_turns = math.floor(round(self.shaft_ticks) / table.TICKS_PER_TURN)
        self._strained_since_s = None
        self.memory[table.GOAL_POSITION] = self.present

    def _refusal(self, register: Register | None, value: int) -> int:
        if register is None or register.low is None:
            return ErrorCode.ACCESS
        locked = register.address < table.RAM or register in table.INDIRECT
        if locked and self.torque:
            return ErrorCode.ACCESS
        if register in table.GOALS and self.memory[table.WATCHDOG] < 0:
            return ErrorCode.DATA_RANGE
        if register is table.GOAL_POSITION and self.memory[table.OPERATING_MODE] == table.POSITION:
            inside = self.memory[table.MIN_POSITION] <= value <= self.memory[table.MAX_POSITION]
            return ErrorCode.NONE if inside else ErrorCode.DATA_LIMIT
        if register is table.GOAL_CURRENT and abs(value) > self.memory[table.CURRENT_LIMIT]:
            return ErrorCode.DATA_LIMIT
        if register is table.OPERATING_MODE and value not in self.model.modes:
            return ErrorCode.DATA_RANGE
        if register is table.TORQUE and value and self._shut_down:
            return ErrorCode.RESULT_FAIL
        return ErrorCode.NONE if register.low <= value <= register.high else ErrorCode.DATA_RANGE

    @property
    def _shut_down(self) -> bool:
        return bool(self.memory[table.HARDWARE_ERROR] & (self.memory[table.SHUTDOWN] | ENCODER))

    def _set(self, register: Register, value: int) -> None:
        was_off = not self.torque
        tripped = register is table.WATCHDOG and self.memory[table.WATCHDOG] < 0
        self.memory[register] = value
        if register is table.TORQUE and not value:
            self._let_go()
        elif register is table.GOAL_POSITION or (was_off and register is table.TORQUE) or (tripped and not value):
            self._head_for_goal()

    def _head_for_goal(self) -> None:
        if not self.torque:
            return
        position, velocity = self._motion.at(self._now_s)
        if self.stuck:
            self._motion = rest(position, self._now_s)
            return
        ahead = self.memory[table.GOAL_POSITION] - self.present
        goal = round(position) + ahead
        top = self.memory[table.VELOCITY_LIMIT]
        speed = min(self.memory[table.PROFILE_VELOCITY] or top, top) * table.TICKS_PER_S
        acceleration = self.memory[table.PROFILE_ACCELERATION] * table.TICKS_PER_S2 or _NO_LIMIT
        self._motion = motion(position, velocity, goal, speed, acceleration, self._now_s)

    def _let_go(self) -> None:
        self.memory[table.TORQUE] = 0
        self._motion = rest(self.shaft_ticks, self._now_s)
        self._strained_since_s = None

    def _trip_watchdog(self, now_s: float) -> None:
        units = self.memory[table.WATCHDOG]
        trips_s = self._heard_s + units * table.WATCHDOG_UNIT_S
        if units <= 0 or not self.torque or now_s <= trips_s:
            return
        self._now_s = max(self._now_s, trips_s)
        self._motion = rest(self.shaft_ticks, self._now_s)
        self.memory[table.WATCHDOG] = -1

    def _strain(self, now_s: float) -> None:
        """A stuck motor that pulls is overloaded after a while."""
        straining = self.torque and self.stuck and self.memory[table.GOAL_POSITION] != self.present
        if not straining:
            self._strained_since_s = None
            return
        if self._strained_since_s is None:
            self._strained_since_s = self._now_s
        if min(now_s, self._stuck_until_s) - self._strained_since_s >= _OVERLOAD_S:
            self.fail(OVERLOAD)

    def _show(self) -> None:
        """Bring the registers that tell what is up to date."""
        velocity = self._motion.at(self._now_s)[1] / table.TICKS_PER_S
        ongoing = self._now_s < self._motion.end_s
        memory = self.memory
        memory[table.REALTIME_TICK] = int(max(0.0, self._now_s - self._booted_s) * 1000) % 32768
        memory[table.MOVING] = int(abs(velocity) > memory[table.MOVING_THRESHOLD])
        memory[table.MOVING_STATUS] = 2 * ongoing + int(memory[table.GOAL_POSITION] == self.present)
        memory[table.PRESENT_LOAD] = round(self._load() * self.model.full_load)
        memory[table.PRESENT_VELOCITY] = round(velocity)
        memory[table.PRESENT_POSITION] = self.present
        memory[table.PRESENT_VOLTAGE] = round(self.voltage_v * 10)
        memory[table.PRESENT_TEMPERATURE] = round(self.temperature_c)

    def _load(self) -> float:
        if not self.torque:
            return 0.0
        if self.stuck:
            return math.copysign(1.0, self.memory[table.GOAL_POSITION] - self.present)
        return 0.3 if self._now_s < self._motion.end_s else 0.02


def _registers(address: int, data: bytes) -> Iterator[tuple[Register | None, int]]:
    """The registers that a write covers, with values; ``None`` for bytes that belong to none, or not to a whole one."""
    end = address + len(data)
    covered = [r for r in table.REGISTERS if r.address < end and r.end > address]
    if sum(r.size for r in covered) != len(data):
        yield None, 0
    for register in covered:
        low = register.address - address
        if low >= 0 and register.end <= end:
            yield register, int.from_bytes(data[low : low + register.size], "little", signed=register.signed)
