"""Poses without time: the loops are solved at each crank angle, by continuation in one assembly."""
