"""Stops several devices, and makes one report of theirs."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

from rig.devices import StopReport

Stops = Mapping[str, Callable[[], StopReport]]

STOP_S = 14.0
"""Longer than any driver takes to give its STOP up, and shorter than `rig stop` waits for an answer."""


def in_threads(stops: Stops) -> dict[str, StopReport]:
    """Stop all devices at the same time: none waits until another is at rest, or for one that never is."""
    reports: dict[str, StopReport] = {}

    def run(name: str, stop: Callable[[], StopReport]) -> None:
        reports[name] = stop()

    threads = []
    for name, stop in stops.items():
        thread = threading.Thread(target=run, args=(name, stop), name=f"stop {name}", daemon=True)
        try:
            thread.start()
        except RuntimeError:
            # No thread can be had: then one after another, rather than not at all.
            run(name, stop)
        else:
            threads.append(thread)
    deadline_s = time.monotonic() + STOP_S
    for thread in threads:
        thread.join(max(0.0, deadline_s - time.monotonic()))
    late = f"its STOP did not return within {STOP_S:g} s"
    return {name: reports.get(name) or StopReport(None, False, False, late) for name in stops}


def one_after_another(stops: Stops) -> dict[str, StopReport]:
    """Stop the devices in order, for simulated time, which only one thread may drive."""
    return {name: stop() for name, stop in stops.items()}


def summed(reports: Mapping[str, StopReport]) -> StopReport:
    """One report for several devices: confirmed only if all are at rest."""
    sent = [report.sent_at_s for report in reports.values() if report.sent_at_s is not None]
    troubles = [f"{name}: {report.trouble}" for name, report in reports.items() if report.trouble]
    return StopReport(
        min(sent, default=None),
        confirmed=all(report.confirmed for report in reports.values()),
        position_kept=all(report.position_kept for report in reports.values()),
        trouble="; ".join(troubles),
    )
