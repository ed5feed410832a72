"""The servos' control table as far as the driver needs it: addresses, units, and what a block of registers means.

Source: ROBOTIS e-manual, control tables of XL330, XL430 and XM430. The state of a servo is read in one block, so that
all of it is of one moment.
"""

from __future__ import annotations

from dataclasses import dataclass

TICKS_PER_TURN = 4096
VELOCITY_DEG_PER_S = 0.229 * 6.0
"""One unit of velocity at the servo's horn."""
ACCELERATION_DEG_PER_S2 = 214.577 * 360.0 / 3600.0
"""One unit of acceleration at the servo's horn."""
WATCHDOG_UNIT_MS = 20
FURTHEST_TICKS = 1_048_575
"""Largest goal in the multi-turn modes."""
MODES = {"position": 3, "extended": 4, "current_based": 5}
SHUT_DOWN_BY = {0x01: "input voltage", 0x04: "overheating", 0x08: "encoder", 0x10: "electrical shock", 0x20: "overload"}
"""Bits of the hardware error status."""


@dataclass(frozen=True, slots=True)
class Register:
    """An entry of the control table that the driver writes; ``attribute`` is where `ServoState` shows it."""

    name: str
    attribute: str
    address: int
    size: int

    def encode(self, value: int) -> bytes:
        """As it goes on the wire; two's complement where negative."""
        return (value % (1 << 8 * self.size)).to_bytes(self.size, "little")

    def shown_in(self, state: ServoState) -> int:
        """Its value in a state."""
        return int(getattr(state, self.attribute))


TORQUE = Register("torque", "torque", 64, 1)
WATCHDOG = Register("bus watchdog", "watchdog", 98, 1)
GOAL_CURRENT = Register("goal current", "goal_current", 102, 2)
PROFILE_ACCELERATION = Register("profile acceleration", "profile_acceleration", 108, 4)
PROFILE_VELOCITY = Register("profile velocity", "profile_velocity", 112, 4)
GOAL = Register("goal position", "goal", 116, 4)
NOTE = Register("reference note", "note", 168, 6)
"""Three indirect addresses, which nothing here uses otherwise: RAM, so what they hold goes when the power goes."""

SETUP_ADDRESS, SETUP_LENGTH = 0, 64
STATE_ADDRESS, STATE_LENGTH = 64, 110


@dataclass(frozen=True, slots=True)
class Model:
    """A servo as sold. ``current_unit_ma`` is ``None`` where it measures load instead of current."""

    name: str
    number: int
    current_unit_ma: float | None


MODELS = {
    model.name: model
    for model in (
        Model("XL330-M077", 1190, 1.0),
        Model("XL330-M288", 1200, 1.0),
        Model("XL430-W250", 1060, None),
        Model("XM430-W350", 1020, 2.69),
        Model("XM430-W210", 1030, 2.69),
    )
}
"""By name."""


def model_named(number: int) -> str:
    """Name of a model number, for messages."""
    return next((m.name for m in MODELS.values() if m.number == number), f"unknown model {number}")


@dataclass(frozen=True, slots=True)
class Setup:
    """What is kept in EEPROM, addresses 0 to 63."""

    model_number: int
    firmware: int
    servo_id: int
    drive_mode: int
    operating_mode: int
    homing_offset: int
    current_limit: int
    max_position: int
    min_position: int
    startup: int


def parse_setup(block: bytes) -> Setup:
    """The block from `SETUP_ADDRESS`, `SETUP_LENGTH` bytes."""
    return Setup(
        model_number=_unsigned(block, 0, 2),
        firmware=block[6],
        servo_id=block[7],
        drive_mode=block[10],
        operating_mode=block[11],
        homing_offset=_signed(block, 20, 4),
        current_limit=_unsigned(block, 38, 2),
        max_position=_unsigned(block, 48, 4),
        min_position=_unsigned(block, 52, 4),
        startup=block[60],
    )


@dataclass(frozen=True, slots=True)
class ServoState:
    """A servo at one moment, in its own units; positions in ticks as the servo counts them.

    Attributes:
        watchdog: units of 20 ms, 0 off, -1 tripped.
        ongoing: its profile has not ended yet.
        note: see `note_of`; whatever the registers hold where there is none.
    """

    torque: bool
    hardware_error: int
    watchdog: int
    goal_current: int
    profile_acceleration: int
    profile_velocity: int
    goal: int
    moving: bool
    ongoing: bool
    load: int
    velocity: int
    position: int
    voltage_v: float
    temperature_c: float
    note: int

    @property
    def turns(self) -> int | None:
        """The turns that are noted; ``None``: the note was lost with the power, or never written."""
        return _turns_in(self.note)

    @property
    def at_rest(self) -> bool:
        """It neither moves nor means to."""
        return not (self.moving or self.ongoing or self.velocity)

    @property
    def halt_ticks(self) -> int:
        """Where it can come to rest soonest on its way to the goal: a goal behind that would make it turn back."""
        if not self.profile_acceleration:
            return self.position
        speed_deg_per_s = abs(self.velocity) * VELOCITY_DEG_PER_S
        braking_deg = speed_deg_per_s**2 / (2.0 * self.profile_acceleration * ACCELERATION_DEG_PER_S2)
        braking = min(round(braking_deg * TICKS_PER_TURN / 360.0), abs(self.goal - self.position))
        return self.position + (braking if self.velocity > 0 else -braking)


def parse_state(block: bytes) -> ServoState:
    """The block from `STATE_ADDRESS`; what lies behind `STATE_LENGTH` is not looked at."""

    def signed(address: int, size: int) -> int:
        return _signed(block, address - STATE_ADDRESS, size)

    return ServoState(
        torque=signed(64, 1) == 1,
        hardware_error=signed(70, 1) & 0xFF,
        watchdog=signed(98, 1),
        goal_current=signed(102, 2),
        profile_acceleration=signed(108, 4),
        profile_velocity=signed(112, 4),
        goal=signed(116, 4),
        moving=signed(122, 1) != 0,
        ongoing=bool(signed(123, 1) & 2),
        load=signed(126, 2),
        velocity=signed(128, 4),
        position=signed(132, 4),
        voltage_v=signed(144, 2) / 10.0,
        temperature_c=float(signed(146, 1)),
        note=_unsigned(block, NOTE.address - STATE_ADDRESS, NOTE.size),
    )


_SIGNATURE, _MIDDLE = 120, 96
MOST_TURNS = 30
"""Most turns that a note can hold: its words must be addresses that every model takes (66 to 126)."""


def note_of(turns: int) -> int:
    """The note that this many turns must be added to the servo's own count: a signature, the turns, and a check."""
    return _SIGNATURE | _MIDDLE + turns << 16 | _MIDDLE - turns << 32


def _turns_in(note: int) -> int | None:
    signature, turns, check = (note >> shift & 0xFFFF for shift in (0, 16, 32))
    return turns - _MIDDLE if signature == _SIGNATURE and turns + check == 2 * _MIDDLE else None


def _unsigned(block: bytes, at: int, size: int) -> int:
    return int.from_bytes(block[at : at + size], "little")


def _signed(block: bytes, at: int, size: int) -> int:
    return int.from_bytes(block[at : at + size], "little", signed=True)
