"""Dynamics of any mechanism, from its closed form or its loop equations, without a simulator."""

from mechsim.kinetics.dynamic_run import DynamicRun, run
from mechsim.kinetics.linearization import Mode
from mechsim.kinetics.load_balance import LoadCurve, load_curve
from mechsim.kinetics.many_runs import run_many
from mechsim.kinetics.model import DynamicModel, dynamic_model
from mechsim.kinetics.prescribed_motion import InverseDynamics, prescribed
from mechsim.kinetics.reactions import Balance
from mechsim.kinetics.reduced_equation import Reduced, fluctuation, flywheel_for, reduced
from mechsim.kinetics.redundant_actuation import actuated, actuator_forces
from mechsim.kinetics.run_reactions import joint_reactions
from mechsim.kinetics.statics import (
    Equilibrium,
    equilibria,
    holding,
    holding_range,
    modes,
    nearest_equilibrium,
    response,
)
from mechsim.mechanism.force_record import Fluctuation, Reaction

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
