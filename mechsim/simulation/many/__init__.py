"""Batch stepping of many designs of one mechanism: one compiled model with the fields of each design."""
