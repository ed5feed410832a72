"""Changes the mount in the text of a bench file and leaves everything else, comments too, as it stands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rig.bench import bench_file
from rig.errors import InputError
from rig.schema import BENCH_MAX_BYTES, load_yaml, parse_yaml

_KEY = "mount"


def with_mount(bench: Path, values: Mapping[str, float]) -> str:
    """The text of a bench file with these values in its mount.

    Args:
        bench: a bench file in order.
        values: all numbers of the mount's entry, mm and degrees.

    Raises:
        InputError: the file is not in order, or its mount is written in a way that cannot be changed by itself.
    """
    document = load_yaml(bench, max_bytes=BENCH_MAX_BYTES)
    before = bench_file(document)
    text = _changed(document.text, {name: f"{value:.10g}" for name, value in values.items()})
    after = bench_file(parse_yaml(text, str(bench)))
    if after.mount.model_dump() != dict(values) or after.model_copy(update={_KEY: before.mount}) != before:
        raise InputError(
            "its mount is written in a way that cannot be changed by itself",
            where=str(bench),
            remedy="Put the printed line into the file by hand",
        )
    return text


def _changed(text: str, values: Mapping[str, str]) -> str:
    root: Any = yaml.compose(text, Loader=yaml.SafeLoader)
    entry = next((value for key, value in root.value if key.value == _KEY), None)
    if entry is None:
        line = f"{_KEY}: {{{_pairs(values)}}}"
        if root.flow_style:
            end = root.end_mark.index - 1
            return f"{text[:end]}, {line}{text[end:]}"
        return f"{text}{'' if text.endswith(chr(10)) else chr(10)}{line}\n"
    there = {key.value: value for key, value in entry.value}
    missing = {name: value for name, value in values.items() if name not in there}
    if missing:
        at, insertion = _room(text, entry, missing)
        text = text[:at] + insertion + text[at:]
    # From the end on, so that the marks before stay right. What is missing was inserted after all of them.
    for name, node in sorted(there.items(), key=lambda item: -item[1].start_mark.index):
        text = text[: node.start_mark.index] + values[name] + text[node.end_mark.index :]
    return text


def _room(text: str, entry: Any, missing: Mapping[str, str]) -> tuple[int, str]:
    """Where in the text the missing keys go, and how they are written there."""
    last = entry.value[-1] if entry.value else None
    if last is None:
        return entry.end_mark.index - 1, _pairs(missing)
    if entry.flow_style:
        return last[1].end_mark.index, f", {_pairs(missing)}"
    end = text.find("\n", last[1].end_mark.index)
    indent = "\n" + " " * last[0].start_mark.column
    return (len(text) if end < 0 else end), "".join(f"{indent}{name}: {value}" for name, value in missing.items())


def _pairs(values: Mapping[str, str]) -> str:
    return ", ".join(f"{name}: {value}" for name, value in values.items())
