"""A small model base and plans for it, so that whole evaluations take seconds."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from calibration_free_tests.recognition.synthetic import three_buildings
from recognition.modelbase_write import model_base_to_yaml
from rig.cli.app import app
from rig.evaluate.plan import Plan, load_plan
from rig.evaluate.store import Store
from rig.evaluate.work import Record

PLAN = """\
schema: 1
title: Three buildings
trials: 6
rows:
  - name: clean
    models: [three.yaml]
    recogniser: {max_views: 4}
  - name: dirty
    models: [three.yaml]
    recogniser: {max_views: 4}
    noise: {missed: 0.3, false_parts: 0.2, corner_sd_px: 1.0}
"""


def plan_file(folder: Path, text: str = PLAN) -> Path:
    """A plan and its model base in a folder."""
    (folder / "three.yaml").write_text(model_base_to_yaml(three_buildings(), "Three buildings."))
    (folder / "plan.yaml").write_text(text)
    return folder / "plan.yaml"


def small_plan(folder: Path, text: str = PLAN) -> Plan:
    """The plan, read."""
    return load_plan(str(plan_file(folder, text)))


def without_times(records: Sequence[Record]) -> list[Record]:
    """Records but for what the computer's speed and memory decide, in the order of their trials."""
    kept = [{key: value for key, value in r.items() if key not in ("seconds", "rss_mib")} for r in records]
    return sorted(kept, key=lambda record: (record["row"], record["number"]))


def kept(folder: Path, plan: Plan) -> list[Record]:
    """What a folder holds."""
    with Store(folder, plan) as store:
        return without_times(list(store.records.values()))


def evaluate(*words: object) -> tuple[int, dict[str, Any] | None, str]:
    """Run ``rig evaluate``; returns exit code, the JSON object if there is one, and stderr."""
    done = CliRunner().invoke(app, ["evaluate", *map(str, words)])
    text = done.stdout.strip()
    return done.exit_code, json.loads(text) if text.startswith("{") else None, done.stderr


def never() -> bool:
    """Do not stop."""
    return False


def after(count: int) -> Callable[[], bool]:
    """Ask to stop when asked for the ``count``-th time."""
    asked = iter(range(count - 1))
    return lambda: next(asked, None) is None
