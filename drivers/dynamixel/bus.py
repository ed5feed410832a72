"""One Dynamixel bus: the SDK's port and packets behind one lock, with bounded retries and no stale answers.

Several axes may share a bus; any thread may use it. Protocol 2.0 has no sequence numbers: a late or doubled status
packet looks like the answer to the next question. So each reading of the servos' state asks for a few bytes more or
less than the one before, and an answer of another length is dropped. Writes have no such mark: they are checked by
reading back (`drivers.dynamixel.motion.write_checked`). Fast sync read is not used, since one mute servo silences it.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from dynamixel_sdk import COMM_SUCCESS

from drivers.dynamixel.answers import NoAnswerError, RefusedError, refusal, silence_of
from drivers.dynamixel.latency import open_prompt
from drivers.dynamixel.sdk_port import SdkPackets, SdkPort
from drivers.dynamixel.table import STATE_ADDRESS, STATE_LENGTH, Register, ServoState, parse_state
from drivers.serial_link import PORT_ERRORS, LinkLostError, SerialPort
from rig.devices import Clock
from rig.errors import HardwareError

ATTEMPTS = 3
"""How often a question is put before it counts as unanswered."""
_LENGTHS = 8
"""Different lengths of the state block: so many answers late may one be and still be told apart."""
_STALE_MOST = 8
_QUIET_S = 0.025
"""A pause after which servo and host both have given up what they heard only in part."""
_QUIET_TRIES = 10
_ALERT = 0x80
_CRC_ERROR = 3


class DynamixelBus:
    """A port with servos on it.

    Attributes:
        port: as the user named it.
        session: counts how often the port was opened; an axis that connected in another session must connect again.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        clock: Clock,
        *,
        latency_timer_ms: int = 16,
        open_port: Callable[[str, int], SerialPort] | None = None,
    ) -> None:
        """A bus that is not open yet.

        Args:
            port: see `drivers.serial_ports.resolve_port`.
            baud: bits per second.
            clock: times everything, the SDK's time-outs too.
            latency_timer_ms: largest latency timer of an FTDI adapter.
            open_port: opens a port by name and baud rate; one that stands in for the hardware, if given.
        """
        self.port, self.baud, self.clock, self.session = port, baud, clock, 0
        self._latency_ms = latency_timer_ms
        self._open_port = open_port or partial(open_prompt, most_ms=latency_timer_ms)
        self._lock = threading.RLock()
        self._packets: Any = SdkPackets()
        self._sdk_port: SdkPort | None = None
        self._users: list[object] = []
        self._questions = 0

    # Opening and closing.

    def open(self, user: object) -> None:
        """Open for a user, once; further users share it. Writes nothing.

        Raises:
            HardwareError: no such port, ambiguous, permission denied, or in use (names the holder).
        """
        with self._lock:
            if self._sdk_port is None:
                try:
                    port = self._open_port(self.port, self.baud)
                except PORT_ERRORS as error:
                    raise HardwareError(f"{self.port}: cannot be opened ({error}). Check cable and power") from error
                self._sdk_port = SdkPort(port, self.baud, self.clock, self._latency_ms)
                self.session += 1
            if user not in self._users:
                self._users.append(user)

    def close(self, user: object) -> None:
        """The user needs it no longer; the last one closes the port. Safe to call twice."""
        with self._lock:
            self._users = [other for other in self._users if other is not user]
            if not self._users:
                self._shut()

    def _shut(self) -> None:
        if self._sdk_port is not None:
            # A port whose device is gone may fail to close; it is gone all the same.
            with contextlib.suppress(*PORT_ERRORS):
                self._sdk_port.closePort()
            self._sdk_port = None

    # Asking and telling.

    @contextlib.contextmanager
    def undisturbed(self) -> Iterator[None]:
        """Nobody else uses the bus meanwhile. Keep it short: a STOP waits for it too."""
        with self._lock:
            yield

    def ping(self, servo_id: int) -> int:
        """Model number.

        Raises:
            NoAnswerError: nobody answers; tells what else was heard, if anything.
            LinkLostError: the port has failed.
        """
        for _ in range(ATTEMPTS):
            with self._exchange() as port:
                number, result, _ = self._packets.ping(port, servo_id)
                if result == COMM_SUCCESS:
                    return int(number)
                heard = bytes(port.heard)
            self._wait_for_quiet()
        raise NoAnswerError(f"{self.port}: {silence_of(servo_id, heard)}")

    def read(self, servo_id: int, address: int, length: int) -> bytes:
        """Registers as bytes.

        Raises:
            NoAnswerError, LinkLostError: as `ping`.
        """
        found = self._read_each([servo_id], address, length)
        if servo_id not in found:
            raise self._unanswered(servo_id)
        return found[servo_id]

    def read_states(self, servo_ids: Sequence[int]) -> dict[int, ServoState]:
        """The state of each servo that answers; the mute ones are absent.

        Raises:
            LinkLostError: the port has failed.
        """
        with self._lock:
            self._questions += 1
            length = STATE_LENGTH + self._questions % _LENGTHS
        found = self._read_each(servo_ids, STATE_ADDRESS, length)
        return {servo_id: parse_state(block) for servo_id, block in found.items()}

    def state(self, servo_id: int) -> ServoState:
        """The state of one servo.

        Raises:
            NoAnswerError, LinkLostError: as `ping`.
        """
        found = self.read_states([servo_id])
        if servo_id not in found:
            raise self._unanswered(servo_id)
        return found[servo_id]

    def write(self, register: Register, values: Mapping[int, bytes]) -> None:
        """Write one register of one servo or several, once. That it was acknowledged is no proof: read it back.

        Raises:
            RefusedError: a servo refuses. Only where one is written to: several acknowledge nothing.
            NoAnswerError: one servo does not acknowledge; it may have heard all the same.
            LinkLostError: the port has failed.
        """
        with self._exchange() as port:
            if len(values) > 1:
                raw = [byte for servo_id, data in values.items() for byte in (servo_id, *data)]
                self._packets.syncWriteTxOnly(port, register.address, register.size, raw, len(raw))
                return
            ((servo_id, data),) = values.items()
            self._packets.writeTxOnly(port, servo_id, register.address, len(data), list(data))
            port.setPacketTimeout(_ACKNOWLEDGEMENT)
            answers = self._collect(port, [servo_id], 0)
        self._judge(register.name, servo_id, answers)

    def reboot(self, servo_id: int) -> None:
        """Tell a servo to reboot.

        Raises:
            NoAnswerError, LinkLostError: as `write`.
        """
        with self._exchange() as port:
            result, _ = self._packets.reboot(port, servo_id)
        if result != COMM_SUCCESS:
            raise self._unanswered(servo_id)

    def broadcast_ping(self) -> dict[int, tuple[int, int]]:
        """Model number and firmware of everyone who answers, by id. One try; takes about a second.

        Raises:
            LinkLostError: the port has failed.
        """
        with self._exchange() as port:
            found, _ = self._packets.broadcastPing(port)
        return {int(servo_id): (int(model), int(firmware)) for servo_id, (model, firmware) in found.items()}

    # Within.

    @contextlib.contextmanager
    def _exchange(self) -> Iterator[SdkPort]:
        """The port, for one question and its answers. Whatever happens, the bus stays usable or says why not."""
        with self._lock:
            port = self._sdk_port
            if port is None:
                raise LinkLostError(f"{self.port}: not connected, or the link was lost. Connect again")
            port.heard.clear()
            try:
                yield port
            except PORT_ERRORS as error:
                self._shut()
                raise LinkLostError(
                    f"{self.port}: the port has failed ({error}). Check the cable, then connect again"
                ) from error
            finally:
                # The SDK leaves this set when an exception passes through it, and then refuses everything for ever.
                port.is_using = False

    def _read_each(self, servo_ids: Iterable[int], address: int, length: int) -> dict[int, bytes]:
        """Ask all at once, then those that did not answer one by one."""
        found: dict[int, bytes] = {}
        missing = list(servo_ids)
        for attempt in range(ATTEMPTS):
            for group in [missing] if attempt == 0 else [[servo_id] for servo_id in missing]:
                found |= self._read_once(group, address, length)
            missing = [servo_id for servo_id in missing if servo_id not in found]
            if not missing:
                break
            self._wait_for_quiet()
        return found

    def _read_once(self, servo_ids: list[int], address: int, length: int) -> dict[int, bytes]:
        with self._exchange() as port:
            if len(servo_ids) > 1:
                result = self._packets.syncReadTx(port, address, length, servo_ids, len(servo_ids), False)
            else:
                result = self._packets.readTx(port, servo_ids[0], address, length)
            answers = self._collect(port, servo_ids, length) if result == COMM_SUCCESS else {}
        return {servo_id: data for servo_id, (error, data) in answers.items() if not error}

    def _collect(self, port: SdkPort, servo_ids: Sequence[int], length: int) -> dict[int, tuple[int, bytes]]:
        """Error code and parameters from each servo that answers in time with the right number of bytes."""
        answers: dict[int, tuple[int, bytes]] = {}
        for _ in range(len(servo_ids) + _STALE_MOST):
            packet, result = self._packets.rxPacket(port, False)
            if result != COMM_SUCCESS:
                break
            servo_id, error = packet[4], packet[8] & ~_ALERT
            parameters = bytes(packet[9 : 5 + int.from_bytes(bytes(packet[5:7]), "little")])
            if servo_id in servo_ids and (error or len(parameters) == length):
                answers[servo_id] = (error, parameters)
            if len(answers) == len(servo_ids):
                break
        return answers

    def _judge(self, what: str, servo_id: int, answers: Mapping[int, tuple[int, bytes]]) -> None:
        error, _ = answers.get(servo_id, (_CRC_ERROR, b""))
        if error == _CRC_ERROR:  # what we sent was garbled on its way: as good as not heard
            raise self._unanswered(servo_id)
        if error:
            raise RefusedError(f"{self.port}: servo {servo_id} refuses {what}: {refusal(error)}")

    def _unanswered(self, servo_id: int) -> NoAnswerError:
        return NoAnswerError(f"{self.port}: {silence_of(servo_id)}")

    def _wait_for_quiet(self) -> None:
        """Let stragglers of an answer that went wrong pass."""
        for _ in range(_QUIET_TRIES):
            self.clock.sleep_s(_QUIET_S)
            with self._exchange() as port:
                if port.getBytesAvailable() == 0:
                    return
                port.clearPort()


_ACKNOWLEDGEMENT = 11
"""Bytes of a status packet without parameters."""
