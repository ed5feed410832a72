"""Homing a live bench before something else is done on it."""

from __future__ import annotations

from typing import Annotated

import typer

HomeFirst = Annotated[bool, typer.Option("--home", help="Home a live bench first.")]


def home_first(rig: object) -> None:
    """Home; Ctrl-C holds the motion, twice is STOP.

    Raises:
        InputError: it is a mock bench.
        RigError: as `rig.guard.Guard.home`.
    """
    from rig.cli.interrupt import ends_gently
    from rig.errors import InputError
    from rig.guard import Guard

    if not isinstance(rig, Guard):
        raise InputError("a mock bench needs no homing", where="--home", remedy="Leave it out")
    with ends_gently(rig):
        rig.home()
