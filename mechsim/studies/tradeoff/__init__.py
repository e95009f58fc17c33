"""Speed against accuracy, measured: the ladder of settings, the trials, and what they recommend."""

from mechsim.studies.tradeoff.ladder import DEFAULTS, STEPS, Family, families
from mechsim.studies.tradeoff.model_builds import Build
from mechsim.studies.tradeoff.rig import Rig
from mechsim.studies.tradeoff.subject import QUANTITIES, Subject, subject_of, subject_of_model
from mechsim.studies.tradeoff.work_precision import BOUNDS, Point, Tradeoff, measure, write_csv

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
