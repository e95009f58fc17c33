"""Dynamics of any mechanism with one crank, from its closed form or its loop equations. No simulator."""

from mechsim.dynamics.fluctuation import Fluctuation, fluctuation, flywheel_for
from mechsim.dynamics.free import FreeRun, free_run
from mechsim.dynamics.machine import Machine, machine
from mechsim.dynamics.prescribed import Study, prescribed
from mechsim.dynamics.reactions import Balance, Reaction
from mechsim.dynamics.reduced import Reduced, reduced

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
