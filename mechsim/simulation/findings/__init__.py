"""What is wrong with a scene before it runs, each thing with its size, its line in the file and a remedy."""

from mechsim.simulation.findings.table import findings

__all__ = ["findings"]
