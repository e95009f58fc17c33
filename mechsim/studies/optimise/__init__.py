"""Dimensions that minimise a goal, by scipy's optimisers with exact derivatives."""

from mechsim.numerics.jets import size_of
from mechsim.studies.optimise.goals import Goal, Limit, MeasureLimit, Quantities, largest, smallest
from mechsim.studies.optimise.search import Optimum, optimise

__all__ = [
    "Goal",
    "Limit",
    "MeasureLimit",
    "Optimum",
    "Quantities",
    "largest",
    "optimise",
    "size_of",
    "smallest",
]
