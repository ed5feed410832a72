"""Plans say which poses; what is wrong with one is told with its place in the file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rig.errors import InputError
from rig.hal import RigPose
from rig.scan import OneSided, load_plan

EXAMPLE = Path(__file__).parents[2] / "examples" / "scan.yaml"
LATTICE = "lattice: {x_mm: 0, y_mm: 0, z_mm: 0, theta_deg: [0, 1]}"


def plan_file(folder: Path, text: str) -> Path:
    path = folder / "plan.yaml"
    path.write_text(f"schema: 1\n{text}\n")
    return path


def test_the_example_is_a_plan_and_so_is_what_it_has_commented_out(tmp_path: Path) -> None:
    plan = load_plan(EXAMPLE)
    assert len(plan.poses) == 5 * 2 * 1 * 3 * 2
    assert plan.poses[0] == RigPose(-100.0, -120.0, 0.0, -15.0, 0.0)
    hidden = re.findall(r"^# ((?:poses|zooms|one_sided):.*|  .*)$", EXAMPLE.read_text(), re.MULTILINE)
    other = load_plan(plan_file(tmp_path, "\n".join(hidden)))
    assert len(other.poses) == 4
    assert [side.axis for side in other.sides] == ["x_mm", "zoom"]


def test_a_range_has_both_ends_and_round_numbers(tmp_path: Path) -> None:
    text = "lattice: {x_mm: {from: 0, to: 0.3, step: 0.1}, y_mm: {from: -1, to: 1, count: 3}, z_mm: 5, theta_deg: 0}"
    poses = load_plan(plan_file(tmp_path, text)).poses
    assert sorted({pose.x_mm for pose in poses}) == [0.0, 0.1, 0.2, 0.3]
    assert sorted({pose.y_mm for pose in poses}) == [-1.0, 0.0, 1.0]


def test_a_list_keeps_its_order_at_every_zoom(tmp_path: Path) -> None:
    text = (
        "poses:\n- {x_mm: 9, y_mm: 0, z_mm: 0, theta_deg: 1}\n- {x_mm: 1, y_mm: 0, z_mm: 0, theta_deg: 1}\n"
        "zooms: [0, 1]\none_sided: {zoom: {from: below, overshoot: 0.1}}\npicture: {format: jpg, jpeg_quality: 80}"
    )
    plan = load_plan(plan_file(tmp_path, text))
    assert [(pose.x_mm, pose.zoom) for pose in plan.poses] == [(9.0, 0.0), (9.0, 1.0), (1.0, 0.0), (1.0, 1.0)]
    assert plan.sides == (OneSided("zoom", "below", 0.1),)
    assert (plan.suffix, plan.quality) == (".jpg", 80)


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("lattice: {x_mm: {from: 0, to: 10, step: 3}, y_mm: 0, z_mm: 0, theta_deg: 0}", "2:17", "at 9 or 12"),
        ("lattice: {x_mm: {from: 0, to: 10}, y_mm: 0, z_mm: 0, theta_deg: 0}", "2:17", "either step or count"),
        ("lattice: {x_mm: {from: 9, to: 0, step: 3}, y_mm: 0, z_mm: 0, theta_deg: 0}", "2:17", "above `from`"),
        ("lattice: {x_mm: {from: 0, to: 9, stpe: 3}, y_mm: 0, z_mm: 0, theta_deg: 0}", "2:34", "Did you mean 'step'"),
        ("lattice: {x_mm: [0, '1'], y_mm: 0, z_mm: 0, theta_deg: 0}", "2:21", "Remove the quotes"),
        ("lattice: {x_mm: .nan, y_mm: 0, z_mm: 0, theta_deg: 0}", "2:17", "finite"),
        ("lattice: {x_mm: 0, y_mm: 0, z_mm: 0}", "2:10", "theta_deg: this key is missing"),
        ("lattice: {x_mm: [], y_mm: 0, z_mm: 0, theta_deg: 0}", "2:17", "at least 1"),
        ("lattice: {x_mm: [3, 4, 3], y_mm: 0, z_mm: 0, theta_deg: 0}", "2:10", "x_mm 3, y_mm 0"),
        ("lattice: {x_mm: 0, y_mm: 0, z_mm: 0, theta_deg: [0, 360]}", "2:10", "a full turn leads back"),
        ("lattice: {x_mm: 0, y_mm: 0, z_mm: 0, theta_deg: 0, order: [x_mm]}", "2:10", "should name each of"),
        (
            "lattice: {x_mm: {from: 0, to: 999, step: 1}, y_mm: {from: 0, to: 999, step: 1}, z_mm: 0, theta_deg: 0}",
            "2:10",
            "1000000 poses, more than 100000",
        ),
        ("note: nothing", "1:1", "either lattice or poses"),
        (f"{LATTICE}\nzooms: [0]", "1:1", "zooms go with poses"),
        ("poses: [{x_mm: 0, y_mm: 0, z_mm: 0, theta_deg: 0, zoom: 1}]\nzooms: [0]", "1:1", "a zoom with each pose"),
        ("poses: [{x_mm: 0, y_mm: 0, z_mm: 0, theta_deg: 0, zoom: 1.5}]", "2:57", "less than or equal to 1"),
        (f"{LATTICE}\none_sided: {{x_mm: {{from: left, overshoot: 1}}}}", "3:26", "'below' or 'above'"),
        (f"{LATTICE}\none_sided: {{x_mm: {{from: below, overshoot: 0}}}}", "3:44", "greater than 0"),
        (f"{LATTICE}\nretries: many", "3:10", "a whole number"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path: Path, text: str, where: str, what: str) -> None:
    path = plan_file(tmp_path, text)
    with pytest.raises(InputError) as caught:
        load_plan(path)
    assert f"{path}:{where}: " in str(caught.value)
    assert what in str(caught.value)


def test_the_digest_is_of_the_pictures_not_of_the_words(tmp_path: Path) -> None:
    first = load_plan(plan_file(tmp_path, LATTICE)).sha256
    assert load_plan(plan_file(tmp_path, f"# a comment\n{LATTICE}\nretries: 7\nnote: again")).sha256 == first
    for other in (
        LATTICE.replace("z_mm: 0", "z_mm: 1"),
        f"{LATTICE}\npicture: {{format: jpg}}",
        f"{LATTICE}\none_sided: {{x_mm: {{from: below, overshoot: 1}}}}",
        LATTICE.replace("[0, 1]", "[0, 2]"),
    ):
        assert load_plan(plan_file(tmp_path, other)).sha256 != first
