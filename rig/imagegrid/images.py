"""The one way in which picture files become arrays: digest first, then the size, then the pixels, as they are stored.

Rules: PNG and JPEG only; 8 bits a channel (16-bit and 12-bit pictures are refused: how to bring them to 8 bits is the
owner's choice); grey stays ``(h, w)``, colour becomes ``(h, w, 3)`` BGR; an alpha channel that is opaque everywhere is
dropped, any other is refused; an EXIF orientation is ignored, since poses and truths speak of stored pixels.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.errors import ImageError, ImageGridError
from rig.hal import Image

MAX_PIXELS = 100_000_000
MAX_FILE_BYTES = 512 * 1024 * 1024

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_COPY_AGAIN = "Copy it again from its source"


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """What a picture's first bytes say: its format, its size in pixels, the bits of a channel, and its channels."""

    kind: str
    width: int
    height: int
    bits: int
    channels: int


def load_image(path: Path, *, sha256: str, size: tuple[int | None, int | None] = (None, None)) -> Image:
    """Read a picture whose digest is known.

    Args:
        path: of the file.
        sha256: of its bytes.
        size: width and height that it must have, pixels; ``None``: any.

    Returns:
        ``(h, w)`` grey or ``(h, w, 3)`` BGR, 8 bits.

    Raises:
        ImageGridError: the file is missing or cannot be read, or digest or size is another one.
        ImageError: it is not a picture by the rules of this module.
    """
    data = read_image_bytes(path)
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        raise ImageGridError(
            f"the picture is damaged or was exchanged: its SHA-256 is {found[:12]}..., the manifest says "
            f"{sha256[:12]}...",
            where=str(path),
            remedy=_COPY_AGAIN,
        )
    return decode_image(data, str(path), size)


def digest_of(path: Path) -> str | None:
    """SHA-256 of a picture file; ``None`` if there is none.

    Raises:
        ImageGridError: it is there and cannot be read: no reason to take it for damaged.
    """
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except FileNotFoundError:
        return None
    except OSError as failure:
        raise ImageGridError(
            f"cannot be read: {failure.strerror or failure}", where=str(path), remedy="Check its permissions"
        ) from failure


def read_image_bytes(path: Path) -> bytes:
    """The bytes of a picture file.

    Raises:
        ImageGridError: it is missing, no regular file, unreadable, or larger than ``MAX_FILE_BYTES``.
    """
    try:
        if not path.is_file():
            raise ImageGridError("there is no such picture file", where=str(path), remedy=_COPY_AGAIN)
        if path.stat().st_size > MAX_FILE_BYTES:
            limit = f"{MAX_FILE_BYTES >> 20} MiB"
            raise ImageGridError(f"the file is larger than {limit}", where=str(path), remedy="Is it a picture?")
        return path.read_bytes()
    except OSError as failure:
        raise ImageGridError(
            f"cannot be read: {failure.strerror or failure}", where=str(path), remedy="Check its permissions"
        ) from failure


def decode_image(data: bytes, source: str, size: tuple[int | None, int | None] = (None, None)) -> Image:
    """Turn the bytes of a picture file into an array; ``source`` names it in messages.

    Raises:
        ImageError: it is not a picture by the rules of this module; nothing large is decoded to find out.
        ImageGridError: its size is not the one given.
    """
    header = read_header(data, source)
    if header.bits > 8:
        raise ImageError(f"has {header.bits} bits a channel", where=source, remedy="Convert it to 8 bits")
    if header.kind == "JPEG" and header.channels not in (1, 3):
        raise ImageError(f"has {header.channels} colour channels", where=source, remedy="Save it as grey or RGB")
    if header.width * header.height > MAX_PIXELS:
        raise ImageError(
            f"is {header.width} x {header.height} pixels, more than {MAX_PIXELS // 1_000_000} million",
            where=source,
            remedy="Scale it down, or cut it",
        )
    for name, found, told in zip(("wide", "high"), (header.width, header.height), size, strict=True):
        if told is not None and found != told:
            raise ImageGridError(
                f"is {found} pixels {name}, the manifest says {told}", where=source, remedy="Correct the manifest"
            )
    _refuse_truncated(data, header.kind, source)
    return _decode(data, header, source)


def read_header(data: bytes, source: str) -> ImageHeader:
    """Format, size and depth from a picture's header, without decoding it.

    Raises:
        ImageError: neither PNG nor JPEG, or the header is damaged.
    """
    header = None
    if data.startswith(_PNG):
        header = _png_header(data)
    elif data.startswith(_JPEG):
        header = _jpeg_header(data)
    else:
        raise ImageError("is neither PNG nor JPEG", where=source, remedy="Convert it to one of them")
    if header is None or min(header.width, header.height, header.channels) < 1:
        raise ImageError("the picture's header is damaged", where=source, remedy=_COPY_AGAIN)
    return header


def _png_header(data: bytes) -> ImageHeader | None:
    if len(data) < 33 or data[12:16] != b"IHDR":
        return None
    width, height, bits, colour = struct.unpack(">IIBB", data[16:26])
    return ImageHeader("PNG", width, height, bits, _PNG_CHANNELS.get(colour, 0))


def _jpeg_header(data: bytes) -> ImageHeader | None:
    at = 2
    while at + 10 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # A fill byte before the marker.
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            bits, height, width, channels = struct.unpack(">BHHB", data[at + 4 : at + 10])
            return ImageHeader("JPEG", width, height, bits, channels)
        elif marker == 0xDA:  # Pixels begin, and no size was told.
            return None
        else:
            at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _refuse_truncated(data: bytes, kind: str, source: str) -> None:
    # OpenCV fills what is missing of a JPEG with grey and says nothing.
    end = b"IEND" if kind == "PNG" else b"\xff\xd9"
    if end not in data[-4096:]:
        raise ImageError("the picture is cut off before its end", where=source, remedy=_COPY_AGAIN)


def _decode(data: bytes, header: ImageHeader, source: str) -> Image:
    import cv2

    try:
        # IMREAD_UNCHANGED keeps grey, depth and alpha, and ignores the EXIF orientation.
        decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as failure:
        raise ImageError(f"cannot be decoded: {failure.err}", where=source, remedy=_COPY_AGAIN) from failure
    if decoded is None or decoded.shape[:2] != (header.height, header.width) or decoded.dtype != np.uint8:
        raise ImageError("cannot be decoded", where=source, remedy=_COPY_AGAIN)
    image: Image = np.asarray(decoded, dtype=np.uint8)
    if image.ndim == 3 and image.shape[2] == 4:
        if int(image[..., 3].min()) < 255:
            raise ImageError("has transparent pixels", where=source, remedy="Save it without an alpha channel")
        image = np.ascontiguousarray(image[..., :3])
    return image
