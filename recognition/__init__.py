"""Pure recognition: invariants, pose, model base, detectors, belief, policies and the loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recognition.pose import PoseEstimate, estimate_pose
    from recognition.priors import Priors
    from recognition.views import View

__all__ = ["PoseEstimate", "Priors", "View", "estimate_pose"]

_HOME = {
    "PoseEstimate": "recognition.pose",
    "Priors": "recognition.priors",
    "View": "recognition.views",
    "estimate_pose": "recognition.pose",
}


def __getattr__(name: str) -> Any:
    """Import what is public on first use, so that ``rig --help`` does not wait for it."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOME[name]), name)
