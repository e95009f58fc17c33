"""Dynamics of any mechanism with one crank, from its closed form or its loop equations. No simulator."""

from mechsim.analytic.dynamics.flywheel import Fluctuation, fluctuation, flywheel_for
from mechsim.analytic.dynamics.free_running import FreeRun, free_run
from mechsim.analytic.dynamics.machines import Machine, machine
from mechsim.analytic.dynamics.prescribed_motion import Study, prescribed
from mechsim.analytic.dynamics.reactions import Balance, Reaction
from mechsim.analytic.dynamics.reduced_equation import Reduced, reduced

__all__ = [
    "Balance",
    "Fluctuation",
    "FreeRun",
    "Machine",
    "Reaction",
    "Reduced",
    "Study",
    "fluctuation",
    "flywheel_for",
    "free_run",
    "machine",
    "prescribed",
    "reduced",
]
