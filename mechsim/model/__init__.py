"""Mechanisms and motions as plain data: all that the two methods have in common."""
