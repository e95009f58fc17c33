"""Dynamics of any mechanism with one crank, from its closed form or its loop equations. No simulator."""

from mechsim.analytic.dynamics.dynamic_model import Machine, machine
from mechsim.analytic.dynamics.flywheel import fluctuation, flywheel_for
from mechsim.analytic.dynamics.free_motion import free_run
from mechsim.analytic.dynamics.prescribed_motion import InverseDynamics, prescribed
from mechsim.analytic.dynamics.reactions import Balance
from mechsim.analytic.dynamics.reduced_equation import Reduced, reduced
from mechsim.model.efforts import Fluctuation, FreeRun, Reaction

__all__ = [
    "Balance",
    "Fluctuation",
    "FreeRun",
    "InverseDynamics",
    "Machine",
    "Reaction",
    "Reduced",
    "fluctuation",
    "flywheel_for",
    "free_run",
    "machine",
    "prescribed",
    "reduced",
]
