"""Stress test: the ranges of quantities within which runs pass (docs/explanation/extremes.md)."""
