"""Road A: a machine solved by formulas and loop equations; no simulator."""
