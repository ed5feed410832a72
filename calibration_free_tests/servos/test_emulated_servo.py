"""The emulated servo behaves as the manual says, seen through packets."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.dynamixel_emulator import table
from sim_backends.dynamixel_emulator.bus import EmulatedBus
from sim_backends.dynamixel_emulator.packets import BROADCAST, ErrorCode, Instruction, fast_sync_packet, packet
from sim_backends.dynamixel_emulator.profile import motion
from sim_backends.dynamixel_emulator.servo import HEAT, OVERLOAD, VOLTAGE, Servo
from sim_backends.dynamixel_emulator.table import Register
from sim_backends.faults import Fault, FaultKind, WireByte


class Wire:
    """Sends packets to a bus and takes the raw answers."""

    def __init__(self, *servos: Servo) -> None:
        self.bus = EmulatedBus(servos)
        self.now_s = 1.0

    def send(self, servo_id: int, instruction: Instruction, parameters: bytes = b"") -> list[bytes]:
        for value in packet(servo_id, bytes([instruction]) + parameters):
            self.bus.advance_to(self.now_s)
            self.bus.receive(WireByte(self.now_s, value, altered=False, sent_at_s=self.now_s))
        self.wait(0.01)
        return [data for _, data in self.bus.take_output()]

    def wait(self, seconds: float) -> None:
        self.now_s += seconds
        self.bus.advance_to(self.now_s)

    def write(self, servo_id: int, register: Register, value: int) -> int:
        """Error byte of the answer."""
        data = (value % (1 << 8 * register.size)).to_bytes(register.size, "little")
        (answer,) = self.send(servo_id, Instruction.WRITE, register.address.to_bytes(2, "little") + data)
        return answer[8]

    def read(self, servo_id: int, register: Register) -> int:
        """Value, with its sign."""
        where = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        (answer,) = self.send(servo_id, Instruction.READ, where)
        return int.from_bytes(answer[9 : 9 + register.size], "little", signed=register.size == 4)


def extended(model: str = "XM430-W350", servo_id: int = 1, **more: float) -> Servo:
    servo = Servo(table.MODELS[model], servo_id, **more)  # type: ignore[arg-type]
    servo.memory[table.OPERATING_MODE] = table.EXTENDED
    return servo


def where(address: int, length: int) -> bytes:
    return address.to_bytes(2, "little") + length.to_bytes(2, "little")


@pytest.mark.parametrize(("model", "number"), [("XL330-M288", 1200), ("XL430-W250", 1060), ("XM430-W350", 1020)])
def test_a_ping_tells_the_model(model: str, number: int) -> None:
    (answer,) = Wire(Servo(table.MODELS[model], 7)).send(7, Instruction.PING)
    assert int.from_bytes(answer[9:11], "little") == number


def test_eeprom_is_locked_while_torque_is_on() -> None:
    wire = Wire(extended())
    assert wire.write(1, table.OPERATING_MODE, table.POSITION) == ErrorCode.NONE
    assert wire.write(1, table.TORQUE, 1) == ErrorCode.NONE
    assert wire.write(1, table.OPERATING_MODE, table.EXTENDED) == ErrorCode.ACCESS
    assert wire.read(1, table.OPERATING_MODE) == table.POSITION


@pytest.mark.parametrize(
    ("register", "value", "error"),
    [
        (table.PRESENT_POSITION, 5, ErrorCode.ACCESS),
        (table.GOAL_POSITION, table.FURTHEST + 1, ErrorCode.DATA_RANGE),
        (table.OPERATING_MODE, table.CURRENT_BASED, ErrorCode.DATA_RANGE),
        (Register(117, 2), 5, ErrorCode.ACCESS),
    ],
)
def test_writes_that_cannot_be_are_refused(register: Register, value: int, error: ErrorCode) -> None:
    assert Wire(extended("XL430-W250")).write(1, register, value) == error


def test_position_mode_refuses_goals_beyond_its_limits() -> None:
    servo = extended()
    servo.memory[table.OPERATING_MODE] = table.POSITION
    assert Wire(servo).write(1, table.GOAL_POSITION, 4096) == ErrorCode.DATA_LIMIT


def test_turns_are_lost_with_the_power_and_the_place_within_a_turn_is_kept() -> None:
    wire = Wire(extended(shaft_ticks=2048.0))
    wire.bus.servos[0].turn_by_hand(-10_000.0)
    assert wire.read(1, table.PRESENT_POSITION) == -7952
    wire.send(1, Instruction.REBOOT)
    wire.wait(1.0)
    assert wire.read(1, table.PRESENT_POSITION) == -7952 % 4096
    assert wire.bus.servos[0].shaft_ticks == -7952.0


def test_a_servo_in_its_reboot_is_silent() -> None:
    wire = Wire(extended())
    wire.send(1, Instruction.REBOOT)
    assert wire.send(1, Instruction.PING) == []


def test_torque_on_goes_to_whatever_goal_is_there() -> None:
    wire = Wire(extended())
    wire.write(1, table.GOAL_POSITION, 4096)
    wire.write(1, table.TORQUE, 1)
    wire.wait(3.0)
    assert wire.read(1, table.PRESENT_POSITION) == 4096


def test_the_watchdog_stops_a_servo_that_hears_nothing_and_goals_are_refused_until_it_is_cleared() -> None:
    wire = Wire(extended())
    for register, value in ((table.PROFILE_VELOCITY, 50), (table.TORQUE, 1), (table.WATCHDOG, 10)):
        assert wire.write(1, register, value) == ErrorCode.NONE
    wire.write(1, table.GOAL_POSITION, 100_000)
    wire.wait(1.0)
    assert wire.read(1, table.WATCHDOG) == 0xFF
    stopped = wire.read(1, table.PRESENT_POSITION)
    assert 2048 + 100 < stopped < 2048 + 200  # 0.2 s at 782 ticks/s
    assert wire.write(1, table.GOAL_POSITION, stopped) == ErrorCode.DATA_RANGE
    wire.wait(1.0)
    assert wire.read(1, table.PRESENT_POSITION) == stopped
    assert wire.write(1, table.WATCHDOG, 0) == ErrorCode.NONE
    assert wire.write(1, table.GOAL_POSITION, stopped) == ErrorCode.NONE


def test_heat_drops_torque_raises_the_alert_and_lasts_until_reboot() -> None:
    servo = extended()
    wire = Wire(servo)
    wire.write(1, table.TORQUE, 1)
    wire.bus.apply_fault(Fault(FaultKind.OVERHEAT, at_s=0.0))
    wire.wait(0.1)
    (answer,) = wire.send(1, Instruction.READ, where(64, 1))
    assert answer[8] == 128
    assert not servo.torque
    assert wire.read(1, table.HARDWARE_ERROR) == HEAT
    assert wire.write(1, table.TORQUE, 1) & 0x7F == ErrorCode.RESULT_FAIL
    servo.temperature_c = 30.0
    wire.send(1, Instruction.REBOOT)
    wire.wait(1.0)
    assert wire.write(1, table.TORQUE, 1) == ErrorCode.NONE


def test_a_stuck_servo_is_overloaded_after_a_while() -> None:
    servo = extended()
    wire = Wire(servo)
    wire.write(1, table.TORQUE, 1)
    servo.jam(1e9)
    wire.write(1, table.GOAL_POSITION, 4000)
    wire.wait(0.5)
    assert wire.read(1, table.HARDWARE_ERROR) == 0
    wire.wait(1.0)
    assert wire.read(1, table.HARDWARE_ERROR) == OVERLOAD
    assert not servo.torque


def test_low_voltage_is_reported_and_shuts_down_only_what_is_told_to() -> None:
    servo = extended()
    wire = Wire(servo)
    wire.write(1, table.TORQUE, 1)
    servo.voltage_v = 8.0
    wire.wait(0.1)
    assert wire.read(1, table.HARDWARE_ERROR) == VOLTAGE
    assert servo.torque


def test_the_status_return_level_decides_what_is_answered() -> None:
    wire = Wire(extended())
    wire.send(1, Instruction.WRITE, table.RETURN_LEVEL.address.to_bytes(2, "little") + b"\x01")
    assert wire.send(1, Instruction.WRITE, table.LED.address.to_bytes(2, "little") + b"\x01") == []
    assert len(wire.send(1, Instruction.READ, where(65, 1))) == 1
    wire.send(1, Instruction.WRITE, table.RETURN_LEVEL.address.to_bytes(2, "little") + b"\x00")
    assert wire.send(1, Instruction.READ, where(65, 1)) == []
    assert len(wire.send(1, Instruction.PING)) == 1


def test_the_return_delay_is_kept() -> None:
    servo = extended()
    servo.memory[table.RETURN_DELAY] = 100
    wire = Wire(servo)
    for value in packet(1, bytes([Instruction.PING])):
        wire.bus.receive(WireByte(1.0, value, altered=False, sent_at_s=1.0))
    assert wire.bus.next_event_s() == pytest.approx(1.0002)


def test_a_registered_write_waits_for_the_action() -> None:
    wire = Wire(extended())
    wire.write(1, table.TORQUE, 1)
    wire.send(
        1, Instruction.REG_WRITE, table.GOAL_POSITION.address.to_bytes(2, "little") + (3000).to_bytes(4, "little")
    )
    wire.wait(2.0)
    assert (wire.read(1, table.PRESENT_POSITION), wire.read(1, table.REGISTERED)) == (2048, 1)
    assert wire.send(BROADCAST, Instruction.ACTION) == []
    wire.wait(2.0)
    assert (wire.read(1, table.PRESENT_POSITION), wire.read(1, table.REGISTERED)) == (3000, 0)


def test_sync_write_reaches_each_servo_and_nobody_answers() -> None:
    wire = Wire(extended(), extended("XL330-M288", 2))
    values = b"\x01" + (100).to_bytes(4, "little") + b"\x02" + (-200 % 2**32).to_bytes(4, "little")
    assert wire.send(BROADCAST, Instruction.SYNC_WRITE, where(116, 4) + values) == []
    assert (wire.read(1, table.GOAL_POSITION), wire.read(2, table.GOAL_POSITION)) == (100, -200)


def test_servos_behind_a_mute_one_do_not_answer_a_sync_read() -> None:
    wire = Wire(extended(), extended("XL330-M288", 2), extended("XL330-M288", 3))
    ids = where(132, 4) + b"\x01\x02\x03"
    assert [answer[4] for answer in wire.send(BROADCAST, Instruction.SYNC_READ, ids)] == [1, 2, 3]
    wire.bus.servo(2).mute_until_s = 1e9
    assert [answer[4] for answer in wire.send(BROADCAST, Instruction.SYNC_READ, ids)] == [1]
    assert wire.send(BROADCAST, Instruction.FAST_SYNC_READ, ids) == []


def test_a_fast_sync_read_is_one_packet_of_all() -> None:
    wire = Wire(extended(), extended("XL330-M288", 2, shaft_ticks=100.0))
    (answer,) = wire.send(BROADCAST, Instruction.FAST_SYNC_READ, where(132, 4) + b"\x01\x02")
    parts = [(0, 1, (2048).to_bytes(4, "little")), (0, 2, (100).to_bytes(4, "little"))]
    assert answer == fast_sync_packet(parts)


def test_a_bulk_read_asks_each_for_something_else() -> None:
    wire = Wire(extended(), extended("XL330-M288", 2))
    wanted = b"\x01" + where(132, 4) + b"\x02" + where(0, 2)
    first, second = wire.send(BROADCAST, Instruction.BULK_READ, wanted)
    assert int.from_bytes(first[9:13], "little") == 2048
    assert int.from_bytes(second[9:11], "little") == 1200


def test_a_factory_reset_is_refused_and_recorded() -> None:
    wire = Wire(extended())
    (answer,) = wire.send(1, Instruction.FACTORY_RESET, b"\xff")
    assert answer[8] == ErrorCode.RESULT_FAIL
    assert "factory reset" in wire.bus.monitor.violations[0]


def test_at_another_baud_rate_nobody_hears() -> None:
    wire = Wire(extended(baud=57600))
    wire.bus.host_baud = 1_000_000
    assert wire.send(1, Instruction.PING) == []
    wire.bus.host_baud = 57600
    assert len(wire.send(1, Instruction.PING)) == 1


@pytest.mark.parametrize(
    ("told", "act", "word"),
    [
        (False, "goal", ""),
        (True, "goal", "torque is off"),
        (True, "torque", "goal 952 ticks away"),
    ],
)
def test_the_monitor_judges_by_what_the_host_was_told(told: bool, act: str, word: str) -> None:
    wire = Wire(extended())
    wire.write(1, table.TORQUE, 1)
    wire.send(1, Instruction.READ, where(64, 110))
    wire.bus.servos[0].write(64, b"\x00")
    wire.bus.servos[0].write(168, b"\x78\x00")
    if told:
        wire.send(1, Instruction.READ, where(64, 110))
    if act == "goal":
        wire.write(1, table.GOAL_POSITION, 3000)
    else:
        wire.bus.servos[0].write(116, (3000).to_bytes(4, "little"))
        wire.write(1, table.TORQUE, 1)
    text = " ".join(wire.bus.monitor.violations)
    assert word in text
    assert bool(text) == bool(word) or not told


speeds = st.floats(10.0, 5000.0)


@given(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5), st.floats(-1.0, 1.0), speeds, speeds)
def test_a_profile_keeps_its_speed_and_ends_at_rest_at_its_goal(
    start: float, goal: float, share: float, speed: float, acceleration: float
) -> None:
    way = motion(start, share * speed, goal, speed, acceleration, 10.0)
    assert way.at(way.end_s + 1.0) == (goal, 0.0)
    just_before, velocity = way.at(way.end_s - 1e-9)
    assert just_before == pytest.approx(goal, abs=1e-3 + 1e-9 * abs(goal))
    assert abs(velocity) < 1e-2
    for step in range(21):
        assert abs(way.at(10.0 + (way.end_s - 10.0) * step / 20)[1]) <= speed * (1.0 + 1e-9)
