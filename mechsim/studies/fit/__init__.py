"""Dimensions from measured motion, with their uncertainty."""

from mechsim.studies.fit.calibration import Fit, fit_dimensions
from mechsim.studies.measured_table import MeasuredMotion, measured_of, single

__all__ = ["Fit", "MeasuredMotion", "fit_dimensions", "measured_of", "single"]
