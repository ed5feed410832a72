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
def listening(paths: Sequence[Path], bench: str, guard: Attended) -> Iterator[None]:
    """Answer on a socket while inside, in threads of its own.

    Args:
        paths: of the socket, and of links to it.
        bench: for people.
        guard: what is asked for.

    Raises:
        HardwareError: another process answers at one of the paths.
        InputError: the socket cannot be made.
    """
    path, *links = paths
    for one in paths:
        _clear_stale(one)
    with contextlib.ExitStack() as made:
        try:
            server = made.enter_context(_Server(str(path), bench, guard))
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
        HardwareError: somebody does, and does not answer in time.
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
            raise _mute(path, failure) from failure
    else:
        raise _mute(path, hung_up)
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


def _mute(path: Path, failure: Exception) -> HardwareError:
    return HardwareError(
        f"{path}: the process that holds the bench does not answer ({failure}). Use the wired emergency stop, "
        "then end that process"
    )


class _Server(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    # A STOP ends the command that it stops, and often the process: who asked for it is answered first.
    daemon_threads, block_on_close = False, True

    def __init__(self, path: str, bench: str, guard: Attended) -> None:
        self.bench, self.guard = bench, guard
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
            "stop": lambda: stop_object(guard.stop(str(asked.get("by", "by another process")))),
            "release": lambda: {"state": guard.release().value},
            "status": lambda: status_object(guard.glance()),
        }
        what = asked.get("what")
        if what not in answers:
            return {"refused": f"{what!r} is not understood here"}
        return {"bench": bench, "pid": os.getpid(), **answers[str(what)]()}


def _whole_line(line: socket.socket) -> bytes:
    found = b""
    while not found.endswith(b"\n"):
        more = line.recv(_MOST_BYTES)
        if not more:
            raise ConnectionError("it hung up")
        found += more
    return found


def _clear_stale(path: Path) -> None:
    """Take away the socket of a process that was killed."""
    holder = ask(path, "status")
    if holder is not None:
        raise HardwareError(
            f"{holder['bench']}: process {holder['pid']} holds this bench. Wait until it is done, or stop it"
        )
    path.unlink(missing_ok=True)
