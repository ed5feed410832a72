"""Takes Motion-JPEG apart: a multipart stream into JPEG files, a JPEG file into its size and its picture."""

from __future__ import annotations

import re
from collections.abc import Iterator
from email.parser import BytesHeaderParser

import numpy as np

from rig.hal import Image

_MAX_HEADER_BYTES = 16 * 1024
_MAX_PART_BYTES = 32 * 1024 * 1024
_MAX_DIGITS = 20
_MAX_PIXELS = 64 * 1024 * 1024
_SCAN = 0xDA


class StreamError(OSError):
    """What came is not a Motion-JPEG stream, or not one that can be used."""


class MultipartParser:
    """Cuts ``multipart/x-mixed-replace`` into its parts. One without Content-Length ends where its JPEG file does, for
    many servers send the next boundary only with the next frame."""

    def __init__(self, boundary: str) -> None:
        """Set up.

        Args:
            boundary: as the response's header tells it; many servers disagree with themselves about leading dashes.
        """
        core = re.escape(boundary.strip().strip('"').lstrip("-").encode("latin-1"))
        self._delimiter = re.compile(rb"(?:\r?\n)?-*" + core + rb"(?:--)?[ \t]*\r?\n")
        self._buffer = bytearray()
        self._length: int | None = None
        self._in_body = False
        self._searched = 0

    @property
    def amid_part(self) -> bool:
        """Some of the next part has come, but not all."""
        return self._in_body and (self._length is not None or bool(self._buffer))

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes as they come; returns the bodies that are complete now.

        Raises:
            StreamError: a header or a part is larger than any real one.
        """
        self._buffer += data
        parts: list[bytes] = []
        while self._take_body(parts) if self._in_body else self._take_header():
            pass
        return parts

    def _take_header(self) -> bool:
        delimiter = self._delimiter.search(self._buffer)
        end = re.compile(rb"\r?\n\r?\n").search(self._buffer, delimiter.end()) if delimiter else None
        if delimiter is None or end is None:
            if len(self._buffer) > _MAX_HEADER_BYTES:
                raise StreamError(f"no part of the stream begins within {_MAX_HEADER_BYTES} bytes")
            return False
        header = BytesHeaderParser().parsebytes(bytes(self._buffer[delimiter.end() : end.end()]))
        told = str(header.get("Content-Length", ""))
        # So many digits say enough, and Python refuses to make a number of thousands.
        self._length = int(told[:_MAX_DIGITS]) if told.isascii() and told.isdigit() else None
        if self._length is not None and self._length > _MAX_PART_BYTES:
            raise StreamError(f"a part of {self._length} bytes is announced, more than {_MAX_PART_BYTES}")
        del self._buffer[: end.end()]
        self._in_body, self._searched = True, 0
        return True

    def _take_body(self, parts: list[bytes]) -> bool:
        end = self._length
        if end is None:
            end = jpeg_end(self._buffer, self._searched)
            self._searched = len(self._buffer)
        if end is None or len(self._buffer) < end:
            if len(self._buffer) > _MAX_PART_BYTES:
                raise StreamError(f"a part of the stream is longer than {_MAX_PART_BYTES} bytes")
            return False
        parts.append(bytes(self._buffer[:end]))
        del self._buffer[:end]
        self._in_body, self._length = False, None
        return True


def decode_jpeg(data: bytes) -> Image | None:
    """The picture of a JPEG file as ``(h, w, 3)`` BGR; ``None``: damaged, cut off, or larger than any camera's."""
    import cv2

    size = jpeg_size(data)
    # OpenCV fills what is missing of a JPEG with grey and says nothing, so the end marker is looked for.
    if size is None or size[0] * size[1] > _MAX_PIXELS or jpeg_end(data) is None:
        return None
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    return None if image is None else np.asarray(image, dtype=np.uint8)


def jpeg_end(data: bytes | bytearray, searched: int = 0) -> int | None:
    """Where a JPEG file ends, as a number of bytes; ``None``: not within the data.

    Args:
        data: begins with the file.
        searched: so many bytes were looked through before.
    """
    pixels = next((at for at, marker in _segments(data) if marker == _SCAN), None)
    if pixels is None:
        return None
    # Within pixels 0xFF is always followed by a zero, unless it begins a marker.
    found = data.find(b"\xff\xd9", max(pixels, searched - 1))
    return None if found < 0 else found + 2


def jpeg_size(data: bytes | bytearray) -> tuple[int, int] | None:
    """Width and height that a JPEG file's header tells, pixels; ``None``: it tells none."""
    for at, marker in _segments(data):
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC) and at + 9 <= len(data):
            height, width = int.from_bytes(data[at + 5 : at + 7], "big"), int.from_bytes(data[at + 7 : at + 9], "big")
            return (width, height) if width and height else None
    return None


def _segments(data: bytes | bytearray) -> Iterator[tuple[int, int]]:
    """Place and marker of the segments before the pixels, and of the first scan of pixels."""
    at = 2 if data[:2] == b"\xff\xd8" else len(data)
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # a fill byte may stand before a marker
            at += 1
            continue
        yield at, marker
        if marker == _SCAN:
            return
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
