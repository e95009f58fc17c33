"""Plots of motions, forces and comparisons, as matplotlib figures that need no screen.

A figure displays itself in a notebook; `write` saves it in the format of the extension, `drawn` returns the
bytes of a file. Axes have units; the colours suit colour-blind readers.
"""

from mechsim.pictures.plots.dynamics import dynamics_sheet, energy_plot, reaction_plot, torque_plot
from mechsim.pictures.plots.figure import blank, drawn, format_of, write
from mechsim.pictures.plots.motion import error_plot, motion_plot, transmission_plot
from mechsim.pictures.plots.paths import (
    AssemblyTable,
    assembly_plot,
    coupler_curve,
    schematic_plot,
    space_curve,
    velocity_plan_plot,
)
from mechsim.pictures.plots.vibration import bode_plot, history_plot, mode_plot, phase_plot, quantity_plot

__all__ = [
    "AssemblyTable",
    "assembly_plot",
    "blank",
    "bode_plot",
    "coupler_curve",
    "drawn",
    "dynamics_sheet",
    "energy_plot",
    "error_plot",
    "format_of",
    "history_plot",
    "mode_plot",
    "motion_plot",
    "phase_plot",
    "quantity_plot",
    "reaction_plot",
    "schematic_plot",
    "space_curve",
    "torque_plot",
    "transmission_plot",
    "velocity_plan_plot",
    "write",
]
