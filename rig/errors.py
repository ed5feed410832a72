"""The one tree of errors. Every error tells what was wrong, where, and what to do about it."""

from __future__ import annotations


class RigError(Exception):
    """Root of all errors that the project raises on purpose.

    ``exit_code`` is what the command line returns when the error reaches it.
    """

    exit_code = 1


class InputError(RigError):
    """A file, an argument or data from the user is wrong.

    Args:
        message: what is wrong and with which value.
        where: place in ``file:line:column`` form, or the name of the argument.
        remedy: what the user can do about it, as one short sentence.
    """

    exit_code = 2

    def __init__(self, message: str, *, where: str | None = None, remedy: str | None = None) -> None:
        self.message = message
        self.where = where
        self.remedy = remedy
        text = f"{where}: {message}" if where else message
        end = "" if text.endswith((".", "?", "!")) else "."
        super().__init__(f"{text}{end} {remedy}" if remedy else text)


class ImageGridError(InputError):
    """An image grid is incomplete, damaged or contradicts itself."""


class ModelBaseError(InputError):
    """A model base breaks one of its rules."""


class ImageError(InputError):
    """An image cannot be decoded, or is not an image that can be used."""


class DegenerateGeometryError(RigError):
    """Points, or a part, do not determine what was asked of them (too few, repeated, collinear)."""


class UnreachableError(RigError):
    """A pose was asked for that the rig cannot reach.  Tells axis, value and limit."""


class HardwareError(RigError):
    """A device failed or does not do what it was told.  Motion has been stopped before this is raised."""

    exit_code = 3
