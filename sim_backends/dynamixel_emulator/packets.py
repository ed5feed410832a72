"""Dynamixel protocol 2.0 packets: CRC, byte stuffing, building, and finding them in a stream of bytes.

Source: ROBOTIS e-manual, "DYNAMIXEL Protocol 2.0". A packet is ``FF FF FD 00 id length instruction parameters crc``;
the length counts what follows it; ``FF FF FD`` after the length is stuffed to ``FF FF FD FD``. Written apart from the
SDK on purpose, so that each checks the other.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

HEADER = b"\xff\xff\xfd"
BROADCAST = 0xFE
HIGHEST_ID = 0xFC
MAX_LENGTH = 1024
"""Longest length field that a servo takes; more is noise."""
PAUSE_S = 0.02
"""A pause this long within a packet ends it: the servo waits for a header again."""


class Instruction(enum.IntEnum):
    """What a packet asks for."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92


class ErrorCode(enum.IntEnum):
    """The lower seven bits of a status packet's error byte."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT = 0x80
"""Bit of the error byte: the servo has a hardware error."""


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x8005, no reflection, starting at 0."""
    crc = 0
    for value in data:
        crc = (crc << 8 & 0xFFFF) ^ _CRC_TABLE[crc >> 8 ^ value]
    return crc


def _crc_of_high_byte(value: int) -> int:
    crc = value << 8
    for _ in range(8):
        crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


_CRC_TABLE = tuple(_crc_of_high_byte(value) for value in range(256))


def stuff(body: bytes) -> bytes:
    """Instruction and parameters as they go on the wire."""
    return body.replace(HEADER, HEADER + b"\xfd")


def unstuff(body: bytes) -> bytes:
    """The inverse of `stuff`."""
    return body.replace(HEADER + b"\xfd", HEADER)


def packet(servo_id: int, body: bytes) -> bytes:
    """A whole packet around instruction and parameters."""
    stuffed = stuff(body)
    head = HEADER + bytes([0, servo_id]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return head + crc16(head).to_bytes(2, "little")


def status_packet(servo_id: int, error: int, parameters: bytes = b"") -> bytes:
    """A servo's answer."""
    return packet(servo_id, bytes([Instruction.STATUS, error]) + parameters)


def fast_sync_packet(answers: list[tuple[int, int, bytes]]) -> bytes:
    """The one answer of several servos (error, id, parameters) to a fast sync read.

    Nothing in it is stuffed: the first servo sends the length for all before the others' data is known. Each servo
    closes its part with the CRC of all before it.
    """
    length = 1 + sum(4 + len(parameters) for _, _, parameters in answers)
    whole = HEADER + bytes([0, BROADCAST]) + length.to_bytes(2, "little") + bytes([Instruction.STATUS])
    for error, servo_id, parameters in answers:
        whole += bytes([error, servo_id]) + parameters
        whole += crc16(whole).to_bytes(2, "little")
    return whole


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet that was found in the stream; ``intact``: its CRC holds."""

    servo_id: int
    instruction: int
    parameters: bytes
    intact: bool


@dataclass
class PacketReader:
    """Finds packets in bytes that come one by one, however they are split, and what noise lies between them."""

    _buffer: bytearray = field(default_factory=bytearray)
    _last_s: float = 0.0

    def feed(self, value: int, at_s: float) -> Packet | None:
        """Take one byte; returns the packet that it completes."""
        if at_s - self._last_s > PAUSE_S:
            self._buffer.clear()
        self._last_s = at_s
        self._buffer.append(value)
        self._seek_header()
        if len(self._buffer) < 7:
            return None
        length = int.from_bytes(self._buffer[5:7], "little")
        if not 3 <= length <= MAX_LENGTH:
            del self._buffer[0]
            self._seek_header()
            return None
        if len(self._buffer) < 7 + length:
            self._restart_at_header(length)
            return None
        raw = bytes(self._buffer)
        self._buffer.clear()
        body = unstuff(raw[7:-2])
        return Packet(raw[4], body[0], body[1:], crc16(raw[:-2]) == int.from_bytes(raw[-2:], "little"))

    def _restart_at_header(self, length: int) -> None:
        """A header within a packet that is not stuffed begins another packet: that is what the stuffing is for."""
        tail = self._buffer[-4:]
        if 11 <= len(self._buffer) <= 6 + length and tail[:3] == HEADER and tail[3] != HEADER[2]:
            self._buffer = tail
            self._seek_header()

    def _seek_header(self) -> None:
        """Drop bytes from the front until what is left could be the beginning of a packet."""
        opening = HEADER + b"\x00"
        while self._buffer and not opening.startswith(self._buffer[:4]):
            del self._buffer[0]
