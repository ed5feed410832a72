"""The prompts of the jog screen: one that asks for a text or a yes, and the list of marks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from rig.hal import RigPose
from rig.jog.places import shown


class _Typed(Input):
    """A line of text without blanks: Space is STOP here too."""

    def check_consume_key(self, key: str, character: str | None) -> bool:
        """Take all that can be typed but Space, which then goes to the screen's keys."""
        return key != "space" and super().check_consume_key(key, character)


class Prompt(ModalScreen[str | None]):
    """Asks for a text (``typed``), or for Enter or Esc; gives the text, empty for a plain yes, or ``None``."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave"), Binding("enter", "agree")]

    def __init__(self, title: str, hint: str, *, typed: bool = False) -> None:
        super().__init__()
        self._title, self._hint, self._typed = title, hint, typed

    def compose(self) -> ComposeResult:
        """Put the parts on the screen."""
        with Vertical(classes="prompt"):
            yield Static(self._title, classes="title", markup=False)
            yield Static(self._hint, markup=False)
            if self._typed:
                yield _Typed(compact=True)
            yield Static("Enter: yes    Esc: no    Space: STOP", classes="hint", markup=False)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Enter was pressed in the text."""
        self.dismiss(event.value.strip())

    def action_agree(self) -> None:
        """Enter was pressed where there is no text."""
        self.dismiss("")

    def action_leave(self) -> None:
        """Esc was pressed."""
        self.dismiss(None)


class MarkList(ModalScreen[tuple[str, str] | None]):
    """Lists marks; gives ``("go", name)``, ``("remove", name)`` or ``None``."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave"), Binding("delete,d", "remove")]

    def __init__(self, marks: Mapping[str, RigPose]) -> None:
        super().__init__()
        self._marks = dict(marks)

    def compose(self) -> ComposeResult:
        """Put the parts on the screen."""
        with Vertical(classes="prompt wide"):
            yield Static("Marks", classes="title", markup=False)
            widest = max(len(name) for name in self._marks)
            lines = (Option(f"{name:<{widest}}  {shown(pose)}") for name, pose in self._marks.items())
            yield OptionList(*lines, markup=False, compact=True)
            yield Static("Enter: go there    D: remove    Esc: back    Space: STOP", classes="hint", markup=False)

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Enter was pressed on a mark."""
        self.dismiss(("go", list(self._marks)[event.option_index]))

    def action_remove(self) -> None:
        """D was pressed on a mark."""
        index = self.query_one(OptionList).highlighted
        if index is not None:
            self.dismiss(("remove", list(self._marks)[index]))

    def action_leave(self) -> None:
        """Esc was pressed."""
        self.dismiss(None)
