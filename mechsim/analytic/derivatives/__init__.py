"""Exact derivatives of motions and efforts by the dimensions of a mechanism.

All that a mechanism's motion depends on is a row of numbers (`numbers`). Each dimension changes some of them,
by derivatives of its description (`dimensions`); with these as tiny imaginary parts the loop equations are
closed once more, and what becomes imaginary is the derivative, to rounding: no difference of two motions is
taken (`motion`).
"""
