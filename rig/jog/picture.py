"""The live picture in the terminal: sixels, kitty's protocol or half blocks, whichever the terminal has.

textual-image asks the terminal what it can do when it is imported: that must be before textual takes the terminal over.
"""

from __future__ import annotations

from PIL import Image as PillowImage
from textual.app import ComposeResult
from textual.containers import Container
from textual.widgets import Static
from textual_image.renderable import Image as Best
from textual_image.renderable import UnicodeImage
from textual_image.widget import HalfcellImage
from textual_image.widget import Image as BestWidget

from rig.hal import Image


class PictureView(Container):
    """The newest picture, as large as there is room for it."""

    def __init__(self, id: str) -> None:
        super().__init__(id=id)
        # Where there is no terminal to ask (a screenshot), half blocks show more than letters.
        self._view = HalfcellImage() if Best is UnicodeImage else BestWidget()
        self._none = Static("no picture has come yet", id="no-picture")

    def compose(self) -> ComposeResult:
        """Put the parts on the screen."""
        yield self._view
        yield self._none

    def show(self, image: Image) -> None:
        """Show a picture, grey or BGR."""
        self._none.display = False
        rgb = image if image.ndim == 2 else image[:, :, ::-1].copy()
        self._view.image = PillowImage.fromarray(rgb)
