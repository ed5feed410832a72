"""Writes the bench file of an emulated bench: the one that was read, with the emulated ports in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from rig.bench import BenchConfig
from rig.emulation.serving import LATENCY_S

_ONLY_USB = ("usb_id", "usb_serial", "pixel_format")


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
    head = f"# Written by `rig emulate`: {config.name} on emulators. It holds as long as they run.\n"
    return head + yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
