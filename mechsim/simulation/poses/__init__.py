"""Poses without time: the loops solved at each crank angle, by continuation in one assembly."""
