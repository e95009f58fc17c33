"""Everything drawn: plots of records, pictures and videos of mechanisms."""
