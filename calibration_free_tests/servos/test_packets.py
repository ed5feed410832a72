"""The emulator's packets and the SDK's are the same bytes, found again in any stream."""

from __future__ import annotations

from typing import Any

import pytest
from dynamixel_sdk import COMM_SUCCESS, PortHandler
from hypothesis import given
from hypothesis import strategies as st

from drivers.dynamixel import DynamixelBus
from drivers.dynamixel.sdk_port import SdkPackets
from rig.errors import HardwareError
from sim_backends.dynamixel_emulator.packets import (
    HEADER,
    Instruction,
    Packet,
    PacketReader,
    crc16,
    packet,
    status_packet,
    stuff,
    unstuff,
)
from sim_backends.simulated_clock import SimulatedClock

SDK: Any = SdkPackets()
# Headers, and bytes that could become one, come often.
PIECES = st.sampled_from([HEADER, HEADER + b"\xfd", b"\xff", b"\xff\xff", b"\xfd"]) | st.binary(max_size=4)
PAYLOAD = st.lists(PIECES, max_size=15).map(b"".join)
SERVO_IDS = st.integers(0, 252)


class Tape(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """A port that keeps what is written and plays what it was given."""

    def __init__(self, played: bytes = b"") -> None:
        super().__init__("tape")
        self.written, self.played = b"", played

    def clearPort(self) -> None:  # noqa: N802  # the names are the SDK's
        pass

    def writePort(self, packet: Any) -> int:  # noqa: N802
        self.written += bytes(packet)
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        data, self.played = self.played[:length], self.played[length:]
        return data


def read_back(data: bytes) -> list[Packet]:
    reader = PacketReader()
    found = [reader.feed(value, 0.0) for value in data]
    return [one for one in found if one is not None]


@given(PAYLOAD)
def test_the_checksum_is_the_sdks(data: bytes) -> None:
    assert crc16(data) == SDK.updateCRC(0, list(data), len(data))


@given(PAYLOAD)
def test_stuffing_leaves_no_header_and_comes_off_again(body: bytes) -> None:
    stuffed = stuff(body)
    assert HEADER not in stuffed.replace(HEADER + b"\xfd", b"\x00")
    assert unstuff(stuffed) == body


@given(SERVO_IDS, st.integers(0, 600), PAYLOAD.filter(bool))
def test_what_the_sdk_writes_the_servo_reads(servo_id: int, address: int, data: bytes) -> None:
    tape = Tape()
    SDK.writeTxOnly(tape, servo_id, address, len(data), list(data))
    parameters = address.to_bytes(2, "little") + data
    assert tape.written == packet(servo_id, bytes([Instruction.WRITE]) + parameters)
    assert read_back(tape.written) == [Packet(servo_id, Instruction.WRITE, parameters, intact=True)]


@given(SERVO_IDS, st.sampled_from([0, 7, 128]), PAYLOAD)
def test_what_the_servo_answers_the_sdk_reads(servo_id: int, error: int, data: bytes) -> None:
    tape = Tape(status_packet(servo_id, error, data))
    tape.setPacketTimeoutMillis(0.0)
    received, result = SDK.rxPacket(tape, False)
    length = int.from_bytes(bytes(received[5:7]), "little")
    assert (result, received[4], received[8]) == (COMM_SUCCESS, servo_id, error)
    assert bytes(received[9 : 5 + length]) == data


@given(st.lists(st.tuples(SERVO_IDS, PAYLOAD.filter(bool)), min_size=1, max_size=4), st.binary(max_size=6))
def test_packets_are_found_behind_noise(messages: list[tuple[int, bytes]], noise: bytes) -> None:
    # Noise that looks like the beginning of a packet may swallow the next one: protocol 2.0 cannot do better.
    noise = noise.replace(b"\xff", b"\x00")
    stream = b"".join(noise + packet(servo_id, body) for servo_id, body in messages)
    assert [(one.servo_id, one.instruction, one.parameters) for one in read_back(stream)] == [
        (servo_id, body[0], body[1:]) for servo_id, body in messages
    ]


@given(SERVO_IDS, PAYLOAD.filter(bool), st.data())
def test_one_flipped_bit_is_never_taken_for_a_packet(servo_id: int, body: bytes, data: st.DataObject) -> None:
    raw = bytearray(packet(servo_id, body))
    raw[data.draw(st.integers(0, len(raw) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    assert not [one for one in read_back(bytes(raw)) if one.intact]


def test_a_pause_ends_a_packet_that_was_cut_off() -> None:
    reader = PacketReader()
    whole = packet(1, b"\x01")
    for value in whole[:-3]:
        assert reader.feed(value, 0.0) is None
    found = [reader.feed(value, 1.0) for value in whole]
    assert found[-1] == Packet(1, 1, b"", intact=True)


def test_a_header_that_was_not_stuffed_costs_the_packet() -> None:
    raw = HEADER + b"\x00\x01\x09\x00\x03\x74\x00" + HEADER + b"\xff"
    raw += crc16(raw).to_bytes(2, "little")
    assert read_back(raw) == []


def test_the_goal_that_looks_like_a_header_is_stuffed() -> None:
    tape = Tape()
    SDK.write4ByteTxOnly(tape, 1, 116, -131073)
    assert HEADER + b"\xfd\xff" in tape.written
    (found,) = read_back(tape.written)
    assert int.from_bytes(found.parameters[2:], "little", signed=True) == -131073


class Noise:
    """A line that never falls silent: a wrong baud rate, a floating pair. Reading takes its time, as on a real one."""

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock, self.in_waiting = clock, 64

    def read(self, size: int = 1, /) -> bytes:
        self.clock.sleep_s(size * 10.0 / 57600)
        return b"\x55" * size

    def write(self, data: bytes, /) -> int:
        return len(data)

    def close(self) -> None:
        return None


def test_a_line_that_never_falls_silent_is_given_up_in_time() -> None:
    clock = SimulatedClock()
    bus = DynamixelBus("noisy", 57600, clock, open_port=lambda port, baud: Noise(clock))
    bus.open(bus)
    with pytest.raises(HardwareError, match=r"Something else was heard: check the baud rate"):
        bus.ping(1)
    assert clock.now_s() < 5.0
