"""Writing the mount into a bench file changes the mount's numbers and not a letter besides."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from recognition.geometry import Mount
from rig.align import entry_of, write_bench
from rig.bench import load_bench
from rig.errors import InputError

FOUND = Mount(x_mm=12.0626, y_mm=-3.5, z_mm=45.11, pan_zero_deg=-178.25, roll_deg=0.4, pitch_deg=-0.0601)
LINE = "{x_mm: 12.0626, y_mm: -3.5, z_mm: 45.11, pan_zero_deg: -178.25, roll_deg: 0.4, pitch_deg: -0.0601}"
MOCK = "schema: 1   # the first\nkind: mock\n\n# Wide bounds.\nobject: {distance_mm: [50, 1000]}\n"
LIVE = """\
schema: 1
kind: live
devices:  # on the shelf
  gantry: {driver: grbl, port: /dev/serial/by-id/one}
  camera: {driver: opencv, source: /dev/video0}
axes:
  x_mm: {lower: 0, upper: 400, speed_mm_per_s: 80}  # measured with a ruler
  y_mm: {lower: 0, upper: 300, speed_mm_per_s: 80}
  z_mm: {lower: 0, upper: 200, speed_mm_per_s: 40}
safety: {margin_mm: 80, keep_out: [{x_mm: [500, 600], y_mm: [0, 300], z_mm: [0, 200]}]}
"""


def written(folder: Path, text: str, mount: Mount = FOUND) -> str:
    bench, out = folder / "bench.yaml", folder / "new.yaml"
    bench.write_text(text)
    write_bench(bench, mount, out)
    assert bench.read_text() == text
    return out.read_text()


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", f"mount: {LINE}\n"),
        ("mount: {}  # none yet\n", f"mount: {LINE}  # none yet\n"),
        (
            "mount: {z_mm: 1, x_mm: 0}  # arm\ngoal: {pose_sd_mm: 3}  # near\n",
            "mount: {z_mm: 45.11, x_mm: 12.0626, y_mm: -3.5, pan_zero_deg: -178.25, roll_deg: 0.4, "
            "pitch_deg: -0.0601}  # arm\ngoal: {pose_sd_mm: 3}  # near\n",
        ),
        (
            "mount:\n  # how it hangs\n  pan_zero_deg: 0  # turned\n  x_mm: 10.0 # right\n\ngoal: {pose_sd_mm: 3}\n",
            "mount:\n  # how it hangs\n  pan_zero_deg: -178.25  # turned\n  x_mm: 12.0626 # right\n  y_mm: -3.5\n"
            "  z_mm: 45.11\n  roll_deg: 0.4\n  pitch_deg: -0.0601\n\ngoal: {pose_sd_mm: 3}\n",
        ),
        ("mount:\n    x_mm: 0", "mount:\n    x_mm: 12.0626\n    y_mm: -3.5\n    z_mm: 45.11\n    "
         "pan_zero_deg: -178.25\n    roll_deg: 0.4\n    pitch_deg: -0.0601"),
    ],
    ids=["none", "empty", "flow", "block", "block without a last line's end"],
)  # fmt: skip
@pytest.mark.parametrize("head", [MOCK, LIVE], ids=["mock", "live"])
def test_only_the_mount_changes(head: str, before: str, after: str, tmp_path: Path) -> None:
    assert written(tmp_path, head + before) == head + after


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    axes = "axes: {x_mm: {lower: 0, upper: 9, scale: 1.02}}\n"
    written(tmp_path, MOCK + axes + "mount: {x_mm: 1e1}\n")
    back = load_bench(tmp_path / "new.yaml").mount
    assert entry_of(back) == entry_of(FOUND)
    assert back.x_scale == 1.02


def test_a_file_in_flow_style_stays_so(tmp_path: Path) -> None:
    text = written(tmp_path, "{schema: 1, kind: mock}\n")
    assert text == f"{{schema: 1, kind: mock, mount: {LINE}}}\n"
    assert yaml.safe_load(text)["mount"] == entry_of(FOUND)


def test_lines_that_end_as_on_windows_are_kept(tmp_path: Path) -> None:
    bench, out = tmp_path / "bench.yaml", tmp_path / "new.yaml"
    bench.write_bytes(b"schema: 1\r\nkind: mock\r\nmount:\r\n  x_mm: 0  # right\r\n  roll_deg: 0\r\n")
    write_bench(bench, FOUND, out)
    assert entry_of(load_bench(out).mount) == entry_of(FOUND)
    assert b"# right" in out.read_bytes()


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "new.yaml").write_text("mine")
    with pytest.raises(InputError, match=r"new\.yaml: is there already\. Name a new file"):
        written(tmp_path, MOCK)
    assert (tmp_path / "new.yaml").read_text() == "mine"
    with pytest.raises(InputError, match="cannot be written"):
        write_bench(tmp_path / "bench.yaml", FOUND, tmp_path / "nowhere" / "new.yaml")


def test_an_arm_beyond_the_safety_margin_is_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"margin_mm: 80 mm is shorter than the mount's lever arm"):
        written(tmp_path, LIVE, Mount(x_mm=100.0))
    assert not (tmp_path / "new.yaml").exists()
