"""Validation, trade-off and extremes: many runs and their judgements."""
