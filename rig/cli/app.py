"""The ``rig`` command: its groups, and the one place where errors become messages and exit codes.

Nothing here or in the command modules may import numpy, OpenCV or the like before a command runs: ``rig --help``
answers in under 0.3 s (benchmarks/bench_startup.py).
"""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from rig.cli import (
    aligning,
    benching,
    checking,
    emulating,
    evaluating,
    importing,
    jogging,
    model,
    recognising,
    runs,
    scanning,
    simulating,
    stopping,
)
from rig.errors import RigError

DONE, FAILED, BAD_INPUT, HARDWARE_FAULT, INTERRUPTED = 0, 1, 2, 3, 130


class RigGroup(TyperGroup):
    """Turns what a command raises into one message on stderr and the exit code of design §8."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command. With ``--debug`` errors keep their traceback."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            typer.echo("interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None
        except RigError as error:
            if ctx.params.get("debug"):
                raise
            typer.echo(f"rig: {error}", err=True)
            raise typer.Exit(error.exit_code) from error
        except Exception as error:
            # Typer's own (usage errors, exit, abort) and a closed pipe are Typer's to handle.
            own = hasattr(error, "exit_code") or isinstance(error, typer.Abort | BrokenPipeError)
            if own or ctx.params.get("debug"):
                raise
            kind = type(error).__name__
            typer.echo(
                f"rig: internal error: {kind}: {error}. This is a bug: run again with `rig --debug ...` and report "
                "the traceback with the command",
                err=True,
            )
            raise typer.Exit(FAILED) from error


app = typer.Typer(
    cls=RigGroup,
    name="rig",
    no_args_is_help=True,
    # Typer's rich help costs 0.1 s at every start.
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    epilog="\b\nExample:\n  rig demo",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(version("calibration-free-rig"))
        raise typer.Exit


@app.callback()
def rig(
    debug: Annotated[bool, typer.Option("--debug", envvar="RIG_DEBUG", help="Show tracebacks of errors.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Recognise a large object, and the place on it, from close-ups of an uncalibrated camera on a motorised rig.

    Exit codes: 0 done; 1 ran but did not succeed; 2 bad usage or input; 3 hardware fault; 130 interrupted.
    """


for _module in (
    recognising,
    benching,
    stopping,
    jogging,
    scanning,
    aligning,
    checking,
    emulating,
    simulating,
    evaluating,
    model,
    runs,
    importing,
):
    _module.register(app)


if __name__ == "__main__":
    sys.exit(app())
