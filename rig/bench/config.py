"""A bench file that has been read and checked, and what the recogniser may know of it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from recognition.geometry import Mount
from recognition.rates import DetectionRates
from recognition.settings import BenchBounds
from rig.bench.drivers import Device, devices_of
from rig.bench.entries import Goal
from rig.bench.live import LiveBenchFile
from rig.bench.mock import BenchFile
from rig.bench.port_place import place_of
from rig.errors import InputError
from rig.schema import BENCH_MAX_BYTES, Document, did_you_mean, load_yaml, validate


@dataclass(frozen=True)
class BenchConfig:
    """A bench file, checked, and where its image grid is.

    Attributes:
        name: the bench file, or the grid's folder where there is no bench file; for messages.
        file: what it says.
        grid: folder of the image grid, if one is named.
        devices: of a live bench: ``gantry``, ``camera``, and ``pan`` and ``zoom`` where it has them.
    """

    name: str
    file: BenchFile | LiveBenchFile
    grid: Path | None = None
    devices: Mapping[str, Device] = field(default_factory=dict)

    @property
    def is_live(self) -> bool:
        """It moves something, and is no mock."""
        return isinstance(self.file, LiveBenchFile)

    @property
    def key(self) -> str:
        """Names a live bench: the same for every bench file that names the same port of the gantry."""
        gantry, port = self.devices.get("gantry"), self._port
        return _hashed(str(Path(self.name).resolve()) if gantry is None or port is None else f"{gantry.driver} {port}")

    @property
    def other_keys(self) -> tuple[str, ...]:
        """Names the port by its place, for bench files that name it differently; none where it is not there."""
        place = None if self._port is None else place_of(self._port)
        return () if place is None else (_hashed(place),)

    @property
    def _port(self) -> str | None:
        gantry = self.devices.get("gantry")
        return None if gantry is None else getattr(gantry.settings, "port", None)

    @property
    def mount(self) -> Mount:
        """How the camera hangs on the rig, and how straight the rig's axes are."""
        axes, square = self.file.axes, self.file.axes.squareness_deg
        return Mount(
            **self.file.mount.model_dump(),
            x_scale=axes.x_mm.scale,
            y_scale=axes.y_mm.scale,
            z_scale=axes.z_mm.scale,
            xy_deg=square.xy,
            xz_deg=square.xz,
            yz_deg=square.yz,
        )

    @property
    def rates(self) -> DetectionRates:
        """How the detector behaves on this bench."""
        told = self.file.detection
        return DetectionRates(told.found, told.clutter, told.corner_sd_px, told.measured)

    @property
    def goal(self) -> Goal:
        """How sure the pose must be where the user asks for nothing else."""
        return self.file.goal

    def bounds(self) -> BenchBounds:
        """What the recogniser may know of distances, the lens and the gantry; what the file leaves out is wide."""
        bounds = BenchBounds(motion_sd_mm=self.file.motion.sd_mm, motion_sd_deg=self.file.motion.sd_deg)
        if self.file.object.distance_mm is not None:
            near, far = self.file.object.distance_mm
            bounds = replace(bounds, distance_min_mm=near, distance_max_mm=far)
        if self.file.camera.view_angle_deg is not None:
            narrow, wide = self.file.camera.view_angle_deg
            bounds = replace(bounds, view_angle_min_deg=narrow, view_angle_max_deg=wide)
        return bounds


def _hashed(what: str) -> str:
    return hashlib.sha256(what.encode()).hexdigest()[:16]


def load_bench(path: Path) -> BenchConfig:
    """Read a bench file.

    Raises:
        InputError: with file:line:column of everything that is wrong, and remedies.
    """
    document = load_yaml(path, max_bytes=BENCH_MAX_BYTES)
    file = bench_file(document)
    if isinstance(file, LiveBenchFile):
        return BenchConfig(str(path), file, devices=devices_of(file.devices, document))
    return BenchConfig(str(path), file, None if file.grid is None else path.parent / file.grid)


def bench_file(document: Document) -> BenchFile | LiveBenchFile:
    """What a bench file says, without the settings of its devices.

    Raises:
        InputError: with file:line:column of everything that is wrong, and remedies.
    """
    kind = document.data.get("kind") if isinstance(document.data, dict) else None
    if kind == "live":
        return validate(LiveBenchFile, document)
    if isinstance(kind, str) and kind != "mock":
        message = f"kind: should be 'mock' or 'live', not the text {kind!r}"
        raise InputError(message, where=document.where(("kind",)), remedy=did_you_mean(kind, ("mock", "live")))
    return validate(BenchFile, document)


def default_bench_for_grid(grid_dir: Path) -> BenchConfig:
    """A mock bench for an image grid that comes without a bench file: limits and speeds from the grid, wide bounds."""
    return BenchConfig(str(grid_dir), BenchFile.model_validate({"schema": 1, "kind": "mock"}), grid_dir)
