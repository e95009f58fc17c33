"""How far each axis can be changed before something breaks: see docs/explanation/extremes.md."""

from mechsim.studies.extremes.stability_map import AXES, StabilityMap, study
from mechsim.studies.extremes.trial import Border, Trial

__all__ = ["AXES", "Border", "StabilityMap", "Trial", "study"]
