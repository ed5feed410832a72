"""Tests of how the next view is chosen."""
