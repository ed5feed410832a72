"""Looks for the packages of the extra ``peers`` before any work begins."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from rig.errors import InputError

PACKAGES = ("pycolmap", "poselib")


def missing(packages: tuple[str, ...] = PACKAGES) -> tuple[str, ...]:
    """Those that are not installed."""
    return tuple(name for name in packages if find_spec(name) is None)


def require(packages: tuple[str, ...] = PACKAGES) -> None:
    """Raise ``InputError``, with the remedy, if any is not installed."""
    absent = missing(packages)
    if absent:
        raise InputError(
            f"{' and '.join(absent)} not installed",
            where="benchmarks.peers",
            remedy="Install the extra: pip install -e '.[peers]'",
        )


def command(work: Callable[[], None]) -> None:
    """Do the work; what is wrong with the input is one line on the standard error, and exit code 2."""
    try:
        work()
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)


def quiet() -> None:
    """Let COLMAP tell errors alone: steps of a solver that had to be repeated are none."""
    import pycolmap

    pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR.value


def versions() -> str:
    """What ran, in one line."""
    found = []
    for name in ("pycolmap", "poselib", "opencv-python-headless", "numpy", "numba"):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} absent")
    return ", ".join(found)
