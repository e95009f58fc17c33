"""Dynamics of any mechanism, from its closed form or its loop equations, without a simulator."""

from mechsim.analytic.dynamics.dynamic_run import DynamicRun, run
from mechsim.analytic.dynamics.linearization import Mode
from mechsim.analytic.dynamics.load_balance import LoadCurve, load_curve
from mechsim.analytic.dynamics.many_runs import run_many
from mechsim.analytic.dynamics.model import DynamicModel, dynamic_model
from mechsim.analytic.dynamics.prescribed_motion import InverseDynamics, prescribed
from mechsim.analytic.dynamics.reactions import Balance
from mechsim.analytic.dynamics.reduced_equation import Reduced, fluctuation, flywheel_for, reduced
from mechsim.analytic.dynamics.redundant_actuation import actuated, actuator_forces
from mechsim.analytic.dynamics.run_reactions import joint_reactions
from mechsim.analytic.dynamics.statics import (
    Equilibrium,
    equilibria,
    holding,
    holding_range,
    modes,
    nearest_equilibrium,
    response,
)
from mechsim.model.force_record import Fluctuation, Reaction

__all__ = [
    "Balance",
    "DynamicModel",
    "DynamicRun",
    "Equilibrium",
    "Fluctuation",
    "InverseDynamics",
    "LoadCurve",
    "Mode",
    "Reaction",
    "Reduced",
    "actuated",
    "actuator_forces",
    "dynamic_model",
    "equilibria",
    "fluctuation",
    "flywheel_for",
    "holding",
    "holding_range",
    "joint_reactions",
    "load_curve",
    "modes",
    "nearest_equilibrium",
    "prescribed",
    "reduced",
    "response",
    "run",
    "run_many",
]
