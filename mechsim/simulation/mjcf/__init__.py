"""MuJoCo models of mechanisms, generated from dimensions alone; compiled, and written as exact text."""

from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf.exact_text import to_xml
from mechsim.simulation.mjcf.generator import generate
from mechsim.simulation.mjcf.silence import quiet

__all__ = ["compiled", "generate", "quiet", "to_xml"]
