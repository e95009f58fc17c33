"""Dimensions that make a goal smallest, by scipy's optimisers with exact derivatives."""

from mechsim.maths.complex_step import size_of
from mechsim.studies.optimise.goals import Goal, Limit, Quantities, goal_of, largest, limit_of, smallest
from mechsim.studies.optimise.search import Optimum, optimise

__all__ = [
    "Goal",
    "Limit",
    "Optimum",
    "Quantities",
    "goal_of",
    "largest",
    "limit_of",
    "optimise",
    "size_of",
    "smallest",
]
