"""Spreads trials over processes of this computer, or over a Dask cluster; one thread of computing in each.

Records come back as they are done, in any order. When ``stop()`` says so no trial is begun any more, and those in hand
are finished.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from rig.errors import InputError, RigError
from rig.evaluate.plan import Task
from rig.evaluate.work import Record, record_of

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment in which numerical libraries keep to one thread; they read it when they are first imported."""
_IN_HAND = 2
"""Trials given to each process at a time, so that none waits for the next."""

Stop = Callable[[], bool]


def one_thread() -> None:
    """Keep OpenCV to one thread in this process."""
    import cv2

    cv2.setNumThreads(1)


def here(tasks: Sequence[Task], stop: Stop) -> Iterator[Record]:
    """Do the trials in this process, one after the other."""
    one_thread()
    for task in tasks:
        if stop():
            return
        yield record_of(task)


def in_processes(tasks: Sequence[Task], jobs: int, stop: Stop) -> Iterator[Record]:
    """Do the trials in ``jobs`` processes.

    Raises:
        RigError: a process died.
    """
    # Spawned: a forked process would have the threads' locks, but not the threads, of this one; and it reads the
    # environment anew before it imports numpy.
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=_begin)
    try:
        yield from _as_done(pool, tasks, jobs, stop)
    except BrokenProcessPool as failure:
        raise RigError(
            "a process that did trials died, perhaps for want of memory; what was done is kept. Go on with fewer --jobs"
        ) from failure
    except (KeyboardInterrupt, GeneratorExit):
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def on_cluster(tasks: Sequence[Task], address: str, stop: Stop) -> Iterator[Record]:
    """Do the trials on a Dask cluster, whose workers have this package and see the same files.

    Raises:
        InputError: Dask is not installed, or no scheduler answers at the address.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as failure:
        raise InputError(
            "Dask is not installed here",
            where="--scheduler",
            remedy="pip install 'calibration-free-rig[cluster]', or leave --scheduler out",
        ) from failure
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as failure:
        raise InputError(
            f"no Dask scheduler answers at {address!r} ({failure})",
            where="--scheduler",
            remedy="Give its address, as tcp://HOST:8786",
        ) from failure
    with client:
        futures = client.map(_one_threaded, tasks, pure=False)
        done = as_completed(futures)
        for future in done:
            yield future.result()
            if stop():
                client.cancel([future for future in futures if not future.done()])
                return


def _as_done(pool: ProcessPoolExecutor, tasks: Sequence[Task], jobs: int, stop: Stop) -> Iterator[Record]:
    waiting = iter(tasks)
    in_hand: set[Future[Record]] = set()
    while True:
        while len(in_hand) < _IN_HAND * jobs and not stop():
            task = next(waiting, None)
            if task is None:
                break
            in_hand.add(pool.submit(record_of, task))
        if not in_hand:
            return
        if stop():
            in_hand = {future for future in in_hand if not future.cancel()}
        # Woken now and then, to see whether to stop.
        done, in_hand = wait(in_hand, timeout=0.2, return_when=FIRST_COMPLETED)
        yield from (future.result() for future in done)


def _begin() -> None:
    """Prepare a process: Ctrl-C is for its parent, which has the trial in hand finished; compile before the first."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    from recognition.warming import warm_up

    one_thread()
    warm_up()


def _one_threaded(task: Task) -> Record:
    # Dask's nannies set the environment of `ONE_THREAD` themselves.
    one_thread()
    return record_of(task)
