"""Synthesis: linkages whose coupler point follows a line or curve as well as can be."""

from mechsim.synthesis.curve import Synthesis, follow_curve, line, synthesize_looper
from mechsim.synthesis.search import broken, straighter
from mechsim.synthesis.trials import Conditions

__all__ = [
    "Conditions",
    "Synthesis",
    "broken",
    "follow_curve",
    "line",
    "straighter",
    "synthesize_looper",
]
