"""Synthesis: linkages whose coupler point follows a line or curve as well as can be."""

from mechsim.theory.synthesis.coupler_line import Synthesis, follow_curve, line, synthesize_looper
from mechsim.theory.synthesis.search import broken, straighter
from mechsim.theory.synthesis.search_trials import Conditions

__all__ = [
    "Conditions",
    "Synthesis",
    "broken",
    "follow_curve",
    "line",
    "straighter",
    "synthesize_looper",
]
