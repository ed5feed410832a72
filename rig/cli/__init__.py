"""The command line, a module a group of commands."""

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``rig``; raises SystemExit with the exit code of design §8."""
    from rig.cli.app import app

    app(args=None if arguments is None else list(arguments), prog_name="rig")
    sys.exit(0)
