"""Theory of the papers: mobility, Assur groups, assembly curves, synthesis."""
