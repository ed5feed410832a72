"""Threads of a jog session: one for commands, in which at most one waits, and one each for STOP and for hold."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Command:
    """Something to be done on the rig: what, for people, and how. ``run`` takes care of its own errors."""

    what: str
    run: Callable[[], bool]
    """True if it was done; where it was not, what waits behind it is dropped."""


class Worker:
    """Runs commands one after another in a thread of its own. While one runs one more may wait, and no third.

    Args:
        idle: called whenever nothing has been commanded for ``idle_s`` seconds, in the same thread.
        idle_s: real time.
    """

    def __init__(self, idle: Callable[[], None], idle_s: float) -> None:
        self._idle, self._idle_s = idle, idle_s
        self._changed = threading.Condition()
        self._running: Command | None = None
        self._waiting: Command | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._follow, name="jog commands", daemon=True)
        self._thread.start()

    @property
    def running(self) -> str:
        """What is being done; empty if nothing is."""
        command = self._running
        return "" if command is None else command.what

    @property
    def waiting(self) -> str:
        """What comes next; empty if nothing does."""
        command = self._waiting
        return "" if command is None else command.what

    def submit(self, command: Command) -> bool:
        """Have something done. False: one runs and one waits already, and this one was not taken."""
        with self._changed:
            if self._waiting is not None or self._closed:
                return False
            self._waiting = command
            self._changed.notify_all()
            return True

    def drop(self) -> None:
        """Forget what waits."""
        with self._changed:
            self._waiting = None
            self._changed.notify_all()

    def rest(self, seconds: float) -> bool:
        """Wait until nothing runs and nothing waits; False if that takes longer."""
        with self._changed:
            return self._changed.wait_for(lambda: self._running is None and self._waiting is None, seconds)

    def close(self, seconds: float) -> bool:
        """Take no more commands, and wait for what runs; False if that takes longer. Safe to call twice."""
        with self._changed:
            self._closed, self._waiting = True, None
            self._changed.notify_all()
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _follow(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._closed, self._idle_s)
                if self._closed:
                    return
                self._running, self._waiting = self._waiting, None
            command = self._running
            if command is None:
                self._idle()
                continue
            good = False
            try:
                good = command.run()
            finally:
                with self._changed:
                    self._running = None
                    # A step that was typed while another one was expected to succeed may now mean something else.
                    self._waiting = self._waiting if good else None
                    self._changed.notify_all()


class Trigger:
    """A thread that waits to do one thing: made before it is needed, and never behind anything else.

    Pulls that come while it is being done have it done once more.

    Args:
        name: of the thread.
        action: what to do.
        failed: is told what the action has raised; the thread goes on, for the next pull must find it.
    """

    def __init__(self, name: str, action: Callable[[], None], failed: Callable[[Exception], None]) -> None:
        self._action, self._failed = action, failed
        self._awake = threading.Event()
        self._wanted = self._closed = False
        self._thread = threading.Thread(target=self._follow, name=name, daemon=True)
        self._thread.start()

    def pull(self) -> None:
        """Have it done now; returns at once."""
        self._wanted = True
        self._awake.set()

    def close(self, seconds: float) -> None:
        """End the thread, once all that was asked for is done. Safe to call twice."""
        self._closed = True
        self._awake.set()
        self._thread.join(seconds)

    def _follow(self) -> None:
        while True:
            self._awake.wait()
            self._awake.clear()
            if self._wanted:
                self._wanted = False
                try:
                    self._action()
                except Exception as error:
                    self._failed(error)
            if self._closed and not self._wanted:
                return
