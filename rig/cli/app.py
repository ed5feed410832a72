"""The ``rig`` command: its groups, and the one place where errors become messages and exit codes.

Nothing here or in the command modules may import numpy, OpenCV or the like before a command runs: ``rig --help``
answers in under 0.3 s (benchmarks/bench_startup.py).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
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
from rig.cli.showing import counting_objects, print_json
from rig.errors import RigError

_AS_JSON = "rig.as_json"
_REPORT_IT = "run again with `rig --debug ...` and report the traceback with the command"
DONE, FAILED, BAD_INPUT, HARDWARE_FAULT, INTERRUPTED = 0, 1, 2, 3, 130


class RigGroup(TyperGroup):
    """Turns what a command raises into one message on stderr and the exit code of design §8.

    With ``--json`` the message is also one JSON object on stdout, unless the command has printed its own already.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Note whether an object is asked for: a usage error comes before the command's own options are known."""
        ctx.meta[_AS_JSON] = "--json" in args
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run a command. With ``--debug`` errors keep their traceback."""
        with counting_objects() as printed:

            def tell(message: str, exit_code: int) -> None:
                if ctx.meta[_AS_JSON] and not printed():
                    print_json({"error": message, "exit_code": exit_code})

            try:
                return super().invoke(ctx)
            except KeyboardInterrupt:
                typer.echo("interrupted", err=True)
                tell("interrupted", INTERRUPTED)
                raise typer.Exit(INTERRUPTED) from None
            except RigError as error:
                if ctx.params.get("debug"):
                    raise
                typer.echo(f"rig: {error}", err=True)
                tell(str(error), error.exit_code)
                raise typer.Exit(error.exit_code) from error
            except Exception as error:
                _pass_on_typers_own(error, tell)
                if ctx.params.get("debug"):
                    raise
                message = f"internal error: {type(error).__name__}: {error}. This is a bug"
                typer.echo(f"rig: {message}: {_REPORT_IT}", err=True)
                tell(message, FAILED)
                raise typer.Exit(FAILED) from error


def _pass_on_typers_own(error: Exception, tell: Callable[[str, int], None]) -> None:
    """Raise what is Typer's to handle: usage errors, exit, abort, and a closed pipe."""
    if hasattr(error, "exit_code") or isinstance(error, typer.Abort | BrokenPipeError):
        # Of these only errors have a message.
        words = getattr(error, "format_message", None)
        if words is not None:
            tell(words(), int(getattr(error, "exit_code", BAD_INPUT)))
        raise error


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
