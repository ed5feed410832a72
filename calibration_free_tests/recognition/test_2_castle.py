"""The castle."""
