"""Checks a live bench without moving anything, and finds what is connected to write a first bench file of it."""

from rig.doctor.discovery import discover, found_object
from rig.doctor.examining import examine
from rig.doctor.finding import Finding, Verdict, healthy
from rig.doctor.first_bench import first_bench
from rig.doctor.surroundings import DiskLook, Surroundings, this_computer

__all__ = [
    "DiskLook",
    "Finding",
    "Surroundings",
    "Verdict",
    "discover",
    "examine",
    "first_bench",
    "found_object",
    "healthy",
    "this_computer",
]
