"""Drivers as somebody else's package would bring them: entry points of a distribution on the module path.

So the tests need no installation that is up to date, and `rig` in a process of its own finds them too.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
GROUPS = ("rig.gantries", "rig.axes", "rig.cameras")
SIMPLE = {
    "rig.gantries": {"simple": "sim_backends.simple_devices:SimpleGantry"},
    "rig.axes": {"simple": "sim_backends.simple_devices:SimpleAxis"},
    "rig.cameras": {"simple": "sim_backends.simple_devices:SimpleCamera"},
}


def install(folder: Path, **more: dict[str, str]) -> Path:
    """Write a distribution with our own drivers, the simple devices and more; returns the folder for the path.

    Args:
        folder: empty, or not there.
        more: by group (``axes`` ...), entry points by name.
    """
    ours = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    lines = []
    for group in GROUPS:
        points = ours[group] | SIMPLE[group] | more.get(group.removeprefix("rig."), {})
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in points.items())]
    info = folder / "benchdrivers-1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: benchdrivers\nVersion: 1\n")
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder
