"""What a bench says about its camera: where it is, what is locked, how old pictures can be, what is refused."""

from __future__ import annotations

import re
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=16, le=16384)]
Level = Annotated[float, Field(ge=0.0, le=255.0, allow_inf_nan=False)]

STABLE_FOLDERS = ("/dev/v4l/by-path/", "/dev/v4l/by-id/")
_NUMBERED = re.compile(r"(/dev/video)?\d+")


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class CameraDeadlines(_Strict):
    """How long the driver waits before it takes something for failed.

    Attributes:
        connect_s: for the first usable picture after opening, warming up included.
        capture_s: for a picture that is fresh and without fault.
        silence_s: without any frame; or three frame periods, where those are longer.
        lost_s: with every read failing.
    """

    connect_s: Positive = 10.0
    capture_s: Positive = 5.0
    silence_s: Positive = 0.8
    lost_s: Positive = 0.5


class PictureLimits(_Strict):
    """Which pictures are refused (see `drivers.frame_checks`).

    Attributes:
        black_level: a picture is black if 99.5 % of its pixels are at or below this level, 0..255.
        bright_level: a pixel is saturated if all its channels are at or above this level, 0..255.
        bright_share: a picture is over-exposed if more than this share of its pixels is saturated.
        allow: faults that this bench's pictures may have.
        attempts: so many fresh pictures in a row with a fault end a capture.
    """

    black_level: Level = 24.0
    bright_level: Level = 250.0
    bright_share: Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)] = 0.5
    allow: tuple[Literal["black", "over-exposed", "frozen"], ...] = ()
    attempts: Annotated[int, Field(ge=1, le=100)] = 5


class CameraSettings(_Strict):
    """The camera of a bench.

    Attributes:
        source: a V4L2 camera by its stable path under ``/dev/v4l/by-path`` or ``by-id``, an ``http://`` address of a
            Motion-JPEG stream, or a video file.
        usb_id: vendor and product that must be found there, e.g. ``046d:0825``; needs a V4L2 camera.
        usb_serial: serial number that must be found there.
        width_px, height_px: size of the pictures; ``None``: what the device gives.
        frame_rate_hz: ``None``: what the device gives.
        pixel_format: how the frames come over USB; large pictures need ``MJPG`` for a full frame rate.
        exposure_s, white_balance_k, focus, gain: locked at these values (focus and gain in the device's own units);
            ``None``: locked at what the automatics have found when the camera is warm; gain is then left alone.
        automatic: automatics that stay on.
        latency_s: longest time from the end of an exposure (of its first row) until this computer has the frame:
            readout, coding, transfer, and whatever the camera holds back. Too small a value lets old pictures pass.
        buffer_frames: most frames that driver and OpenCV hold between them.
        warm_up_s: run before anything is locked.
        limits: which pictures are refused.
        deadlines: see `CameraDeadlines`.
    """

    source: Annotated[str, Field(min_length=1, max_length=1000)]
    usb_id: Annotated[str, Field(pattern=r"^[0-9a-f]{4}:[0-9a-f]{4}$")] | None = None
    usb_serial: Annotated[str, Field(min_length=1)] | None = None
    width_px: Pixels | None = None
    height_px: Pixels | None = None
    frame_rate_hz: Positive | None = None
    pixel_format: Literal["MJPG", "YUYV"] | None = None
    exposure_s: Positive | None = None
    white_balance_k: Positive | None = None
    focus: NotNegative | None = None
    gain: NotNegative | None = None
    automatic: tuple[Literal["exposure", "white_balance", "focus"], ...] = ()
    latency_s: NotNegative = 0.1
    buffer_frames: Annotated[int, Field(ge=1, le=64)] = 8
    warm_up_s: NotNegative = 1.0
    limits: PictureLimits = PictureLimits()
    deadlines: CameraDeadlines = CameraDeadlines()

    @property
    def kind(self) -> Literal["v4l2", "http", "file"]:
        """Which sort of source it is."""
        if self.source.startswith(STABLE_FOLDERS):
            return "v4l2"
        return "http" if self.source.startswith("http://") else "file"

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height that are asked for, pixels."""
        return None if self.width_px is None or self.height_px is None else (self.width_px, self.height_px)

    @field_validator("source")
    @classmethod
    def _lasting(cls, source: str) -> str:
        if _NUMBERED.fullmatch(source):
            raise ValueError(
                f"{source!r} is a number that changes from start to start. Name the camera by its path under "
                "/dev/v4l/by-path (`rig doctor --discover` lists them)"
            )
        if source.startswith("/dev/") and not source.startswith(STABLE_FOLDERS):
            raise ValueError(f"{source!r} is no camera path. Use one under /dev/v4l/by-path or /dev/v4l/by-id")
        if "://" in source:
            _refuse_other_addresses(source)
        return source

    @model_validator(mode="after")
    def _consistent(self) -> CameraSettings:
        if (self.width_px is None) != (self.height_px is None):
            raise ValueError("give both width_px and height_px, or neither")
        if self.kind != "v4l2" and (self.usb_id or self.usb_serial):
            raise ValueError("usb_id and usb_serial need a source under /dev/v4l")
        told = {"exposure": self.exposure_s, "white_balance": self.white_balance_k, "focus": self.focus}
        for name in self.automatic:
            if told[name] is not None:
                raise ValueError(f"{name} is told a value and left automatic. Keep one of the two")
        return self


def _refuse_other_addresses(source: str) -> None:
    address = urlsplit(source)
    if address.scheme != "http":
        raise ValueError(f"{address.scheme}:// is not read. Name an http:// address of a Motion-JPEG stream")
    if address.username is not None:
        raise ValueError(
            "an address with user name and password is not read. Let the camera serve this computer freely"
        )
    if not address.hostname or address.netloc.endswith(":"):
        raise ValueError(f"{source!r} names no computer and port. Write http://HOST:PORT/PATH")
