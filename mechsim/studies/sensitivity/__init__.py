"""How quantities of a motion depend on dimensions: exact derivatives, tolerances, clearances."""

from mechsim.studies.sensitivity.moved_family import Loading, MovedFamily, instants_of
from mechsim.studies.sensitivity.sensitivity import Sensitivity, derivative_table
from mechsim.studies.sensitivity.tolerance_analysis import (
    PathDeviation,
    ToleranceStudy,
    path_bands,
    tolerance_study,
)
from mechsim.studies.sensitivity.tolerances import Tolerances, tolerances_of, written_tolerances

__all__ = [
    "Loading",
    "MovedFamily",
    "PathDeviation",
    "Sensitivity",
    "ToleranceStudy",
    "Tolerances",
    "derivative_table",
    "instants_of",
    "path_bands",
    "tolerance_study",
    "tolerances_of",
    "written_tolerances",
]
