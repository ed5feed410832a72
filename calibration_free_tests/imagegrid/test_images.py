"""The one loader of picture files: digest before decoding, size from the header, pixels as they are stored."""

from __future__ import annotations

import hashlib
import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration_free_tests.imagegrid.sample import encoded, picture
from rig.errors import ImageError, ImageGridError
from rig.imagegrid import decode_image, load_image
from rig.imagegrid.images import MAX_PIXELS, read_header


def digest_of(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def saved(folder: Path, data: bytes, name: str = "a.png") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def png_chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def bomb(side: int) -> bytes:
    """A PNG of a few bytes that asks for side x side pixels."""
    header = png_chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + png_chunk(b"IDAT", zlib.compress(bytes(1000))) + png_chunk(b"IEND", b"")


def test_a_png_comes_back_to_the_bit(tmp_path: Path) -> None:
    data = encoded(picture(1), ".png")
    assert np.array_equal(load_image(saved(tmp_path, data), sha256=digest_of(data), size=(24, 16)), picture(1))


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_grey_stays_grey(suffix: str) -> None:
    assert decode_image(encoded(picture(2)[..., 0], suffix), "x").shape == (16, 24)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_every_flipped_byte_is_refused_by_name(tmp_path: Path, suffix: str) -> None:
    data = encoded(picture(3), suffix)
    path = tmp_path / f"view{suffix}"
    for position in range(0, len(data), 11):
        changed = bytearray(data)
        changed[position] ^= 0x10
        path.write_bytes(changed)
        with pytest.raises(ImageGridError, match=rf"view\{suffix}: the picture is damaged") as caught:
            load_image(path, sha256=digest_of(data))
        assert caught.value.exit_code == 2


def test_the_digest_is_compared_before_the_decoder_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    with pytest.raises(ImageGridError, match="damaged"):
        load_image(saved(tmp_path, encoded(picture(3), ".jpg")), sha256="0" * 64)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_every_truncation_is_refused_even_if_its_digest_is_right(suffix: str) -> None:
    data = encoded(picture(4), suffix)
    for length in range(0, len(data) - 12, 7):
        with pytest.raises(ImageError):
            decode_image(data[:length], "x")


def test_a_decompression_bomb_is_refused_from_its_header(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    side = int(MAX_PIXELS**0.5) + 1
    with pytest.raises(ImageError, match="more than 100 million"):
        decode_image(bomb(side), "x")


@pytest.mark.parametrize(("size", "what"), [((25, 16), "24 pixels wide"), ((None, 17), "16 pixels high")])
def test_another_size_than_recorded_is_refused(size: tuple[int | None, int | None], what: str) -> None:
    with pytest.raises(ImageGridError, match=what):
        decode_image(encoded(picture(5), ".png"), "x", size)


def test_the_header_tells_the_size_of_every_kind_of_jpeg() -> None:
    image = picture(6, (40, 30))
    for options in ((), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1), (cv2.IMWRITE_JPEG_RST_INTERVAL, 1)):
        header = read_header(encoded(image, ".jpg", *options), "x")
        assert (header.width, header.height, header.bits, header.channels) == (40, 30, 8, 3)


def test_an_opaque_alpha_channel_is_dropped_and_any_other_refused() -> None:
    image = np.dstack([picture(7), np.full((16, 24), 255, np.uint8)])
    assert np.array_equal(decode_image(encoded(image, ".png"), "x"), picture(7))
    image[3, 4, 3] = 254
    with pytest.raises(ImageError, match="transparent"):
        decode_image(encoded(image, ".png"), "x")


def test_sixteen_bits_are_refused_before_decoding(monkeypatch: pytest.MonkeyPatch) -> None:
    data = encoded(picture(8).astype(np.uint16) * 257, ".png")
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    with pytest.raises(ImageError, match=r"16 bits a channel.*8 bits"):
        decode_image(data, "x")


def test_an_exif_orientation_does_not_turn_the_picture() -> None:
    data = encoded(picture(9), ".jpg")
    tiff = b"II*\x00\x08\x00\x00\x00\x01\x00" + struct.pack("<HHIHH", 0x0112, 3, 1, 6, 0) + b"\x00" * 4
    exif = b"Exif\x00\x00" + tiff
    turned = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    # The decoder would turn it: that this file asks for it is part of the test.
    by_default = cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR)
    assert by_default is not None
    assert by_default.shape == (24, 16, 3)
    assert decode_image(turned, "x").shape == (16, 24, 3)


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"", "neither PNG nor JPEG"),
        (b"GIF89a" + bytes(50), "neither PNG nor JPEG"),
        (b"\x89PNG\r\n\x1a\n", "header is damaged"),
        (b"\xff\xd8\xff\xe0\x00\x01", "header is damaged"),
        (b"\xff\xd8\xff\xd9" + bytes(9), "header is damaged"),
        (b"\xff\xd8\xff\xc0\x00\x11\x08\x00\x10\x00\x10\x04" + bytes(20), "4 colour channels"),
        (b"\xff\xd8\xff\xc0\x00\x11\x0c\x00\x10\x00\x10\x03" + bytes(20), "12 bits"),
        (b"\xff\xd8\xff\xc0\x00\x11\x08\x00\x10\x00\x10\x03" + bytes(20) + b"\xff\xd9", "cannot be decoded"),
        (bomb(0), "header is damaged"),
    ],
)
def test_what_is_no_picture_is_refused(data: bytes, what: str) -> None:
    with pytest.raises(ImageError, match=what):
        decode_image(data, "x")


def test_folders_pipes_and_missing_files_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.png")
    for name in ("pipe.png", ".", "no.png"):
        with pytest.raises(ImageGridError, match="no such picture file"):
            load_image(tmp_path / name, sha256="0" * 64)
