"""How far each axis can be pushed before something breaks, and what breaks: see docs/extremes.md."""

from mechsim.extremes.study import AXES, Study, study
from mechsim.extremes.trial import Border, Trial

__all__ = ["AXES", "Border", "Study", "Trial", "study"]
