"""How far each axis can be pushed before something breaks, and what breaks: see docs/extremes.md."""

from mechsim.studies.extremes.stability_map import AXES, StabilityMap, study
from mechsim.studies.extremes.trial import Border, Trial

__all__ = ["AXES", "Border", "StabilityMap", "Trial", "study"]
