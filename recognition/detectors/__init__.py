"""Detectors of parts, found through the entry-point group ``rig.detectors``."""
