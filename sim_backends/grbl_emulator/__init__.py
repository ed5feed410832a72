"""A GRBL-family controller with its machine, emulated at the wire: bytes in at a time, bytes out at a time."""
