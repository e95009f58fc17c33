"""Shapes of links, from their joints alone: rods, eyes, pins, balls, rails, bearings, gears.

All sizes are proportional to the characteristic length, so that mechanisms of any size look alike. Shapes are
visual only, without mass or contact.
"""
