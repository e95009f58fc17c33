"""Comparison of two records: errors, tolerances and their reasons; knows neither method."""
