"""Speed against accuracy, measured: the ladder of settings, the trials, and what they recommend."""

from mechsim.tradeoff.builds import Build
from mechsim.tradeoff.ladder import DEFAULTS, STEPS, Family, families
from mechsim.tradeoff.rig import Rig
from mechsim.tradeoff.study import BOUNDS, Point, Tradeoff, measure, write_csv
from mechsim.tradeoff.trials import QUANTITIES, Subject, subject_of, subject_of_model

__all__ = [
    "BOUNDS",
    "DEFAULTS",
    "QUANTITIES",
    "STEPS",
    "Build",
    "Family",
    "Point",
    "Rig",
    "Subject",
    "Tradeoff",
    "families",
    "measure",
    "subject_of",
    "subject_of_model",
    "write_csv",
]
