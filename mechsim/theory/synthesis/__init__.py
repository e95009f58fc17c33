"""Synthesis: linkages whose coupler point follows a line or curve as well as can be."""

from mechsim.theory.synthesis.coupler_line import Synthesis, follow_curve, line, synthesize_looper

__all__ = ["Synthesis", "follow_curve", "line", "synthesize_looper"]
