"""A whole bench without its hardware: the emulators that fit a live bench file, on simulated time or on real ports."""

from rig.emulation.bench import EmulatedBench
from rig.emulation.views import grid_view, object_view, stand_in_front

__all__ = ["EmulatedBench", "grid_view", "object_view", "stand_in_front"]
