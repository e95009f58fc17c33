"""Stress test: how far quantities can change before a run fails (docs/explanation/extremes.md)."""
