"""Studies: validation, trade-off, extremes and others that evaluate many runs."""
