"""A scan keeps what is good, stores while it moves, and ends cleanly whatever fails or whoever stops it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from calibration_free_tests.scan.sample import FakeClock, FakeRig, SimulatedStore, a_scan, image_at, row, scan_into
from rig.errors import HardwareError, InputError, RigError, UnreachableError
from rig.hal import Frame, RigPose
from rig.imagegrid import GridFrame, GridInfo, GridWriter, read_grid
from rig.scan import BackgroundStore, Finish, OneSided, all_legs, estimate, preflight, refuse_small_disk
from rig.scan.preflight import GROWTH, SPARE_BYTES, travel_seconds

FILES = [f"images/{k:05d}.png" for k in range(1, 20)]


def quick_store(rig: FakeRig, cost_s: float = 0.0) -> SimulatedStore:
    return SimulatedStore(rig.clock, lambda n: cost_s)


def fail_at(what: str, pose: RigPose, error: RigError) -> Callable[[str, RigPose], None]:
    def before(doing: str, at: RigPose) -> None:
        if (doing, at) == (what, pose):
            raise error

    return before


def test_a_scan_is_an_image_grid_of_its_poses(tmp_path: Path) -> None:
    scan = scan_into(tmp_path / "grid", row(4))
    assert scan.finish is Finish.DONE
    grid = read_grid(tmp_path / "grid")
    assert [frame.pose for frame in grid.frames] == list(row(4))
    assert [frame.file for frame in grid.frames] == FILES[:4]
    for frame in grid.frames:
        assert np.array_equal(grid.load(frame), image_at(frame.pose))
        assert frame.taken_at == "2026-01-31T00:00:00.000+00:00"


def test_poses_may_come_from_a_planner_that_sees_what_was_taken() -> None:
    rig = FakeRig()

    def planner() -> Iterator[RigPose]:
        yield row(1)[0]
        while len(rig.captured) < 3:
            yield RigPose(rig.captured[-1].x_mm + 7.0, 0.0, 0.0, 0.0)

    frames = list(a_scan(rig, planner(), quick_store(rig)))
    assert [frame.pose.x_mm for frame in frames] == [0.0, 7.0, 14.0]


def test_storing_overlaps_moving() -> None:
    """A store that takes as long as a move adds nothing but the last picture's time."""
    poses, rig = row(20), FakeRig()
    bound = travel_seconds(rig, poses)
    began = rig.clock.now_s()
    move_s = rig.travel_s(poses[0], poses[1]) - rig.limits.exposure_s
    assert len(list(a_scan(rig, poses, quick_store(rig, move_s)))) == 20
    assert rig.clock.now_s() - began == pytest.approx(bound + move_s)


def test_a_slow_store_is_waited_for_so_that_a_kill_loses_one_picture_at_most() -> None:
    rig = FakeRig()
    store = quick_store(rig, 10.0)
    for number, _ in enumerate(a_scan(rig, row(5), store), start=1):
        assert len(rig.captured) == number


def test_the_background_store_really_works_beside_the_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first picture is not safe before the second move has begun: only a store of its own thread gets there."""
    rig, moving = FakeRig(), threading.Event()
    add = GridWriter.add

    def held_back(self: GridWriter, frame: Frame, file: str, **how: object) -> GridFrame:
        assert moving.wait(20.0)
        return add(self, frame, file, **how)  # type: ignore[arg-type]  # Passed on as they came.

    def before(what: str, pose: RigPose) -> None:
        if (what, pose) == ("move", row(2)[1]):
            moving.set()

    monkeypatch.setattr(GridWriter, "add", held_back)
    rig.before = before
    assert scan_into(tmp_path / "grid", row(2), rig).finish is Finish.DONE


def test_one_sided_axes_are_approached_by_the_runner_too() -> None:
    rig, sides = FakeRig(), [OneSided("x_mm", "below", 2.0)]
    poses = [RigPose(5.0, 0.0, 0.0, 0.0), RigPose(1.0, 0.0, 0.0, 0.0), RigPose(3.0, 0.0, 0.0, 0.0)]
    list(a_scan(rig, poses, quick_store(rig), sides=sides))
    assert [entry[1].x_mm for entry in rig.log if entry[0] == "move"] == [3.0, 5.0, -1.0, 1.0, 3.0]
    assert [entry[1] for entry in rig.log if entry[0] == "move"] == list(all_legs(poses, sides))
    assert rig.captured == poses


class FrozenError(HardwareError):
    """What a camera says that gives pictures, but bad ones."""


def bad_at(troubles: Callable[[RigPose], str]) -> Callable[[str, RigPose], None]:
    def before(what: str, pose: RigPose) -> None:
        if what == "capture" and (trouble := troubles(pose)):
            raise FrozenError(trouble)

    return before


def test_a_bad_picture_is_taken_again_after_a_pause() -> None:
    rig, verdicts, taken = FakeRig(), iter(["", "black", "frozen", ""]), []
    rig.before = bad_at(lambda pose: (taken.append(pose), next(verdicts))[1])
    frames = list(a_scan(rig, row(2), quick_store(rig), bad_frames=(FrozenError,), pause_s=60.0))
    assert [frame.pose for frame in frames] == list(row(2))
    assert taken == [row(2)[0], *[row(2)[1]] * 3]
    assert rig.clock.now_s() > 1000.0 + 120.0


def test_pictures_that_stay_bad_stop_the_scan_and_what_was_good_is_kept(tmp_path: Path) -> None:
    rig, taken = FakeRig(), []
    rig.before = bad_at(lambda pose: (taken.append(pose), "black" if pose == row(3)[2] else "")[1])
    with pytest.raises(HardwareError, match=r"images/00003\.png: no good .* in 3 attempts: black\..*--resume"):
        scan_into(tmp_path / "grid", row(5), rig, bad_frames=(FrozenError,), retries=2)
    assert len(taken) == 2 + 3
    assert [frame.file for frame in read_grid(tmp_path / "grid").frames] == FILES[:2]


def test_a_camera_that_fails_otherwise_is_not_tried_again() -> None:
    rig, taken = FakeRig(), []

    def before(what: str, pose: RigPose) -> None:
        if what == "capture":
            taken.append(pose)
            raise HardwareError("unplugged")

    rig.before = before
    with pytest.raises(HardwareError, match="unplugged"):
        list(a_scan(rig, row(2), quick_store(rig), bad_frames=(FrozenError,)))
    assert len(taken) == 1


@pytest.mark.parametrize("what", ["move", "capture"])
def test_a_failing_device_stops_the_scan_after_the_picture_in_hand_is_safe(tmp_path: Path, what: str) -> None:
    rig, kept = FakeRig(), []
    rig.before = fail_at(what, row(4)[2], HardwareError("ALARM:1 hard limit. Home again"))
    with pytest.raises(HardwareError, match="ALARM:1"):
        scan_into(tmp_path / "grid", row(4), rig, acknowledged=kept.append)
    assert [frame.file for frame in kept] == FILES[:2]
    assert len(read_grid(tmp_path / "grid").frames) == 2
    again = FakeRig()
    assert scan_into(tmp_path / "grid", row(4), again).finish is Finish.DONE
    assert again.captured == list(row(4)[2:])


def test_a_store_that_fails_stops_the_scan_and_the_rig_is_at_rest(tmp_path: Path) -> None:
    rig = FakeRig()

    class Full(SimulatedStore):
        def collect(self) -> GridFrame | None:
            if len(self.files) == 2:
                raise RigError("x.png: cannot be written (No space left on device)")
            return super().collect()

    scan = a_scan(rig, row(5), Full(rig.clock, lambda n: 0.0))
    with pytest.raises(RigError, match="No space left"):
        list(scan)
    assert scan.finish is Finish.FAILED
    assert rig.captured == list(row(2))
    assert rig.pose == row(3)[2]


def test_stop_between_two_moves_keeps_what_was_taken() -> None:
    rig = FakeRig()
    scan = a_scan(rig, row(9), quick_store(rig), stop=lambda: len(rig.captured) == 3)
    assert [frame.file for frame in scan] == FILES[:3]
    assert scan.finish is Finish.INTERRUPTED


def test_a_move_that_was_broken_off_for_a_stop_is_no_fault(tmp_path: Path) -> None:
    rig, asked = FakeRig(), []

    def before(what: str, pose: RigPose) -> None:
        if pose == row(9)[3]:
            asked.append(True)
            raise HardwareError("motion was held")

    rig.before = before
    scan = scan_into(tmp_path / "grid", row(9), rig, stop=lambda: bool(asked))
    assert scan.finish is Finish.INTERRUPTED
    assert scan.broken_off == "motion was held"
    assert len(read_grid(tmp_path / "grid").frames) == 3


def test_ctrl_c_just_before_a_picture_is_no_fault() -> None:
    """It holds the motion after the rig has arrived, so the picture is refused."""
    rig, asked = FakeRig(), []

    def before(what: str, pose: RigPose) -> None:
        if what == "capture" and pose == row(5)[2]:
            asked.append(True)
            raise RigError("motion is held. Resume it first")

    rig.before = before
    scan = a_scan(rig, row(5), quick_store(rig), stop=lambda: bool(asked))
    assert len(list(scan)) == 2
    assert scan.finish is Finish.INTERRUPTED
    assert scan.broken_off == "motion is held. Resume it first"


def test_stopping_in_mid_move_takes_no_picture_there() -> None:
    """The rig may stand anywhere on the way."""
    rig, moves = FakeRig(), []
    rig.before = lambda what, pose: moves.append(pose) if what == "move" else None
    scan = a_scan(rig, row(5), quick_store(rig), stop=lambda: len(moves) >= 2)
    assert len(list(scan)) == 1
    assert rig.captured == [row(5)[0]]


def test_an_interrupt_leaves_the_picture_in_hand_on_the_disk(tmp_path: Path) -> None:
    """Ctrl-C a second time is raised wherever the program is."""
    rig = FakeRig()

    def before(what: str, pose: RigPose) -> None:
        if (what, pose) == ("move", row(3)[2]):
            raise KeyboardInterrupt

    rig.before = before
    with pytest.raises(KeyboardInterrupt):
        scan_into(tmp_path / "grid", row(3), rig)
    assert len(read_grid(tmp_path / "grid").frames) == 2


def test_clock_jumps_change_nothing(tmp_path: Path) -> None:
    jumps = iter([3600, -3600, 7200, -7200, 0, 3600, -3600, 1800])

    def now() -> datetime:
        return datetime(2026, 1, 31, tzinfo=UTC) + timedelta(seconds=next(jumps))

    rig = FakeRig()
    rig.before = fail_at("capture", row(4)[2], HardwareError("unplugged"))
    with pytest.raises(HardwareError):
        scan_into(tmp_path / "grid", row(4), rig, now=now)
    again = FakeRig()
    scan_into(tmp_path / "grid", row(4), again, now=now)
    assert again.captured == list(row(4)[2:])
    frames = read_grid(tmp_path / "grid").frames
    assert [frame.file for frame in frames] == FILES[:4]
    assert [frame.taken_at for frame in frames] != sorted(frame.taken_at or "" for frame in frames)


def test_resuming_takes_only_what_is_missing_or_damaged(tmp_path: Path) -> None:
    scan_into(tmp_path / "grid", row(5))
    (tmp_path / "grid" / FILES[1]).unlink()
    damaged = bytearray((tmp_path / "grid" / FILES[3]).read_bytes())
    damaged[70] ^= 4
    (tmp_path / "grid" / FILES[3]).write_bytes(damaged)
    rig = FakeRig()
    scan_into(tmp_path / "grid", row(5), rig)
    assert rig.captured == [row(5)[1], row(5)[3]]
    grid = read_grid(tmp_path / "grid")
    assert {frame.pose for frame in grid.frames} == set(row(5))
    for frame in grid.frames:
        assert np.array_equal(grid.load(frame), image_at(frame.pose))


def test_an_axis_that_is_stuck_is_noticed_by_its_poses(tmp_path: Path) -> None:
    class Stuck(FakeRig):
        def capture(self) -> Frame:
            self.pose = row(1)[0]
            return super().capture()

    with pytest.raises(InputError, match="same pose as images/00001"):
        scan_into(tmp_path / "grid", row(3), Stuck())


def test_all_poses_are_checked_before_the_first_move() -> None:
    rig = FakeRig()
    poses = [RigPose(0.0, 0.0, 0.0, 0.0), RigPose(0.0, 501.0, 0.0, 0.0), RigPose(0.0, 0.0, 0.0, float("nan"))]
    with pytest.raises(UnreachableError, match=r"2 of 3 poses.*y_mm = 501 is outside -500 \.\. 500"):
        preflight(rig, poses)
    assert not rig.log


def test_a_rig_with_its_own_preflight_is_asked_for_the_whole_plan() -> None:
    class Guarded(FakeRig):
        def preflight(self, poses: object) -> None:
            raise UnreachableError(f"keep-out: {len(list(poses))}")  # type: ignore[call-overload]  # A list comes.

    with pytest.raises(UnreachableError, match="keep-out: 3"):
        preflight(Guarded(), row(3))


def test_the_estimate_is_the_time_that_it_takes(tmp_path: Path) -> None:
    rig, sides = FakeRig(), [OneSided("y_mm", "above", 2.0)]
    poses = [RigPose(float(k % 3) * 50, 20.0 * (k % 2), 0.0, 10.0 * k, 0.5) for k in range(6)]
    moves = list(all_legs(poses, sides))
    expected = estimate(rig, len(poses), moves, 1e6, tmp_path / "not" / "there" / "yet")
    began = rig.clock.now_s()
    list(a_scan(rig, poses, quick_store(rig), sides=sides))
    # Nothing is exposed where an approach turns back.
    took = rig.clock.now_s() - began + rig.limits.exposure_s * (len(moves) - len(poses))
    assert expected.seconds == pytest.approx(took)
    assert expected.bytes_needed >= 6e6 * GROWTH
    assert expected.bytes_free > 0


def test_a_scan_that_does_not_fit_on_the_disk_is_refused(tmp_path: Path) -> None:
    rig = FakeRig()
    free = estimate(rig, 1, row(1), 1.0, tmp_path).bytes_free
    refuse_small_disk(estimate(rig, 1, row(1), 1e5, tmp_path), tmp_path)
    with pytest.raises(InputError, match=r"1 pictures need .* are free.*another disk"):
        refuse_small_disk(estimate(rig, 1, row(1), free - SPARE_BYTES / 2, tmp_path), tmp_path)


def test_only_one_picture_is_in_hand(tmp_path: Path) -> None:
    rig = FakeRig(FakeClock())
    with GridWriter(tmp_path / "grid", GridInfo()) as writer, BackgroundStore(writer) as store:
        store.put(rig.capture(), "a.png")
        with pytest.raises(RuntimeError):
            store.put(rig.capture(), "b.png")
