"""Numbers about numbers: worst and rms, orders of convergence, a root; all that both roads share."""
