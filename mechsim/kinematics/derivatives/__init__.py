"""Exact derivatives of motions and forces by the dimensions of a mechanism.

The motion depends on a vector of numbers (`numbers_of`). Each dimension changes some of them, by derivatives
of the description (`dimensions`). These are imaginary parts of a complex step with which the loop equations
are solved again. The imaginary parts of the solution are the derivatives, exact to rounding, without
differences of two motions (`motion`).
"""
