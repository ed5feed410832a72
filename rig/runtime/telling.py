"""The status of a rig and the report of a STOP as JSON objects, for scripts and for other processes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rig.devices import StopReport
from rig.guard import GuardStatus


def stop_object(report: StopReport) -> dict[str, Any]:
    """What a STOP did: ``sent``, ``confirmed``, ``position_kept``, ``trouble``."""
    return {
        "sent": report.sent_at_s is not None,
        "confirmed": report.confirmed,
        "position_kept": report.position_kept,
        "trouble": report.trouble,
    }


def status_object(status: GuardStatus) -> dict[str, Any]:
    """The status; ``devices`` is empty where none has been read. Times on the monotonic clock are left out."""
    found: dict[str, Any] = {
        "state": status.state.value,
        "running": status.running,
        "pose": None if status.pose is None else asdict(status.pose),
        "age_s": round(status.age_s, 3),
        "stale": status.stale,
        "troubles": list(status.troubles),
        "stop": None if status.stop is None else stop_object(status.stop),
        "devices": {},
    }
    if status.rig is None:
        return found
    named = {"gantry": status.rig.gantry, "pan": status.rig.axes.get("theta_deg"), "zoom": status.rig.axes.get("zoom")}
    for name, device in named.items():
        if device is not None:
            told = asdict(device)
            del told["read_at_s"]
            found["devices"][name] = told | {"motion": device.motion.value}
    return found
