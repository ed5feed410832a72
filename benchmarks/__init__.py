"""Commands that measure: each prints figures that docs/results.md quotes."""
