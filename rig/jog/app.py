"""The screen of ``rig jog``: live picture, position within the limits, messages, keys. `Jogger` does what they say."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable
from typing import ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.geometry import Size
from textual.widgets import Static

from rig.jog import draw
from rig.jog.jogger import STEPS, Jogger
from rig.jog.leaving import INTERRUPTED
from rig.jog.looking import Looker
from rig.jog.picture import PictureView
from rig.jog.prompts import MarkList, Prompt

REFRESH_S = 0.1

_SIZES = [(unit, size) for unit, sizes in STEPS.items() for size in sizes]
_STEPS: tuple[tuple[str, str, int], ...] = (
    ("left", "x_mm", -1),
    ("right", "x_mm", 1),
    ("up", "y_mm", -1),
    ("down", "y_mm", 1),
    ("pageup", "z_mm", 1),
    ("pagedown", "z_mm", -1),
    ("comma", "theta_deg", -1),
    ("full_stop", "theta_deg", 1),
    ("minus", "zoom", -1),
    ("plus,equals_sign", "zoom", 1),
)


class JogApp(App[None]):
    """The screen.

    Args:
        jogger: does what the keys say.
        looker: looks at the pictures.
        bench: its name, for people.
        preview: where the preview page is; empty: there is none.
        leave: ends the screen once it is set.
    """

    ENABLE_COMMAND_PALETTE = False
    CSS_PATH = "app.tcss"
    BINDINGS: ClassVar[list[BindingType]] = [
        # These work on every screen, prompts included.
        Binding("space", "stop", priority=True),
        Binding("ctrl+c", "interrupt", priority=True),
        *(Binding(keys, f"step('{axis}', {way})") for keys, axis, way in _STEPS),
        *(Binding(str(n), f"choose_step('{unit}', {size})") for n, (unit, size) in enumerate(_SIZES, 1)),
        Binding("g,G", "go_to"),
        Binding("c,C", "capture"),
        Binding("m,M", "set_mark"),
        Binding("l,L", "marks"),
        Binding("h,H", "home"),
        Binding("f,F", "reference"),
        Binding("u,U", "unlock"),
        Binding("b,B", "reboot"),
        Binding("n,N", "connect"),
        Binding("r", "resume"),
        Binding("R", "release"),
        Binding("p,P", "preview"),
        Binding("q,Q", "quit"),
    ]

    def __init__(
        self, jogger: Jogger, looker: Looker, bench: str, preview: str = "", leave: threading.Event | None = None
    ) -> None:
        super().__init__()
        self.HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (100, "-wide")]
        self.VERTICAL_BREAKPOINTS = [(0, "-low"), (32, "-tall")]
        self._leave = leave or threading.Event()
        self._jogger, self._looker, self._bench, self._preview = jogger, looker, bench, preview
        self._parts = {part: Static(id=part) for part in ("top", "look", "axes", "troubles", "messages", "keys")}
        self._view, self._picture = PictureView(id="picture"), -1
        self._shown: dict[str, Text] = {}

    def compose(self) -> ComposeResult:
        """Put the parts on the screen."""
        yield self._parts["top"]
        with Horizontal(id="middle"):
            with Vertical(id="left"):
                yield self._view
                yield self._parts["look"]
            yield self._parts["axes"]
        yield from (self._parts[part] for part in ("troubles", "messages", "keys"))

    def on_mount(self) -> None:
        """Begin to follow the rig. A Ctrl-C that comes as a signal is one all the same."""
        if threading.current_thread() is threading.main_thread():
            asyncio.get_running_loop().add_signal_handler(signal.SIGINT, self.action_interrupt)
        if self._preview:
            self.action_preview()
        # Once it is known how large everything is.
        self.call_after_refresh(self.follow)
        self.set_interval(REFRESH_S, self.follow)

    def follow(self) -> None:
        """Show what is known now. Also behind a prompt."""
        if self._leave.is_set():
            self.exit(return_code=INTERRUPTED)
        jogger, status = self._jogger, self._jogger.glance()
        look, steps = self._looker.look, jogger.steps
        self._put("top", lambda size: draw.top(self._bench, status, jogger.running, jogger.waiting))
        self._put("axes", lambda size: draw.axes(status, jogger.limits, steps, *size))
        self._put("troubles", lambda size: draw.troubles(status, jogger.running))
        self._put("messages", lambda size: draw.messages(jogger.messages, *size))
        self._put("keys", lambda size: draw.keys(steps, bool(self._preview)))
        kept = f"pictures {jogger.pictures}  marks {len(jogger.marks)}"
        self._put("look", lambda size: draw.look(look, jogger.clock, kept, size.width))
        if look is not None and look.sequence != self._picture:
            self._picture = look.sequence
            self._view.show(look.small)

    def _put(self, part: str, drawn: Callable[[Size], Text]) -> None:
        widget = self._parts[part]
        text = drawn(widget.content_size)
        if text != self._shown.get(part):
            self._shown[part] = text
            widget.set_class(not text, "empty")
            widget.update(text)

    # Moving.

    def action_step(self, axis: str, way: int) -> None:
        """One step."""
        self._jogger.step(axis, way)

    def action_choose_step(self, unit: str, size: float) -> None:
        """Another step size."""
        self._jogger.choose_step(unit, size)

    def action_go_to(self) -> None:
        """Ask where to go."""
        self._ask("Go to", "x=120,theta=15 or x,y,z,theta,zoom; no blanks: Space is STOP", self._jogger.go_to)

    def action_home(self) -> None:
        """Ask whether the way is free, and home."""
        self._confirm("Home the gantry?", "See that the way to the switches is free.", self._jogger.home)

    # Pictures and marks.

    def action_capture(self) -> None:
        """Take a picture."""
        self._jogger.capture()

    def action_set_mark(self) -> None:
        """Ask for a name, and mark this place."""
        self._ask("Mark this place", "Its name; empty: the next number. No blanks", self._jogger.set_mark, empty=True)

    def action_marks(self) -> None:
        """List the marks; go to one, or remove it."""
        if not self._jogger.marks:
            self._jogger.say("refused", "there are no marks yet. M sets one")
            return

        def chosen(choice: tuple[str, str] | None) -> None:
            if choice is not None:
                what, name = choice
                (self._jogger.go_to_mark if what == "go" else self._jogger.remove_mark)(name)

        self.push_screen(MarkList(self._jogger.marks), chosen)

    def action_preview(self) -> None:
        """Tell where the preview page is."""
        told = f"preview: {self._preview}" if self._preview else "there is no preview page. `rig jog --preview` has one"
        self._jogger.say("note", told)

    # What a person decides.

    def action_reference(self) -> None:
        """Ask where the pan or the zoom stands."""
        self._ask("Where does it stand?", "theta=0 or zoom=0: the axis now stands there", self._jogger.reference)

    def action_unlock(self) -> None:
        """Leave an alarm."""
        self._confirm("Unlock?", "Look first what raised the alarm, or why the move failed.", self._jogger.unlock)

    def action_reboot(self) -> None:
        """Ask which servo, and reboot it."""
        hint = "pan or zoom, once it is cool. It has let go, and F must tell it where it stands"
        self._ask("Reboot which servo?", hint, self._jogger.reboot)

    def action_connect(self) -> None:
        """Connect again."""
        self._jogger.connect()

    def action_resume(self) -> None:
        """Allow motion after a hold."""
        self._jogger.resume()

    def action_release(self) -> None:
        """Ask whether it is safe, and release STOP."""
        self._confirm("Release STOP?", "Only once it is safe to move again.", self._jogger.release)

    # Stopping.

    def action_stop(self) -> None:
        """STOP."""
        self._jogger.stop()

    def action_interrupt(self) -> None:
        """Once: hold. Twice: STOP."""
        self._jogger.interrupt()

    def _ask(self, title: str, hint: str, then: Callable[[str], None], *, empty: bool = False) -> None:
        def answered(text: str | None) -> None:
            if text is not None and (text or empty):
                then(text)

        self.push_screen(Prompt(title, hint, typed=True), answered)

    def _confirm(self, title: str, hint: str, then: Callable[[], None]) -> None:
        def answered(text: str | None) -> None:
            if text is not None:
                then()

        self.push_screen(Prompt(title, hint), answered)
