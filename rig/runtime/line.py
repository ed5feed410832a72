"""The line to a process that holds a bench: a Unix socket that takes STOP, release and status from other processes."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from rig.devices import StopReport
from rig.errors import HardwareError, InputError, RigError
from rig.guard import GuardStatus, State
from rig.runtime.telling import status_object, stop_object

ANSWER_S = 15.0
"""A STOP may wait for a slow device to be at rest; its first byte went out long before."""
_TIMES, _AGAIN_S = 10, 0.1
_ASK_S = 2.0
_MOST_BYTES = 4096


class MuteError(HardwareError):
    """The process that holds a bench does not answer.

    Attributes:
        why: what became of asking.
    """

    def __init__(self, holder: str, why: object) -> None:
        self.why = why
        remedy = "Use the wired emergency stop, then end that process"
        super().__init__(f"{holder} holds the bench and does not answer ({why}). {remedy}")


class Attended(Protocol):
    """What the line reaches: the guard."""

    def stop(self, by: str) -> StopReport:
        """See `rig.guard.Guard`."""
        ...

    def release(self) -> State:
        """See `rig.guard.Guard`."""
        ...

    def glance(self) -> GuardStatus:
        """See `rig.guard.Guard`."""
        ...


@contextlib.contextmanager
def listening(
    paths: Sequence[Path],
    bench: str,
    guard: Attended,
    command: str = "",
    make_room: Callable[[], object] | None = None,
) -> Iterator[None]:
    """Answer on a socket while inside, in threads of its own. For who holds the bench (`rig.runtime.holding`).

    Args:
        paths: of the socket, and of links to it.
        bench: for people.
        guard: what is asked for.
        command: what this process does, for people.
        make_room: called when another process asks for the bench; ``None``: it is kept.

    Raises:
        InputError: the socket cannot be made.
    """
    path, *links = paths
    for one in paths:
        # Of a process that was killed: nobody else holds the bench now.
        one.unlink(missing_ok=True)
    with contextlib.ExitStack() as made:
        try:
            server = made.enter_context(_Server(str(path), bench, guard, command, make_room))
            made.callback(path.unlink, missing_ok=True)
            for link in links:
                link.symlink_to(path.name)
                made.callback(link.unlink, missing_ok=True)
        except OSError as failure:
            raise InputError(
                f"the socket for STOP cannot be made ({failure.strerror or failure})",
                where=str(path),
                remedy="Set RIG_RUNTIME_DIR to a folder of your own, with a short path",
            ) from failure
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), name="STOP line", daemon=True)
        thread.start()
        made.callback(thread.join)
        made.callback(server.shutdown)
        yield


def ask(path: Path, what: str, **details: str) -> dict[str, Any] | None:
    """Ask whoever holds the bench; ``None`` if nobody does.

    Raises:
        MuteError: somebody does, and does not answer in time.
        RigError: what was asked was refused, and why.
    """
    asked = json.dumps({"what": what, **details}).encode() + b"\n"
    for _ in range(_TIMES):
        try:
            answer = _exchange(path, asked)
            break
        except (ConnectionError, BlockingIOError) as failure:
            # It is just ending, or was killed: soon nobody is there, and who asks for a STOP must send it himself.
            hung_up = failure
            time.sleep(_AGAIN_S)
        except (OSError, ValueError) as failure:
            raise MuteError(f"{path}: somebody", failure) from failure
    else:
        raise MuteError(f"{path}: somebody", hung_up)
    if answer is not None and "refused" in answer:
        raise RigError(str(answer["refused"]))
    return answer


def _exchange(path: Path, asked: bytes) -> dict[str, Any] | None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(_ASK_S)
        try:
            line.connect(str(path))
        except (BlockingIOError, TimeoutError):
            # Somebody listens there, and has not taken up those who called before.
            raise
        except OSError:
            return None
        line.settimeout(ANSWER_S)
        line.sendall(asked)
        return dict(json.loads(_whole_line(line)))


class _Server(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    # A STOP ends the command that it stops, and often the process: who asked for it is answered first.
    daemon_threads, block_on_close = False, True

    def __init__(
        self, path: str, bench: str, guard: Attended, command: str, make_room: Callable[[], object] | None
    ) -> None:
        self.bench, self.guard, self.command, self.make_room = bench, guard, command, make_room
        super().__init__(path, _Answering)


class _Answering(socketserver.StreamRequestHandler):
    timeout = _ASK_S
    server: _Server

    def handle(self) -> None:
        try:
            asked = json.loads(self.rfile.readline(_MOST_BYTES))
        except (OSError, ValueError):
            return
        if not isinstance(asked, dict):
            return
        try:
            answer = self._answer(asked)
        except RigError as error:
            answer = {"refused": str(error)}
        # Who asked may have gone meanwhile; what was asked is done.
        with contextlib.suppress(OSError):
            self.wfile.write(json.dumps(answer).encode() + b"\n")

    def _answer(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        guard, bench = self.server.guard, self.server.bench
        answers: dict[str, Callable[[], dict[str, Any]]] = {
            "stop": lambda: {
                "running": guard.glance().running,
                **stop_object(guard.stop(str(asked.get("by", "by another process")))),
            },
            "release": lambda: {"state": guard.release().value},
            "status": lambda: status_object(guard.glance()),
        }
        if (make_room := self.server.make_room) is not None:
            answers["make room"] = lambda: _room_made(make_room)
        what = asked.get("what")
        if what not in answers:
            return {"refused": f"{what!r} is not understood here"}
        return {"bench": bench, "pid": os.getpid(), "command": self.server.command, **answers[str(what)]()}


def _whole_line(line: socket.socket) -> bytes:
    found = b""
    while not found.endswith(b"\n"):
        more = line.recv(_MOST_BYTES)
        if not more:
            raise ConnectionError("it hung up")
        found += more
    return found


def _room_made(make_room: Callable[[], object]) -> dict[str, Any]:
    make_room()
    return {"makes_room": True}
