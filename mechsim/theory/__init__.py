"""What the papers say beyond motion: mobility, Assur groups, assembly curves, synthesis, velocity plans."""
