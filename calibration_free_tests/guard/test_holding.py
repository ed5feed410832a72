"""One process at a time holds a bench, all of it, and the others are told which and what it does there."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from calibration_free_tests.guard.sample import bench
from drivers.combined import in_threads
from rig.clock import SystemClock
from rig.errors import HardwareError
from rig.guard import Guard
from rig.runtime import Attendance, BenchHeldError

SOON_S = 5.0


def attendance(folder: Path, *names: str, **others: Any) -> Attendance:
    """A process's, that knows the bench by one name or several."""
    key, *also = names or ("key",)
    return Attendance(folder, key, "bench.yaml", also=also, **others)


def guard() -> Guard:
    return bench(clock=SystemClock(), stops=in_threads).guard


def test_of_commands_that_start_together_exactly_one_gets_the_bench(tmp_path: Path) -> None:
    together, inside, most, refused = threading.Barrier(4), [], [], []

    def command(number: int) -> None:
        names = [("key", "place"), ("other", "place")][number % 2]
        for _ in range(10):
            together.wait(SOON_S)
            try:
                with attendance(tmp_path, *names).listen(guard()):
                    inside.append(number)
                    most.append(len(inside))
                    together.wait(SOON_S)
                    inside.remove(number)
            except BenchHeldError as error:
                refused.append(error.holder.pid)
                together.wait(SOON_S)
            together.wait(SOON_S)

    threads = [threading.Thread(target=command, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] * 10
    assert refused == [os.getpid()] * 30
    assert not list(tmp_path.iterdir())


def test_who_is_refused_is_told_the_process_and_the_command_that_hold_the_bench(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["/usr/bin/rig", "move", "my bench.yaml", "--x-mm", "5"])
    with attendance(tmp_path).listen(guard()):
        told = rf"process {os.getpid()} \(`rig move 'my bench.yaml' --x-mm 5`\) holds this bench"
        with pytest.raises(BenchHeldError, match=told) as refused, attendance(tmp_path).listen(guard()):
            pass
        assert str(refused.value).endswith("Wait until it is done, or stop it (`rig stop bench.yaml`)")
        assert (attendance(tmp_path).ask("status") or {})["command"].startswith("rig move")


def test_a_bench_is_held_until_its_last_device_is_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = bench(clock=SystemClock(), stops=in_threads, company=(attendance(tmp_path).listen,))
    holders = []
    close = made.camera.close

    def closing() -> None:
        holders.append(attendance(tmp_path).holder())
        close()

    with made.guard:
        monkeypatch.setattr(made.camera, "close", closing)
    assert [holder is not None and holder.pid == os.getpid() for holder in holders] == [True]
    assert attendance(tmp_path).holder() is None


def test_looking_who_holds_a_bench_takes_it_from_nobody_and_leaves_no_file(tmp_path: Path) -> None:
    assert attendance(tmp_path).holder() is None
    assert not list(tmp_path.iterdir())
    with attendance(tmp_path, "key", "place").listen(guard()):
        for names in (("key",), ("place",), ("other", "place")):
            holder = attendance(tmp_path, *names).holder()
            assert holder is not None
            assert holder.pid == os.getpid()


def test_who_cannot_write_his_name_holds_the_bench_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.pwrite", full)
    refused = pytest.raises(BenchHeldError, match="another process holds this bench")
    with attendance(tmp_path).listen(guard()), refused, attendance(tmp_path).listen(guard()):
        pass


def test_a_lock_that_cannot_be_made_is_told_with_its_path(tmp_path: Path) -> None:
    (tmp_path / "key.held").mkdir()
    with (
        pytest.raises(HardwareError, match=r"key.held cannot be locked .*Remove it"),
        attendance(tmp_path).listen(guard()),
    ):
        pass


# Who only looks.


@contextmanager
def looking(folder: Path) -> Iterator[threading.Event]:
    """A process that only looks at the bench, until it is asked to make room; yields what says that it was."""
    asked, ready = threading.Event(), threading.Event()

    def look() -> None:
        with attendance(folder, make_room=asked.set).listen(guard()):
            ready.set()
            asked.wait(SOON_S)

    thread = threading.Thread(target=look)
    thread.start()
    ready.wait(SOON_S)
    yield asked
    asked.set()
    thread.join()


def test_who_only_looks_makes_room_for_who_moves_something(tmp_path: Path) -> None:
    with looking(tmp_path) as asked, attendance(tmp_path).listen(guard()):
        assert asked.is_set()


def test_who_only_looks_keeps_the_bench_from_another_who_only_looks(tmp_path: Path) -> None:
    with looking(tmp_path) as asked:
        with ExitStack() as stack, pytest.raises(BenchHeldError):
            stack.enter_context(attendance(tmp_path, make_room=lambda: None).listen(guard()))
        assert not asked.is_set()


def test_who_moves_something_is_not_asked_to_make_room(tmp_path: Path) -> None:
    with attendance(tmp_path).listen(guard()):
        with pytest.raises(BenchHeldError), attendance(tmp_path).listen(guard()):
            pass
        with pytest.raises(Exception, match="'make room' is not understood"):
            attendance(tmp_path).ask("make room")


def test_who_looks_and_does_not_go_is_named_after_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.runtime.holding.YIELD_S", 0.1)
    refused = pytest.raises(BenchHeldError, match=f"process {os.getpid()}")
    with attendance(tmp_path, make_room=lambda: None).listen(guard()), refused, attendance(tmp_path).listen(guard()):
        pass
