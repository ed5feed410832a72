"""Puts the page together: reads the run folder, draws, and fills the template."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from recognition.geometry import Mount
from recognition.steps import Answer, Outcome
from rig.errors import InputError, RigError
from rig.report import charts, plans, views
from rig.run import RunRecord, read_run
from rig.table import row_of

HEADLINES = {
    Outcome.RECOGNISED: "Recognised",
    Outcome.AMBIGUOUS: "Ambiguous",
    Outcome.UNKNOWN: "None of the known objects",
    Outcome.NOT_FOUND: "Not found",
    Outcome.ABORTED: "Aborted",
}
AXES = (("x_mm", "X", "mm"), ("y_mm", "Y", "mm"), ("z_mm", "Z", "mm"), ("theta_deg", "pan", "°"))


def write_report(folder: Path, out: Path | None = None, allow_partial: bool = False) -> Path:
    """Write the report of a run and return its path (``report.html`` in the run folder by default).

    Raises:
        InputError: the run folder is damaged; names file and line.
        RigError: the page cannot be written.
    """
    page = render(read_run(folder, allow_partial))
    path = out or folder / "report.html"
    temporary = path.with_name(path.name + ".tmp")
    try:
        temporary.write_text(page, encoding="utf-8")
        os.replace(temporary, path)
    except OSError as error:
        raise RigError(f"{path}: cannot be written ({error.strerror}). Choose another --out") from error
    return path


def render(run: RunRecord) -> str:
    """The page as text."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    # Labels come from users' files and are never trusted to be harmless.
    environment = Environment(
        loader=PackageLoader("rig.report", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    posterior, legend = charts.posterior_chart(run.steps)
    return environment.get_template("page.html").render(
        headline=HEADLINES[run.answer.outcome],
        outcome=run.answer.outcome.value,
        subject=_subject(run),
        answer=run.answer,
        figures=_figures(run),
        pose=_pose(run.answer),
        posterior=posterior,
        legend=legend,
        hypotheses=charts.hypotheses_chart(run.steps),
        drawings=_drawings(run),
        views=_views(run),
        facts=_facts(run.start),
    )


def _subject(run: RunRecord) -> str | None:
    """The object that the page draws: the one recognised, or else the leading one."""
    if run.answer.object_id is not None:
        return run.answer.object_id
    leaders = [step.belief.leaders[0].object_id for step in run.steps if step.belief.leaders]
    return leaders[-1] if leaders else None


def _figures(run: RunRecord) -> list[tuple[str, str]]:
    steps, answer = run.steps, run.answer
    if not steps:
        return []
    first, last = steps[0].belief, steps[-1].belief
    seconds = [step.seconds.detect + step.seconds.update + step.seconds.plan for step in steps]
    return [
        (f"{len(steps)}", "view" if len(steps) == 1 else "views"),
        (f"{first.hypotheses_left:,} → {last.hypotheses_left:,}", "hypotheses after the first and the last view"),
        (f"{first.entropy_bits:.1f} → {last.entropy_bits:.1f}", "bits of uncertainty"),
        (f"{answer.travel_mm:,.0f} mm", "travel"),
        (f"{answer.rotation_deg:.0f}°", "rotation"),
        (f"{float(np.median(seconds)):.2f} s", "thinking per view (median)"),
    ]


def _pose(answer: Answer) -> list[tuple[str, str, str]]:
    """Rows of axis, value, and standard deviation."""
    if answer.pose is None:
        return []
    rows = []
    for key, name, unit in AXES:
        sd = answer.pose_sd.get(key)
        known = "unknown" if sd is None else f"± {sd:.3g} {unit}" if np.isfinite(sd) else "not determined"
        rows.append((name, f"{getattr(answer.pose, key):,.{2 if unit == '°' else 1}f} {unit}", known))
    return rows


def _drawings(run: RunRecord) -> dict[str, Any] | None:
    subject = _subject(run)
    thing = next((thing for thing in run.objects if thing.id == subject and thing.parts), None)
    if thing is None:
        return None
    sightings = plans.Sightings.of(thing, run.steps)
    path = plans.camera_path(run.steps, run.answer, _mount(run))
    drawn = plans.plan(thing, sightings, path)
    return {"plan": drawn, "walls": plans.unfolded(thing, sightings), "has_path": bool(path)}


def _mount(run: RunRecord) -> Mount:
    try:
        mount = dict(_settings(run.start).get("mount", {}))
        return Mount(**{f.name: float(mount.get(f.name, f.default)) for f in fields(Mount)})
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the mount is not made of numbers ({error})",
            where=f"{run.folder / 'events.jsonl'}:1",
            remedy="Correct the start event's settings",
        ) from error


def _views(run: RunRecord) -> list[dict[str, Any]]:
    cards = []
    for step, reason in zip(run.steps, run.reasons, strict=True):
        leader = step.belief.leaders[0] if step.belief.leaders else None
        matches = leader.matches if leader else ()
        cards.append(
            {
                "row": row_of(step),
                "reason": reason,
                "pose": step.frame.rig_pose,
                "name": step.frame.name,
                "seconds": step.seconds,
                "picture": views.data_uri(step.frame.image),
                "overlay": views.overlay(step),
                "leader": leader,
                "expected": len(matches),
                "explained": sum(match.detection is not None for match in matches),
            }
        )
    return cards


def _facts(start: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    settings = _settings(start)
    keys = ("mode", "policy", "threshold", "max_views", "seed", "detector")
    facts = [(key.replace("_", " "), str(settings[key])) for key in keys if key in settings]
    named = {"models": "models", "bench": "bench", "started": "time", "command": "command", "version": "version"}
    return [(label, str(start[key])) for label, key in named.items() if start.get(key)] + facts


def _settings(start: Mapping[str, Any]) -> Mapping[str, Any]:
    settings = start.get("settings")
    return settings if isinstance(settings, Mapping) else {}
