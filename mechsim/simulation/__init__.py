"""Running models in MuJoCo: time stepping under a driven crank, and pose solving without time."""

from mechsim.simulation.profile import TURN, Profile, constant, swing, table
from mechsim.simulation.run import Run, simulate
from mechsim.simulation.settings import Settings
from mechsim.simulation.step import check_step

__all__ = ["TURN", "Profile", "Run", "Settings", "check_step", "constant", "simulate", "swing", "table"]
