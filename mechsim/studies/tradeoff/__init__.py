"""Speed against accuracy, measured: the ladder of settings, the trials, and what they recommend."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
from mechsim.studies.budget import Budget
from mechsim.studies.tradeoff.methods import (
    DEFAULTS,
    STEPS,
    Build,
    BuiltModel,
    SteppingMethod,
    build_model,
    stepping_methods,
)
from mechsim.studies.tradeoff.subject import COMPARED, Subject, subject_of, subject_of_model
from mechsim.studies.tradeoff.trials import measure_tradeoff
from mechsim.studies.tradeoff.work_precision import BOUNDS, Point, Tradeoff, write_csv

__all__ = [
    "BOUNDS",
    "COMPARED",
    "DEFAULTS",
    "STEPS",
    "Budget",
    "Build",
    "BuiltModel",
    "Point",
    "SteppingMethod",
    "Subject",
    "Tradeoff",
    "build_model",
    "measure_tradeoff",
    "stepping_methods",
    "subject_of",
    "subject_of_model",
    "write_csv",
]
