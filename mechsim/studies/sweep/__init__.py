"""Many designs at once: designs from parameters, measures over a turn, the roads, chunks, one table."""
