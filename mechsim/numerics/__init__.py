"""Numerical methods on arrays, shared by the analytic equations and the simulation.

Nothing in this package knows a mechanism or MuJoCo.
"""
