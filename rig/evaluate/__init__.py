"""Evaluation: many recognitions by a plan, scored against the truth, and what they say together.

A plan (YAML, docs/formats.md) names model bases, policies and conditions; each combination is a row of results, and
each trial of a row has a number from which everything in it is drawn. A folder keeps one line a trial, so that an
evaluation that was cut off goes on where it was.
"""
