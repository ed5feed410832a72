"""Inner loops compiled by numba: irregular work over hypotheses, parts and detections that arrays express badly.

Each is a pure function on arrays, called by the module whose subject it is; nothing else knows of it. Compiled code is
kept beside the source, so only the first use after an installation waits for it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: _Function) -> _Function:
    """Compile on first use, and keep the result where a folder for it can be written."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        compiled: _Function = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found nowhere to keep it: then it is compiled anew in each process
        compiled = njit(**options)(function)
    return compiled
