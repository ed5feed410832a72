"""Writes the model bases and the JSON Schema that ship with the package: ``python -m sim_backends.scenes.ship``."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

from recognition.modelbase_file import json_schema
from sim_backends.scenes import architecture, campus


def shipped_texts() -> dict[str, str]:
    """File name to text, as generated now."""
    return {
        "architecture.yaml": architecture.to_yaml(),
        "campus.yaml": campus.to_yaml(),
        "modelbase.schema.json": json.dumps(json_schema(), indent=2) + "\n",
    }


if __name__ == "__main__":
    for file_name, text in shipped_texts().items():
        (Path(str(resources.files("rig"))) / "data" / file_name).write_text(text, encoding="utf-8")
