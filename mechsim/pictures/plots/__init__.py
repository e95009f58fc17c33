"""Plots of motions and comparisons, drawn off screen and returned as the bytes of a file.

Every function returns SVG, PNG or PDF bytes; `write` puts them in a file by its extension. Axes
carry units, colours stay apart for colour-blind eyes.
"""

from mechsim.pictures.plots.figure import COLOURS, FORMATS, Format, canvas, decades, form_of, write
from mechsim.pictures.plots.motion import error_plot, motion_plot, transmission_plot
from mechsim.pictures.plots.paths import DrawablePlan, coupler_curve, space_curve, velocity_plan_plot

__all__ = [
    "COLOURS",
    "FORMATS",
    "DrawablePlan",
    "Format",
    "canvas",
    "coupler_curve",
    "decades",
    "error_plot",
    "form_of",
    "motion_plot",
    "space_curve",
    "transmission_plot",
    "velocity_plan_plot",
    "write",
]
