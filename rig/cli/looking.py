"""Looks at a live bench and is in nobody's way: asks the process that holds it, or else the devices themselves.

Who moves something gets the bench from who only looks, and is asked how it is from then on.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rig.cli.showing import status_of

if TYPE_CHECKING:
    from rig.bench import BenchConfig

Show = Callable[[dict[str, Any]], None]

WATCH_S = 0.5
BEGIN_S = 10.0
"""How long to wait for what a command that is just connecting, or closing, knows of the bench."""
FREE_S = 2.0
"""A bench that another process has just used is left to the next one for so long."""
_LOOK_S = 0.05


def look_once(config: BenchConfig, show: Show) -> None:
    """Show how a bench is.

    Raises:
        HardwareError: a device cannot be connected, or the process that holds the bench does not answer (names it).
        InputError: it is a mock bench.
    """
    from rig.bench import attendance_of, open_live
    from rig.runtime import BenchHeldError

    attendance = attendance_of(config)
    until_s = time.monotonic() + BEGIN_S
    while True:
        late = time.monotonic() > until_s
        told = attendance.ask("status")
        if told is not None:
            if late or not _is_connecting(told):
                show(told)
                return
        else:
            try:
                # It makes room by ending.
                with open_live(config, make_room=lambda: None) as guard:
                    show(status_of(guard))
                    return
            except BenchHeldError:
                if late:
                    raise
        time.sleep(_LOOK_S)


def watch(config: BenchConfig, show: Show, ended: Callable[[], bool]) -> None:
    """Show how a bench is, again and again, until it is ``ended``.

    Raises:
        HardwareError, InputError: as `look_once`.
    """
    from rig.bench import attendance_of
    from rig.runtime import BenchHeldError

    attendance = attendance_of(config)
    ours_from_s = 0.0
    while not ended():
        told = attendance.ask("status")
        if told is not None:
            show(told)
            ours_from_s = time.monotonic() + FREE_S
            _wait(WATCH_S, ended)
        elif time.monotonic() < ours_from_s:
            _wait(_LOOK_S, ended)
        else:
            with suppress(BenchHeldError):
                _watch_devices(config, show, ended)
            ours_from_s = time.monotonic() + FREE_S


def _watch_devices(config: BenchConfig, show: Show, ended: Callable[[], bool]) -> None:
    """Until somebody else asks for the bench."""
    from rig.bench import open_live

    wanted = threading.Event()

    def over() -> bool:
        return wanted.is_set() or ended()

    with open_live(config, make_room=wanted.set) as guard:
        while not over():
            show(status_of(guard))
            _wait(WATCH_S, over)


def _is_connecting(told: dict[str, Any]) -> bool:
    return told["state"] == "disconnected" and bool(told["running"])


def _wait(seconds: float, ended: Callable[[], bool]) -> None:
    until_s = time.monotonic() + seconds
    while not ended() and time.monotonic() < until_s:
        time.sleep(_LOOK_S)
