"""The thread that drains a camera: no signal disturbs its polls, and it ends when it should."""

from __future__ import annotations

import signal
import threading

from drivers.draining import InlineDrain, ThreadDrain
from sim_backends.simulated_clock import SimulatedClock


def test_no_signal_reaches_the_draining_thread() -> None:
    blocked: list[set[int]] = []
    done = threading.Event()

    def step() -> bool:
        blocked.append({int(number) for number in signal.pthread_sigmask(signal.SIG_BLOCK, [])})
        return False

    drain = ThreadDrain(SimulatedClock())
    drain.start(step, done.set)
    assert done.wait(10.0)
    drain.stop()
    assert {signal.SIGINT, signal.SIGTERM, signal.SIGALRM} <= blocked[0]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_draining_by_whoever_waits_finishes_once() -> None:
    steps, finishes = iter([True, True, False]), []
    drain = InlineDrain()
    drain.idle()
    drain.start(lambda: next(steps), lambda: finishes.append(1))
    for _ in range(6):
        drain.idle()
    drain.stop()
    assert finishes == [1]
