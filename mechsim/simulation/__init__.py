"""Runs of models in MuJoCo: time stepping under a driven crank, and pose solving without time."""

import mechsim.simulation.mujoco_loading  # before all else that imports it  # noqa: F401 # pyright: ignore[reportUnusedImport]
from mechsim.model.motion_laws import CrankProfile, constant, swing, table
from mechsim.numerics.angles import REVOLUTION
from mechsim.simulation.run import Run, simulate
from mechsim.simulation.settings import Settings

__all__ = [
    "REVOLUTION",
    "CrankProfile",
    "Run",
    "Settings",
    "constant",
    "simulate",
    "swing",
    "table",
]
