"""Reads a Motion-JPEG stream over HTTP, from the one address that the bench names.

Written on a plain socket: OpenCV's own reader follows redirections and proxies, cannot say whether a frame is waiting,
and cannot be bounded in time while it reads.
"""

from __future__ import annotations

import io
import select
import socket
from collections import deque
from email.message import Message
from http.client import HTTPException, parse_headers
from urllib.parse import urlsplit

from drivers.camera_source import SourceEndedError
from drivers.mjpeg import MultipartParser, StreamError, decode_jpeg
from rig.devices import Clock, Identity
from rig.errors import HardwareError
from rig.hal import Image

_MAX_ANSWER_BYTES = 64 * 1024
_STALL_S = 1.0
_CHUNK_BYTES = 256 * 1024


class HttpSource:
    """An open stream. A `drivers.camera_source.CameraSource`."""

    bounded_buffer = False
    """Both computers' network buffers lie between camera and reader: thousands of small frames."""

    def __init__(self, url: str, timeout_s: float, clock: Clock) -> None:
        """Connect and read the answer's header, which must be there whole within the time-out.

        Raises:
            HardwareError: nobody answers there, or with something else than a Motion-JPEG stream.
        """
        deadline_s = clock.now_s() + timeout_s
        try:
            self._socket = _request(url, timeout_s)
        except OSError as error:
            raise HardwareError(f"{url}: no answer: {error}. Check address, cable and power") from error
        try:
            header, rest = _split_answer(_receive_answer(self._socket, clock, deadline_s))
            self._parser = MultipartParser(_boundary(header))
            self._frames: deque[bytes] = deque(self._parser.feed(rest))
        except TimeoutError as error:
            self._socket.close()
            raise HardwareError(f"{url}: no whole answer within {timeout_s:g} s. Check address and cable") from error
        except OSError as error:
            self._socket.close()
            raise HardwareError(f"{url}: {error}. Name the address of the Motion-JPEG stream itself") from error
        self._socket.settimeout(_STALL_S)
        self.identity = Identity("HTTP camera", header.get("Server", ""), url)
        self._grabbed = b""

    def frame_waiting(self, timeout_s: float) -> bool | None:
        """Wait for the next frame, or the time-out.

        Quiet for the whole time-out means that the sender had nothing to send either, as long as the way there and
        back takes less. Amid a frame nothing can be told.
        """
        if self._frames:
            return True
        if self._parser.amid_part:
            return None
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return False
        self._receive()
        return True if self._frames else None

    def grab(self) -> bool:
        """Take the next frame.

        Raises:
            OSError: it stalled half way, or the stream has ended or is broken.
        """
        while not self._frames:
            self._receive()
        self._grabbed = self._frames.popleft()
        return True

    def retrieve(self) -> tuple[bool, Image | None]:
        """Decode the frame that was grabbed."""
        image = decode_jpeg(self._grabbed)
        return image is not None, image

    def set(self, prop: int, value: float) -> bool:
        """Refused: a stream has no way to set anything at the camera."""
        return False

    def get(self, prop: int) -> float:
        """Nothing can be read."""
        return 0.0

    def release(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _receive(self) -> None:
        data = self._socket.recv(_CHUNK_BYTES)
        if not data:
            raise SourceEndedError("the stream has ended")
        try:
            self._frames.extend(self._parser.feed(data))
        except StreamError as error:
            # Where the next part begins is not known any more.
            raise SourceEndedError(f"the stream is broken: {error}") from error


def _request(url: str, timeout_s: float) -> socket.socket:
    address = urlsplit(url)
    assert address.hostname is not None  # CameraSettings saw to it
    path = (address.path or "/") + (f"?{address.query}" if address.query else "")
    connection = socket.create_connection((address.hostname, address.port or 80), timeout_s)
    # HTTP/1.0: the answer may not come in chunks.
    connection.sendall(
        f"GET {path} HTTP/1.0\r\nHost: {address.netloc}\r\nAccept: multipart/x-mixed-replace\r\n\r\n".encode("ascii")
    )
    return connection


def _receive_answer(connection: socket.socket, clock: Clock, deadline_s: float) -> bytes:
    """The answer's header, and what came with it of what follows."""
    data = b""
    while b"\r\n\r\n" not in data:
        left_s = deadline_s - clock.now_s()
        if left_s <= 0.0:
            raise TimeoutError
        connection.settimeout(left_s)
        more = connection.recv(4096)
        if not more or len(data) > _MAX_ANSWER_BYTES:
            raise StreamError("what answers there does not speak HTTP")
        data += more
    return data


def _split_answer(answer: bytes) -> tuple[Message, bytes]:
    head, rest = answer.split(b"\r\n\r\n", 1)
    status, _, lines = head.partition(b"\r\n")
    words = status.decode("latin-1").split(" ", 2)
    try:
        header = parse_headers(io.BytesIO(lines + b"\r\n\r\n"))
    except HTTPException as error:
        raise StreamError(f"what answers there does not speak HTTP: {error}") from error
    if not words[0].startswith("HTTP/") or len(words) < 2:
        raise StreamError("what answers there does not speak HTTP")
    if words[1] != "200":
        elsewhere = f" (to {header['Location']}, which is not followed)" if "Location" in header else ""
        raise StreamError(f"it answers {' '.join(words[1:])}{elsewhere}")
    if header.get("Transfer-Encoding", "identity") != "identity":
        raise StreamError("it answers in chunks although asked not to")
    return header, rest


def _boundary(header: Message) -> str:
    boundary = header.get_param("boundary")
    if header.get_content_type() != "multipart/x-mixed-replace" or not isinstance(boundary, str):
        raise StreamError(f"it sends {header.get_content_type()}, no Motion-JPEG stream")
    return boundary
