"""Placeholder until the paper's detector lands."""
