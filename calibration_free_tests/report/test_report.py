"""The report is one harmless file that shows all of a run, however the run ended."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration_free_tests.scripted_run import CAMERAS, scripted_models, scripted_steps
from recognition.geometry import Mount
from recognition.modelbase import Face, ObjectModel, Part
from rig.errors import InputError
from rig.report import write_report
from rig.report.plans import Sightings, camera_path, unfolded
from rig.report.views import MAX_WIDTH, data_uri, overlay
from rig.run import RunRecorder, RunStart, Steps, read_run, watch

HOSTILE = '"><script>alert(1)</script><img src=x onerror=alert(2)>{{7*7}}</svg></title>\x1b[31m'


def run_folder(folder: Path, steps: Steps) -> Path:
    keeper = RunRecorder(folder, RunStart("three", "scripted", {"mode": "graded"}), scripted_models())
    watch(keeper.record(steps), lambda _: None)
    return folder


class Page(HTMLParser):
    """Collects tags and attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def count(self, tag: str) -> int:
        return sum(name == tag for name, _ in self.tags)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = run_folder(tmp_path_factory.mktemp("runs") / "run", scripted_steps())
    return write_report(folder).read_text(encoding="utf-8")


def assert_self_contained(text: str) -> None:
    page = Page(text)
    for tag, attributes in page.tags:
        assert tag not in {"script", "link", "iframe", "object", "embed", "base", "form"}
        for name, value in attributes.items():
            assert not name.startswith("on"), (tag, name)
            if name in {"src", "href", "xlink:href", "action", "data", "srcset", "poster"}:
                assert (value or "").startswith("data:image/jpeg;base64,"), (tag, name)
    outside_pictures = re.sub(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", "", text)
    assert "://" not in outside_pictures
    assert "url(" not in outside_pictures
    assert "@import" not in outside_pictures


def test_report_refers_to_nothing_outside_itself(page: str) -> None:
    assert_self_contained(page)
    assert "default-src 'none'" in page


def test_report_shows_every_view_with_its_parts(page: str) -> None:
    steps = list(scripted_steps())
    assert Page(page).count("img") == len(steps)
    for step in steps:
        if step.move:
            assert step.move.why in page
    polygons = sum(len(step.parts) + len(step.belief.leaders[0].matches) for step in steps)
    parts = len(scripted_models().objects[0].parts)
    assert Page(page).count("polygon") == polygons + parts + len(steps)


def test_report_tells_the_answer(page: str) -> None:
    for text in ("Recognised", "tower", "99.6 %", "± 0.21 °", "1,010.0 mm", "374", "none of these objects"):
        assert text in page


def test_hostile_labels_stay_text(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run", scripted_steps(labels=HOSTILE))
    text = write_report(folder).read_text(encoding="utf-8")
    assert_self_contained(text)
    assert "alert(1)" in text
    assert "{{7*7}}" in text


@pytest.mark.parametrize("views", [0, 1, 2])
def test_aborted_run_has_a_report_too(tmp_path: Path, views: int) -> None:
    folder = run_folder(tmp_path / "run", scripted_steps(views, failure=KeyboardInterrupt()))
    text = write_report(folder).read_text(encoding="utf-8")
    assert "Aborted" in text
    assert Page(text).count("img") == views
    assert_self_contained(text)


def test_run_without_outlines_or_leaders_has_a_report(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run", scripted_steps())
    (folder / "objects.json").unlink()
    lines = []
    for line in (folder / "events.jsonl").read_text().splitlines():
        event = json.loads(line)
        if event["kind"] == "belief":
            event |= {"leaders": [], "posterior": {"unknown": 1.0}, "hypotheses_left": 0}
        if event["kind"] == "finish":
            event |= {"outcome": "unknown", "object": None, "pose": None, "pose_sd": {}, "posterior": {}}
        lines.append(json.dumps(event))
    (folder / "events.jsonl").write_text("\n".join(lines) + "\n")
    assert "None of the known objects" in write_report(folder).read_text(encoding="utf-8")


def test_damaged_run_is_refused_by_line(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run", scripted_steps())
    text = (folder / "events.jsonl").read_text()
    (folder / "events.jsonl").write_text(text[: len(text) // 2])
    with pytest.raises(InputError, match=r"events\.jsonl:\d+: .*cut off"):
        write_report(folder)


def test_camera_path_follows_the_moves_of_the_rig(tmp_path: Path) -> None:
    run = read_run(run_folder(tmp_path / "run", scripted_steps()))
    path = camera_path(run.steps, run.answer, Mount())
    for found, true in zip(path, CAMERAS, strict=True):
        assert np.allclose(found.centre_mm, true.centre_mm, atol=1e-6)
        assert found.theta_deg == pytest.approx(true.theta_deg)


def test_names_of_narrow_walls_do_not_run_into_each_other() -> None:
    def wall(k: int) -> tuple[Face, Part]:
        turn = np.radians(30.0 * k)
        along = np.array([np.cos(turn), 0.0, np.sin(turn)])
        down = np.array([0.0, 3.0, 0.0])
        corners = np.array([0 * along, along, along + down, down]) * 40.0 + 500.0 * k
        name = f"T{k}_tower_on_the_left_of_the_gate_beyond_the_moat"
        return Face(name, corners), Part(f"window {k}", "DW4", 0.5 * corners + 0.5 * corners.mean(axis=0), name)

    walls = [wall(k) for k in range(8)]
    thing = ObjectModel("narrow", tuple(part for _, part in walls), tuple(face for face, _ in walls))
    drawn = str(unfolded(thing, Sightings({}, {})))
    texts = re.findall(r'<text class="tick" x="([\d.]+)" y="([\d.]+)"[^>]*>([^<]+)</text>', drawn)
    assert len(texts) == 8
    labels = sorted((float(y), float(x), name) for x, y, name in texts)
    for (y, x, name), (next_y, next_x, _) in pairwise(labels):
        # In the page's 12 px font a letter is about 6.5 px wide.
        assert next_y > y + 12 or next_x > x + 6.5 * len(name)


def test_detections_are_not_called_parts(page: str) -> None:
    assert "13 detections; with tower at front 2.3" in page
    assert "parts found" not in page


def test_no_other_outline_hides_a_detection_that_was_taken_for_a_part() -> None:
    drawn = re.findall(r'<polygon class="(\w+)"', str(overlay(list(scripted_steps())[1])))
    assert {"clutter", "expected", "found"} <= set(drawn)
    assert set(drawn[drawn.index("found") :]) == {"found"}


def test_pictures_are_shrunk_to_a_moderate_size() -> None:
    wide = np.tile(next(scripted_steps()).frame.image, (4, 4, 1))
    data = base64.b64decode(data_uri(wide).split(",", 1)[1])
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape[1] == MAX_WIDTH


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        '{"objects": [{"id": "a", "faces": [], "parts": [{"id": 1, "corners_mm": [1]}]}]}',
        "[" * 100_000,
    ],
)
def test_damaged_outlines_are_refused(tmp_path: Path, text: str) -> None:
    folder = run_folder(tmp_path / "run", scripted_steps())
    (folder / "objects.json").write_text(text)
    with pytest.raises(InputError, match=r"objects\.json"):
        write_report(folder)


def test_damaged_mount_is_refused_by_line(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run", scripted_steps())
    first, *rest = (folder / "events.jsonl").read_text().splitlines()
    event = json.loads(first) | {"settings": {"mount": {"x_mm": "far"}}}
    (folder / "events.jsonl").write_text("\n".join([json.dumps(event), *rest]) + "\n")
    with pytest.raises(InputError, match=r"events\.jsonl:1: the mount"):
        write_report(folder)
