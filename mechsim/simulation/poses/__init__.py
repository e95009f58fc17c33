"""Poses without time: the loops solved at each crank angle, walked along the assembly."""
