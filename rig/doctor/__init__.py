"""Checks a live bench without moving anything, and finds what is connected to write a first bench file of it."""

from rig.doctor.examining import examine
from rig.doctor.finding import Finding, Verdict, healthy
from rig.doctor.surroundings import DiskLook, Surroundings, this_computer

__all__ = ["DiskLook", "Finding", "Surroundings", "Verdict", "examine", "healthy", "this_computer"]
