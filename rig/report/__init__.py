"""``report.html``: one self-contained page about a run, made from its folder alone."""

from rig.report.page import write_report

__all__ = ["write_report"]
