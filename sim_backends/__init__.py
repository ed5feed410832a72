"""Rigs without hardware: image grids, rendered scenes and wire-level emulators."""
