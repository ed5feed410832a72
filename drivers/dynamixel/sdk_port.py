"""The SDK's port on a clock and a serial port that are passed in, and its packet handler with stuffing that works."""

from __future__ import annotations

from dynamixel_sdk import PortHandler
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from drivers.serial_link import SerialPort
from rig.devices import Clock

_HEARD_MOST = 256
_CLEARED_MOST = 4
_STUFFED = b"\xff\xff\xfd\xfd"


class SdkPort(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """A `PortHandler` whose time-outs count on the given clock. ``heard``: what came since it was last cleared."""

    def __init__(self, port: SerialPort, baud: int, clock: Clock, latency_ms: int) -> None:
        """Take over an open port; ``latency_ms`` is the adapter's latency timer."""
        super().__init__("")
        self.ser, self.baudrate, self.is_open = port, baud, True
        self.tx_time_per_byte = 10.0 * 1000.0 / baud
        self.heard = bytearray()
        self._clock, self._latency_ms = clock, latency_ms

    # The names are the SDK's.

    def clearPort(self) -> None:  # noqa: N802
        """Drop what has arrived; of a line that never falls silent, what arrives at once."""
        for _ in range(_CLEARED_MOST):
            if not (waiting := self.ser.in_waiting):
                return
            self.ser.read(waiting)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Read, and keep for messages what was read.

        Nothing once the packet's time is over: the SDK looks at the time only when bytes are missing, so that a line
        that never falls silent (a wrong baud rate, a floating pair) would keep it for ever.
        """
        if self.isPacketTimeout():
            return b""
        data: bytes = self.ser.read(length) if length > 0 else b""
        self.heard = (self.heard + data)[-_HEARD_MOST:]
        return data

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """How long to wait for so many bytes: the SDK's rule, with the real latency timer instead of 16 ms."""
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + 2.0 * self._latency_ms + 2.0)

    def getCurrentTime(self) -> float:  # noqa: N802
        """Milliseconds. The SDK would take the wall clock, which may jump."""
        return self._clock.now_s() * 1000.0


class SdkPackets(Protocol2PacketHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's packet handler with byte stuffing that works; SDK 4.1.0 errs in both directions.

    Sending, it stuffs a copy and sends the original: a goal such as -131073, whose bytes hold a packet's header, never
    reaches the servo. Receiving, it looks for stuffing in bytes that it has already moved, and may drop one too many.
    """

    # The names are the SDK's.

    def addStuffing(self, packet: list[int]) -> list[int]:  # noqa: N802
        """Stuff the packet in its place."""
        packet[:] = super().addStuffing(packet)
        return packet

    def removeStuffing(self, packet: list[int]) -> list[int]:  # noqa: N802
        """The packet as it was before stuffing."""
        end = 5 + int.from_bytes(bytes(packet[5:7]), "little")
        body = bytes(packet[7:end]).replace(_STUFFED, _STUFFED[:-1])
        return [*packet[:5], *(len(body) + 2).to_bytes(2, "little"), *body, *packet[end : end + 2]]
