"""What a person commands by hand passes the guard, and STOP waits for none of it."""

from __future__ import annotations

import threading
from dataclasses import astuple
from pathlib import Path

import pytest

from calibration_free_tests.guard.sample import RULES
from calibration_free_tests.jog.bench import PLACE, eventually, session
from rig.devices import StopReport
from rig.errors import ImageGridError, InputError
from rig.guard import State
from rig.hal import Image, RigPose
from rig.imagegrid import read_grid
from rig.jog.keeping import HandGrid
from rig.jog.marks import Marks, marks_file
from rig.jog.places import typed_pose, typed_reference
from rig.jog.worker import Command, Worker


def test_a_step_moves_one_axis_by_the_chosen_size(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.jogger.choose_step("mm", 10.0)
        for axis, way in (("x_mm", 1), ("y_mm", -1), ("z_mm", -1), ("theta_deg", 1), ("zoom", -1)):
            s.jogger.step(axis, way)
            s.rest()
        assert astuple(s.pose) == pytest.approx((-90.0, 10.0, 50.0, 16.0, 0.3))
        assert s.told == []


def test_a_step_over_a_limit_is_refused_in_words_and_nothing_moves(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.jogger.go_to("x=190")
        s.rest()
        s.made.motions.clear()
        s.jogger.choose_step("mm", 50.0)
        s.jogger.step("x_mm", 1)
        s.rest()
        (kind, text) = s.told[-1]
        assert kind == "refused"
        assert "x +50 mm: x_mm = 240 is outside -200 .. 200" in text
        assert (s.made.motions, s.state) == ([], State.IDLE)


def test_a_step_into_a_keep_out_box_is_refused(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.jogger.go_to("x=-60,y=0,z=150")
        s.jogger.choose_step("mm", 50.0)
        s.rest()
        s.jogger.step("x_mm", 1)
        s.rest()
        assert "model" in s.told[-1][1]
        assert s.pose.x_mm == pytest.approx(-60.0)


def test_while_a_step_runs_one_more_may_wait_and_a_third_is_not_taken(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.gate.open = False
        s.jogger.step("x_mm", 1)
        s.under_way()
        for _ in range(20):
            s.jogger.step("x_mm", 1)
        assert (s.jogger.running, s.jogger.waiting) == ("x +1 mm", "x +1 mm")
        (message,) = s.jogger.messages
        assert (message.kind, message.times) == ("refused", 19)
        s.gate.open = True
        s.rest()
        assert s.pose.x_mm == pytest.approx(PLACE.x_mm + 2.0)


@pytest.mark.parametrize("good", [True, False])
def test_what_waits_is_done_only_if_what_runs_before_it_was(good: bool) -> None:
    begun, on = threading.Event(), threading.Event()
    done: list[str] = []

    def first() -> bool:
        begun.set()
        return on.wait(5.0) and good

    worker = Worker(lambda: None, 1.0)
    worker.submit(Command("first", first))
    assert begun.wait(5.0)
    worker.submit(Command("second", lambda: bool(done.append("second") or True)))
    on.set()
    assert worker.rest(5.0)
    worker.close(5.0)
    assert done == (["second"] if good else [])


def test_stop_ends_a_move_under_way_and_latches(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.gate.open = False
        s.jogger.go_to("x=100")
        s.under_way()
        s.jogger.step("x_mm", 1)
        s.jogger.stop()
        assert s.heard("STOP: everything is at rest")
        s.rest()
        s.gate.open = True
        assert s.state is State.STOPPED
        assert s.jogger.waiting == ""
        moved = len(s.made.motions)
        s.jogger.step("x_mm", 1)
        s.rest()
        assert "Release it by hand" in s.told[-1][1]
        assert len(s.made.motions) == moved
        s.jogger.release()
        s.rest()
        s.jogger.step("x_mm", 1)
        s.rest()
        assert s.state is State.IDLE
        assert len(s.made.motions) == moved + 1


def test_stop_does_not_wait_for_a_command_that_hangs(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        hangs = threading.Event()
        drawn = s.made.camera.scene

        def late(sequence: int) -> Image:
            hangs.wait(5.0)
            return drawn(sequence)

        s.made.camera.scene = late
        s.jogger.capture()
        assert eventually(lambda: s.state is State.CAPTURING)
        stops = s.made.gantry.stops
        s.jogger.stop()
        assert eventually(lambda: s.made.gantry.stops > stops)
        assert s.state is State.STOPPED
        assert s.jogger.running == "a capture"
        hangs.set()
        s.rest()


def test_a_stop_that_is_not_confirmed_says_so(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.made.gantry.stop_is_lost = True
        s.jogger.stop()
        assert s.heard("NOT CONFIRMED: use the wired emergency stop")
        assert s.told[-1][0] == "fault"


def test_ctrl_c_holds_and_ctrl_c_again_stops(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.gate.open = False
        s.jogger.go_to("x=100")
        s.under_way()
        s.jogger.interrupt()
        assert s.heard("motion is held")
        s.rest()
        s.gate.open = True
        assert s.state is State.HELD
        s.jogger.interrupt()
        assert eventually(lambda: s.state is State.STOPPED)


def test_after_a_hold_and_a_resume_ctrl_c_holds_again(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.jogger.interrupt()
        assert eventually(lambda: s.state is State.HELD)
        s.jogger.step("x_mm", 1)
        s.rest()
        assert "Resume it first" in s.told[-1][1]
        s.jogger.resume()
        s.rest()
        assert s.state is State.IDLE
        s.jogger.interrupt()
        assert eventually(lambda: s.state is State.HELD)


def test_leaving_holds_what_moves(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.gate.open = False
        s.jogger.go_to("x=100")
        s.under_way()
        s.jogger.close()
        s.gate.open = True
        assert s.state is State.HELD
        assert s.made.gantry.status().position_mm == pytest.approx((350.0, 220.0, 60.0))


def test_a_stop_asked_for_just_before_leaving_is_still_done(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.jogger.stop()
        s.jogger.close()
        assert s.state is State.STOPPED


def test_a_fault_is_shown_and_the_way_back_is_by_hand(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.gate.open = False
        s.jogger.go_to("x=100")
        s.under_way()
        s.made.gantry.unplug()
        s.rest()
        s.gate.open = True
        assert s.told[-1][0] == "fault"
        assert "the link is gone" in s.told[-1][1]
        assert s.state is State.DISCONNECTED
        s.made.gantry.replug()
        for act in (s.jogger.connect, s.jogger.home, lambda: s.jogger.go_to("100,20,60,15")):
            act()
            s.rest()
        assert s.pose.x_mm == pytest.approx(100.0)


def test_a_stop_that_fails_is_told_and_the_next_one_is_carried_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with session(tmp_path) as s:
        stop, failures = s.made.guard.stop, iter([OSError("anything")])

        def first_fails(by: str = "") -> StopReport:
            for failure in failures:
                raise failure
            return stop(by)

        monkeypatch.setattr(s.made.guard, "stop", first_fails)
        s.jogger.stop()
        assert s.heard("internal error: OSError: anything")
        assert s.told[-1][0] == "fault"
        s.jogger.stop()
        assert s.heard("STOP: everything is at rest")
        assert s.state is State.STOPPED


def test_a_camera_that_was_lost_is_connected_again_without_homing_anew(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.made.camera.unplug()
        s.jogger.capture()
        s.rest()
        assert s.told[-1][0] == "fault"
        assert "then connect again" in s.told[-1][1]
        s.made.camera.replug()
        for act in (s.jogger.connect, s.jogger.capture):
            act()
            s.rest()
        assert [kind for kind, _ in s.told[-2:]] == ["done", "done"]
        assert s.jogger.pictures == 1
        assert s.pose == PLACE


def test_before_homing_a_step_is_refused_and_homing_helps(tmp_path: Path) -> None:
    with session(tmp_path, homed=False) as s:
        assert s.state is State.UNHOMED
        s.jogger.step("x_mm", 1)
        s.rest()
        assert "Home it first" in s.told[-1][1]
        s.made.pan.lose_power()
        s.jogger.reference("theta=5")
        s.rest()
        s.jogger.home()
        s.rest()
        assert s.state is State.IDLE
        assert s.pose.theta_deg == pytest.approx(5.0)


def test_an_alarm_that_keeps_the_place_can_be_unlocked(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.made.gantry.raise_alarm(2)
        assert eventually(lambda: s.state is State.ALARM)
        s.jogger.unlock()
        s.rest()
        assert (s.state, s.told[-1]) == (State.IDLE, ("done", "unlocked: idle"))


def test_a_servo_with_a_hardware_error_can_be_rebooted_and_referenced(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        s.made.pan.overheat()
        assert eventually(lambda: s.state is State.ALARM)
        s.jogger.reboot("x")
        s.rest()
        assert s.told[-1] == ("refused", "rebooting: x is no servo. Type pan or zoom")
        s.jogger.reboot("pan")
        s.rest()
        assert (s.state, s.told[-1]) == (State.UNHOMED, ("done", "pan is rebooted: unhomed"))
        s.jogger.reference("theta=15")
        s.rest()
        assert s.state is State.IDLE


def test_an_error_that_nobody_foresaw_is_shown_and_the_session_goes_on(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        good = s.made.camera.scene

        def broken(sequence: int) -> object:
            raise ZeroDivisionError("bad\x1b[2Jdriver")

        s.made.camera.scene = broken  # type: ignore[assignment]  # what a faulty driver does
        s.jogger.capture()
        s.rest()
        assert s.told[-1][0] == "fault"
        assert "internal error: ZeroDivisionError: bad�[2Jdriver" in s.told[-1][1]
        s.made.camera.scene = good
        s.jogger.unlock()
        s.rest()
        s.jogger.step("x_mm", 1)
        s.rest()
        assert s.pose.x_mm == pytest.approx(PLACE.x_mm + 1.0)


def test_pictures_taken_by_hand_are_an_image_grid_with_their_poses(tmp_path: Path) -> None:
    with session(tmp_path, rules=RULES) as s:
        for _ in range(3):
            s.jogger.capture()
            s.rest()
            s.jogger.step("x_mm", 1)
            s.rest()
        assert s.jogger.pictures == 3
    grid = read_grid(tmp_path / "grid")
    assert [frame.file for frame in grid.frames] == [f"images/0000{n}.png" for n in (1, 2, 3)]
    assert [frame.pose.x_mm for frame in grid.frames] == pytest.approx([-100.0, -99.0, -98.0])
    assert "by hand on the bench bench.yaml" in grid.info.provenance


def test_a_second_picture_from_one_pose_is_refused_in_words(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        for _ in range(2):
            s.jogger.capture()
            s.rest()
        assert s.told[-1][0] == "refused"
        assert "same pose as images/00001.png" in s.told[-1][1]


def test_a_later_session_adds_to_the_same_grid(tmp_path: Path) -> None:
    for n in range(2):
        with session(tmp_path) as s:
            s.jogger.go_to(f"z={50 + n}")
            s.rest()
            s.jogger.capture()
            s.rest()
    assert len(read_grid(tmp_path / "grid").frames) == 2


def test_a_grid_with_other_internals_is_refused(tmp_path: Path) -> None:
    with HandGrid(tmp_path, "a", fixed_by_zoom=True) as grid:
        grid.open()
    text = (tmp_path / "grid.yaml").read_text().replace("fixed_by_zoom", "change_every_view")
    (tmp_path / "grid.yaml").write_text(text)
    with HandGrid(tmp_path, "a", fixed_by_zoom=True) as grid, pytest.raises((InputError, ImageGridError)):
        grid.open()


def test_marks_are_kept_and_gone_back_to(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        for name in ("door", ""):
            s.jogger.set_mark(name)
            s.rest()
        assert list(s.jogger.marks) == ["door", "1"]
        s.jogger.go_to("x=0,zoom=1")
        s.rest()
        s.jogger.remove_mark("1")
        s.rest()
    with session(tmp_path) as s:
        assert s.jogger.marks == {"door": PLACE}
        s.jogger.go_to("x=0,zoom=1")
        s.rest()
        s.jogger.go_to_mark("door")
        s.rest()
        assert astuple(s.pose) == pytest.approx(astuple(PLACE))


def test_before_homing_no_mark_can_be_set(tmp_path: Path) -> None:
    with session(tmp_path, homed=False) as s:
        s.jogger.set_mark("here")
        s.rest()
        assert s.told[-1][0] == "refused"
        assert not s.jogger.marks


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"schema": 2, "marks": {}}', '{"schema": 1, "marks": {"a": {"x_mm": 1}}}',
     '{"schema": 1, "marks": {"a": {"x_mm": NaN, "y_mm": 0, "z_mm": 0, "theta_deg": 0, "zoom": 0}}}'],
)  # fmt: skip
def test_a_damaged_file_of_marks_is_refused_with_its_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "marks.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"marks\.json: this is no file of marks"):
        Marks(path)


@pytest.mark.parametrize("name", ["", " a", "a\x1b", "a" * 21])
def test_a_name_that_cannot_be_listed_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="cannot name a mark"):
        Marks(tmp_path / "marks.json").set(name, PLACE)


def test_marks_belong_to_the_bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert marks_file("0123") == tmp_path / "rig" / "marks" / "0123.json"


def test_a_typed_pose_changes_what_it_names() -> None:
    assert typed_pose("x=1, pan=-2", PLACE) == RigPose(1.0, 20.0, 60.0, -2.0, 0.4)
    assert typed_pose("1,2,3,4", PLACE) == RigPose(1.0, 2.0, 3.0, 4.0, 0.4)
    assert typed_pose("1,2,3,4,0.5", PLACE) == RigPose(1.0, 2.0, 3.0, 4.0, 0.5)
    assert typed_reference("theta=7") == ("theta_deg", 7.0)


@pytest.mark.parametrize("text", ["", "x", "x=", "x=nan", "q=1", "1,2", "1,2,3,4,5,6", "x=1,2", "1,2,3,inf"])
def test_what_is_no_pose_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        typed_pose(text, PLACE)
