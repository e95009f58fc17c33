"""Formulas of mechanisms with a driven crank: the motion in closed form, for one design or many."""
