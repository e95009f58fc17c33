"""Plots of motions, forces and comparisons, as matplotlib figures that need no screen.

A figure displays itself in a notebook; `write` saves it in the format of the extension, `drawn` returns the
bytes of a file. Axes have units; the colours suit colour-blind readers.
"""

from mechsim.pictures.plots.dynamics import dynamics_sheet
from mechsim.pictures.plots.figure import blank, drawn, format_of, webp, write
from mechsim.pictures.plots.motion import error_plot, motion_plot, transmission_plot
from mechsim.pictures.plots.paths import coupler_curve, schematic_plot
from mechsim.pictures.plots.vibration import bode_plot, history_plot, mode_plot, quantity_plot

__all__ = [
    "blank",
    "bode_plot",
    "coupler_curve",
    "drawn",
    "dynamics_sheet",
    "error_plot",
    "format_of",
    "history_plot",
    "mode_plot",
    "motion_plot",
    "quantity_plot",
    "schematic_plot",
    "transmission_plot",
    "webp",
    "write",
]
