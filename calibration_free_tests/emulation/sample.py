"""The emulated bench that the tests of this folder stand on: the example's bench file, and something to look at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rig.bench import BenchConfig, load_bench
from rig.emulation import EmulatedBench
from rig.guard import Guard
from rig.hal import Image, RigPose
from sim_backends.simulated_clock import SimulatedClock

EXAMPLES = Path(__file__).parents[2] / "examples"
EMULATED = EXAMPLES / "bench_emulated.yaml"
SIZE = (64, 48)


def config() -> BenchConfig:
    """The example."""
    return load_bench(EMULATED)


def striped(pose: RigPose) -> Image:
    """A small picture that moves with all axes, mid grey: quick to draw."""
    phase = pose.x_mm + 2.0 * pose.y_mm + 3.0 * pose.z_mm + 5.0 * pose.theta_deg + 50.0 * pose.zoom
    columns = (120.0 + 60.0 * np.sin((np.arange(SIZE[0]) + phase) / 5.0)).astype(np.uint8)
    return np.repeat(np.repeat(columns[None, :, None], SIZE[1], axis=0), 3, axis=2)


def simulated(of: BenchConfig | None = None, **options: Any) -> EmulatedBench:
    """On simulated time, looking at stripes of the size that the bench asks for no longer."""
    return EmulatedBench(of or small(config()), striped, clock=SimulatedClock(), **options)


def small(of: BenchConfig) -> BenchConfig:
    """The bench with a camera that takes what it is given: pictures of any size."""
    camera = of.devices["camera"]
    settings = camera.settings.model_copy(update={"width_px": None, "height_px": None})
    return replace(of, devices={**of.devices, "camera": replace(camera, settings=settings)})


def make_ready(guard: Guard) -> None:
    """What a person does after power-up: home, and say that the pan stands at 0."""
    guard.home()
    guard.reference("theta_deg", 0.0)


def near(a: RigPose, b: RigPose, *, mm: float = 0.002, deg: float = 0.05, zoom: float = 0.001) -> bool:
    """Whether two poses differ on no axis by more than this."""
    linear = max(abs(a.x_mm - b.x_mm), abs(a.y_mm - b.y_mm), abs(a.z_mm - b.z_mm))
    return linear <= mm and abs(a.theta_deg - b.theta_deg) <= deg and abs(a.zoom - b.zoom) <= zoom
