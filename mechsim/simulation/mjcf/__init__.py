"""MuJoCo models of mechanisms, generated from dimensions alone; compiled, and written as exact text."""

from mechsim.simulation.mjcf.compiling import compiled, quiet, to_xml
from mechsim.simulation.mjcf.generator import generate

__all__ = ["compiled", "generate", "quiet", "to_xml"]
