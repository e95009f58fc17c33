"""How quantities of a motion depend on dimensions: exact derivatives, tolerances, clearances."""
