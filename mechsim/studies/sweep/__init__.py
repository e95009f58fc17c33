"""Parameter sweeps: designs from parameters, measures over a turn, evaluation methods, chunks, one table."""
