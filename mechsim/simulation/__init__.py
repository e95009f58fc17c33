"""Running models in MuJoCo: time stepping under a driven crank, and pose solving without time."""

from mechsim.simulation.profile import Profile, constant, table
from mechsim.simulation.run import Run, simulate
from mechsim.simulation.settings import Settings

__all__ = ["Profile", "Run", "Settings", "constant", "simulate", "table"]
