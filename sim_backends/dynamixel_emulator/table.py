"""The control table of the XL330, XL430 and XM430 servos: registers, what they start as and what they take.

Source: ROBOTIS e-manual, control tables of XL330-M288-T, XL430-W250-T and XM430-W350-T. Below `RAM` lies the EEPROM.
"""

from __future__ import annotations

from dataclasses import dataclass, field

RAM = 64
SIZE = 700
TICKS_PER_TURN = 4096
TICKS_PER_S = 0.229 / 60.0 * TICKS_PER_TURN
"""One unit of velocity (0.229 rev/min) in ticks per second."""
TICKS_PER_S2 = 214.577 / 3600.0 * TICKS_PER_TURN
"""One unit of acceleration (214.577 rev/min²) in ticks per second squared."""
WATCHDOG_UNIT_S = 0.02
FURTHEST = 1_048_575
"""Largest goal in the multi-turn modes, ticks."""
POSITION, EXTENDED, CURRENT_BASED = 3, 4, 5


@dataclass(frozen=True, slots=True)
class Register:
    """One entry; ``low`` and ``high`` bound what may be written (``None``: read only)."""

    address: int
    size: int
    initial: int = 0
    low: int | None = None
    high: int = 0

    @property
    def end(self) -> int:
        """The address behind it."""
        return self.address + self.size

    @property
    def signed(self) -> bool:
        """Its values may be negative."""
        return self.low is not None and self.low < 0


MODEL_NUMBER = Register(0, 2)
FIRMWARE = Register(6, 1)
SERVO_ID = Register(7, 1, 1, 0, 252)
BAUD_CODE = Register(8, 1, 3, 0, 7)
RETURN_DELAY = Register(9, 1, 250, 0, 254)
DRIVE_MODE = Register(10, 1, 0, 0, 13)
OPERATING_MODE = Register(11, 1, POSITION, 0, 16)
HOMING_OFFSET = Register(20, 4, 0, -1_044_479, 1_044_479)
MOVING_THRESHOLD = Register(24, 4, 10, 0, 1023)
TEMPERATURE_LIMIT = Register(31, 1, 72, 0, 100)
MAX_VOLTAGE = Register(32, 2, 160, 31, 160)
MIN_VOLTAGE = Register(34, 2, 60, 31, 160)
CURRENT_LIMIT = Register(38, 2, 0, 0, 2047)
VELOCITY_LIMIT = Register(44, 4, 265, 0, 2047)
MAX_POSITION = Register(48, 4, 4095, 0, 4095)
MIN_POSITION = Register(52, 4, 0, 0, 4095)
STARTUP = Register(60, 1, 0, 0, 3)
SHUTDOWN = Register(63, 1, 52, 0, 63)
TORQUE = Register(64, 1, 0, 0, 1)
LED = Register(65, 1, 0, 0, 1)
RETURN_LEVEL = Register(68, 1, 2, 0, 2)
REGISTERED = Register(69, 1)
HARDWARE_ERROR = Register(70, 1)
WATCHDOG = Register(98, 1, 0, -1, 127)
GOAL_CURRENT = Register(102, 2, 0, -2047, 2047)
GOAL_VELOCITY = Register(104, 4, 0, -2047, 2047)
PROFILE_ACCELERATION = Register(108, 4, 0, 0, 32767)
PROFILE_VELOCITY = Register(112, 4, 0, 0, 32767)
GOAL_POSITION = Register(116, 4, 0, -FURTHEST, FURTHEST)
REALTIME_TICK = Register(120, 2)
MOVING = Register(122, 1)
MOVING_STATUS = Register(123, 1)
PRESENT_LOAD = Register(126, 2)
PRESENT_VELOCITY = Register(128, 4)
PRESENT_POSITION = Register(132, 4)
PRESENT_VOLTAGE = Register(144, 2)
PRESENT_TEMPERATURE = Register(146, 1)
INDIRECT = tuple(Register(168 + 2 * n, 2, 224 + n, RAM, 227) for n in range(20))
"""Indirect addresses: RAM, written only while torque is off."""

REGISTERS = (
    *(MODEL_NUMBER, FIRMWARE, SERVO_ID, BAUD_CODE, RETURN_DELAY, DRIVE_MODE, OPERATING_MODE, HOMING_OFFSET),
    *(MOVING_THRESHOLD, TEMPERATURE_LIMIT, MAX_VOLTAGE, MIN_VOLTAGE, CURRENT_LIMIT, VELOCITY_LIMIT, MAX_POSITION),
    *(MIN_POSITION, STARTUP, SHUTDOWN, TORQUE, LED, RETURN_LEVEL, REGISTERED, HARDWARE_ERROR, WATCHDOG, GOAL_CURRENT),
    *(GOAL_VELOCITY, PROFILE_ACCELERATION, PROFILE_VELOCITY, GOAL_POSITION, REALTIME_TICK, MOVING, MOVING_STATUS),
    *(PRESENT_LOAD, PRESENT_VELOCITY, PRESENT_POSITION, PRESENT_VOLTAGE, PRESENT_TEMPERATURE, *INDIRECT),
)
GOALS = frozenset({GOAL_CURRENT, GOAL_VELOCITY, PROFILE_ACCELERATION, PROFILE_VELOCITY, GOAL_POSITION})
"""Refused while the bus watchdog has tripped."""
BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)


@dataclass(frozen=True)
class Model:
    """A servo as sold: its number, what it runs on, and where its registers differ."""

    name: str
    number: int
    modes: frozenset[int]
    voltage_v: float
    full_load: int
    """Raw value of the load (0.1 %) or current register when it gives all it can."""
    initial: dict[Register, int] = field(default_factory=dict)


MODELS = {
    model.name: model
    for model in (
        Model(
            "XL330-M288",
            1200,
            frozenset({0, 1, 3, 4, 5, 16}),
            5.0,
            1750,
            {TEMPERATURE_LIMIT: 70, MAX_VOLTAGE: 70, MIN_VOLTAGE: 35, CURRENT_LIMIT: 1750, VELOCITY_LIMIT: 445},
        ),
        Model("XL430-W250", 1060, frozenset({1, 3, 4, 16}), 11.1, 1000),
        Model(
            "XM430-W350",
            1020,
            frozenset({0, 1, 3, 4, 5, 16}),
            12.0,
            1193,
            {TEMPERATURE_LIMIT: 80, MIN_VOLTAGE: 95, CURRENT_LIMIT: 1193, VELOCITY_LIMIT: 200},
        ),
    )
}
"""By name."""


class Memory:
    """A servo's registers as bytes."""

    def __init__(self, model: Model) -> None:
        """All registers as the factory sets them."""
        self._model = model
        self._bytes = bytearray(SIZE)
        self.reset(0)
        self[MODEL_NUMBER], self[FIRMWARE] = model.number, 45

    def reset(self, lowest: int) -> None:
        """Set all registers from an address on to what they start as."""
        for register in REGISTERS:
            if register.address >= lowest:
                self[register] = self._model.initial.get(register, register.initial)

    def __getitem__(self, register: Register) -> int:
        return int.from_bytes(self._bytes[register.address : register.end], "little", signed=register.signed)

    def __setitem__(self, register: Register, value: int) -> None:
        raw = (value % (1 << 8 * register.size)).to_bytes(register.size, "little")
        self._bytes[register.address : register.end] = raw

    def read(self, address: int, length: int) -> bytes:
        """Bytes as they lie."""
        return bytes(self._bytes[address : address + length])
