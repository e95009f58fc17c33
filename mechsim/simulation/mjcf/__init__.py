"""Generates MuJoCo models of mechanisms from dimensions only, compiles them, and writes exact text."""

from mechsim.simulation.mjcf.compiling import compiled, quiet, to_xml
from mechsim.simulation.mjcf.generator import generate

__all__ = ["compiled", "generate", "quiet", "to_xml"]
