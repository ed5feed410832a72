"""Writes the bench file of an emulated bench: the one that was read, with the emulated ports in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rig.bench import BenchConfig
from rig.emulation.serving import LATENCY_S
from rig.errors import InputError

MARK = "# Written by `rig emulate`"
"""How the files begin that may be written again: nothing of anybody's is in them."""
_ONLY_USB = ("usb_id", "usb_serial", "pixel_format")


def refuse_overwriting(path: Path) -> None:
    """Return if a bench file may be written here.

    Raises:
        InputError: there is a file that `bench_text` has not made.
    """
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            ours = file.read(len(MARK)) == MARK
    except FileNotFoundError:
        return
    except OSError as failure:
        reason = f"the bench file cannot be written ({failure.strerror or failure})"
        raise InputError(reason, where=str(path), remedy="Name another place") from failure
    if not ours:
        raise InputError(
            "there is a file of that name, which `rig emulate` has not written",
            where=str(path),
            remedy="Name another with --bench-out, or overwrite it with --force",
        )


def bench_text(config: BenchConfig, ports: Mapping[str, str], url: str) -> str:
    """The bench file's text.

    Args:
        config: as it was read.
        ports: paths of the pseudo-terminals, by the ports that the file names.
        url: of the camera's stream.
    """
    data: dict[str, Any] = config.file.model_dump(mode="json", by_alias=True, exclude_unset=True)
    for role, device in data["devices"].items():
        if role != "camera":
            device["port"] = ports[device["port"]]
    camera = {key: value for key, value in data["devices"]["camera"].items() if key not in _ONLY_USB}
    camera |= {"source": url, "latency_s": max(LATENCY_S, camera.get("latency_s", 0.0))}
    data["devices"]["camera"] = camera
    head = f"{MARK}: {config.name} on emulators. It holds as long as they run.\n"
    return head + yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
