"""Runs: what is kept of a recognition, and reading it back.

A run folder holds ``events.jsonl`` (append-only), ``views/``, ``objects.json`` (outlines of the model base, for the
report), ``result.json`` and ``report.html``; docs/formats.md describes them. Whoever watches a run (the table, the
report, a replay) watches the same generator of steps.
"""

from rig.run.recorder import RunRecorder, RunStart, Steps, watch
from rig.run.replay import RunRecord, read_run, replay
from rig.run.result import result_object

__all__ = ["RunRecord", "RunRecorder", "RunStart", "Steps", "read_run", "replay", "result_object", "watch"]
