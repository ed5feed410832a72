"""The screen does what its keys say, shows what is so, and STOP is a key that always works."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path

import pytest
from textual.pilot import Pilot
from textual.widgets import Static

from calibration_free_tests.jog.bench import PLACE, Session, eventually, newest, session
from rig.guard import State
from rig.hal import AxisLimits
from rig.imagegrid import read_grid
from rig.jog import draw
from rig.jog.app import JogApp
from rig.jog.jogger import Message
from rig.jog.looking import Looker
from rig.jog.prompts import MarkList, Prompt

# textual-image 0.12 asks Pillow for pixels in a way that Pillow 14 will not have; the extra `jog` keeps below that.
pytestmark = pytest.mark.filterwarnings("ignore:Image.Image.getdata is deprecated:DeprecationWarning")

PROMPTS = ("g", "h", "l", "b")
"""Keys of a prompt that is typed into, of one that asks yes or no, and of the list."""
Script = Callable[[Session, JogApp, Pilot[None]], Awaitable[None]]


def play(folder: Path, script: Script, size: tuple[int, int] = (80, 24), homed: bool = True, preview: str = "") -> None:
    """Run a script at the keyboard of a session."""

    async def run(s: Session) -> None:
        looker = Looker(lambda: newest(s.made))
        looker.refresh()
        app = JogApp(s.jogger, looker, "bench.yaml", preview)
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            app.follow()
            await script(s, app, pilot)

    # The pilot waits until the process is idle.
    with session(folder, homed=homed, idle_s=0.5) as s:
        asyncio.run(run(s))


async def typed(s: Session, app: JogApp, pilot: Pilot[None], *keys: str) -> None:
    """Press keys, let what they command be done, and the screen follow."""
    await pilot.press(*keys)
    s.rest()
    app.follow()
    await pilot.pause()


def text_of(app: JogApp, part: str) -> str:
    return str(app.screen_stack[0].query_one(f"#{part}", Static).render())


def picture_of(app: JogApp) -> str:
    """All that is on the screen, as text."""
    return app.export_screenshot().replace("&#160;", " ")


def test_each_axis_has_keys_for_both_ways(tmp_path: Path) -> None:
    keys = {
        "left": ("x_mm", -1), "right": ("x_mm", 1), "up": ("y_mm", -1), "down": ("y_mm", 1),
        "pagedown": ("z_mm", -1), "pageup": ("z_mm", 1), "comma": ("theta_deg", -1), "full_stop": ("theta_deg", 1),
        "minus": ("zoom", -0.1), "plus": ("zoom", 0.1),
    }  # fmt: skip

    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        for key, (axis, change) in keys.items():
            before = getattr(s.pose, axis)
            await typed(s, app, pilot, key)
            assert getattr(s.pose, axis) == pytest.approx(before + change), key

    play(tmp_path, script)


def test_number_keys_choose_the_step(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        sizes = []
        for key in "123456789":
            await pilot.press(key)
            sizes.append(s.jogger.steps["mm" if key < "5" else "°" if key < "8" else ""])
        assert sizes == [0.1, 1.0, 10.0, 50.0, 0.1, 1.0, 10.0, 0.01, 0.1]
        await typed(s, app, pilot, "3", "right")
        assert s.pose.x_mm == pytest.approx(PLACE.x_mm + 10.0)
        assert "±10" in text_of(app, "axes")

    play(tmp_path, script)


def test_the_screen_shows_place_state_limits_sharpness_and_light(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await typed(s, app, pilot, "right")
        axes = text_of(app, "axes")
        assert "-99.000 mm" in axes
        assert "-200" in axes
        assert " 200" in axes
        assert "IDLE" in text_of(app, "top")
        assert "sharp" in text_of(app, "look")
        assert "good" in text_of(app, "look")

    play(tmp_path, script)


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
def test_all_keys_and_places_fit_on_the_screen(tmp_path: Path, size: tuple[int, int]) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await pilot.pause(0.15)
        seen = picture_of(app)
        for words in ("SPACE: STOP", "connect", "P", "preview", "15.000", "zoom", "marks", "IDLE", "/#token"):
            assert words in seen, words

    play(tmp_path, script, size, preview="http://127.0.0.1:1/#token")


def test_a_refusal_is_a_line_on_the_screen(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await typed(s, app, pilot, "4", "left", "left", "left")
        await typed(s, app, pilot, "left", "left")
        assert "x_mm = -250 is outside -200 .. 200" in " ".join(text_of(app, "messages").split())
        assert s.pose.x_mm == pytest.approx(-200.0)

    play(tmp_path, script)


def test_space_stops_while_a_move_is_under_way(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        s.gate.open = False
        await pilot.press("right")
        s.under_way()
        app.follow()
        assert "x +1 mm" in text_of(app, "top")
        await pilot.press("space")
        assert eventually(lambda: s.state is State.STOPPED)
        s.rest()
        s.gate.open = True
        app.follow()
        assert "STOPPED" in text_of(app, "top")
        assert "STOP: rig jog" in text_of(app, "troubles")
        await typed(s, app, pilot, "R", "enter")
        assert s.state is State.IDLE

    play(tmp_path, script)


@pytest.mark.parametrize("key", PROMPTS)
def test_space_stops_below_every_prompt(tmp_path: Path, key: str) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await typed(s, app, pilot, "m", "1", "enter")
        await pilot.press(key)
        assert isinstance(app.screen, Prompt | MarkList)
        await pilot.press("space")
        assert eventually(lambda: s.state is State.STOPPED)

    play(tmp_path, script)


@pytest.mark.parametrize("key", PROMPTS)
def test_esc_leaves_every_prompt_and_nothing_is_done(tmp_path: Path, key: str) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await typed(s, app, pilot, "m", "1", "enter")
        told = s.told
        await typed(s, app, pilot, key, "escape")
        assert len(app.screen_stack) == 1
        assert (s.told, s.made.motions, s.state) == (told, [], State.IDLE)

    play(tmp_path, script)


def test_ctrl_c_once_holds_and_twice_stops(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await pilot.press("ctrl+c")
        assert eventually(lambda: s.state is State.HELD)
        await typed(s, app, pilot, "r")
        assert s.state is State.IDLE
        await pilot.press("ctrl+c", "ctrl+c")
        assert eventually(lambda: s.state is State.STOPPED)
        assert app.is_running

    play(tmp_path, script)


def test_a_ctrl_c_from_elsewhere_holds_too(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        await pilot.pause()
        assert eventually(lambda: s.state is State.HELD)
        assert app.is_running

    play(tmp_path, script)


def test_go_to_asks_for_a_pose(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await typed(s, app, pilot, "g", *"x=-20,z=70", "enter")
        assert (s.pose.x_mm, s.pose.z_mm) == pytest.approx((-20.0, 70.0))
        await typed(s, app, pilot, "g", *"no", "enter")
        assert "'no' is not a pose" in text_of(app, "messages")

    play(tmp_path, script)


def test_homing_is_asked_for_and_done(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        assert "UNHOMED" in text_of(app, "top")
        assert "not known" in text_of(app, "axes")
        await typed(s, app, pilot, "h", "enter")
        assert s.state is State.IDLE

    play(tmp_path, script, homed=False)


def test_b_asks_which_servo_and_reboots_it(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        assert "B reboot" in text_of(app, "keys")
        s.made.zoom.overheat()
        assert eventually(lambda: s.state is State.ALARM)
        await typed(s, app, pilot, "b", *"zoom", "enter")
        assert s.state is State.UNHOMED
        await typed(s, app, pilot, "f", *"zoom=0.4", "enter")
        assert s.state is State.IDLE

    play(tmp_path, script)


def test_c_keeps_a_picture_in_the_grid(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await typed(s, app, pilot, "c")
        await typed(s, app, pilot, "right", "c")
        assert "pictures 2" in text_of(app, "look")

    play(tmp_path, script)
    assert [frame.pose.x_mm for frame in read_grid(tmp_path / "grid").frames] == pytest.approx([-100.0, -99.0])


def test_marks_are_set_listed_gone_to_and_removed(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await typed(s, app, pilot, "l")
        assert "no marks yet" in text_of(app, "messages")
        await typed(s, app, pilot, "m", *"a", "enter")
        await typed(s, app, pilot, "4", "right")
        await typed(s, app, pilot, "m", "enter")
        assert list(s.jogger.marks) == ["a", "1"]
        await typed(s, app, pilot, "l", "enter")
        assert s.pose.x_mm == pytest.approx(PLACE.x_mm)
        await typed(s, app, pilot, "l", "down", "d")
        assert list(s.jogger.marks) == ["a"]

    play(tmp_path, script)


def test_a_fault_is_shown_and_the_screen_stays(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        s.gate.open = False
        await pilot.press("right")
        s.under_way()
        s.made.gantry.unplug()
        s.rest()
        s.gate.open = True
        await pilot.pause(0.15)
        assert "DISCONNECTED" in text_of(app, "top")
        assert "the link is gone" in text_of(app, "messages")
        assert app.is_running

    play(tmp_path, script)


def test_what_a_device_says_cannot_draw_on_the_screen(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        s.jogger.say("fault", "[red]no [/] markup\x1b]0;title\x07")
        app.follow()
        assert "[red]no [/] markup�]0;title�" in text_of(app, "messages")

    play(tmp_path, script)


def test_q_leaves(tmp_path: Path) -> None:
    async def script(s: Session, app: JogApp, pilot: Pilot[None]) -> None:
        await pilot.press("q")
        await pilot.pause()
        assert not app.is_running

    play(tmp_path, script)


def test_the_place_in_the_bar_is_its_share_of_the_travel() -> None:
    limit = AxisLimits(0.0, 100.0, 1.0)
    for value, cell in ((0.0, 0), (50.0, 10), (100.0, 20)):
        text = draw.bar(limit, value, 1.0, 6 + 21 + 6).plain
        assert text.index("●") - 6 == cell
    assert "●" not in draw.bar(limit, None, 1.0, 40).plain


def test_the_newest_messages_are_those_shown_whole() -> None:
    told = [Message("done", f"number {n}") for n in range(9)] + [Message("refused", "word " * 10, times=3)]
    text = draw.messages(told, 40, 4).plain.split("\n")
    assert len(text) == 4
    assert text[1] == "✓ number 8"
    assert text[3].endswith("(×3)")


def test_a_stale_status_is_shown_as_such(tmp_path: Path) -> None:
    with session(tmp_path) as s:
        status = replace(s.jogger.glance(), stale=True, age_s=7.0)
        assert "7.0 s old" in draw.troubles(status, "").plain
        assert draw.troubles(status, "x +1 mm").plain == ""
