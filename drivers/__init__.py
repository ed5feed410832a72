"""Drivers for real hardware, one module per device family."""
