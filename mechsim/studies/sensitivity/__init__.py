"""How quantities of a motion depend on dimensions: exact derivatives, tolerances, clearances."""

from mechsim.studies.sensitivity.moved_family import Loading, MovedFamily, spread_instants
from mechsim.studies.sensitivity.sensitivity import Sensitivity, derivative_table
from mechsim.studies.sensitivity.tolerance_analysis import (
    PathDeviation,
    ToleranceStudy,
    path_bands,
    tolerance_study,
)
from mechsim.studies.sensitivity.tolerances import Tolerances, parsed_tolerances, written_tolerances

__all__ = [
    "Loading",
    "MovedFamily",
    "PathDeviation",
    "Sensitivity",
    "ToleranceStudy",
    "Tolerances",
    "derivative_table",
    "parsed_tolerances",
    "path_bands",
    "spread_instants",
    "tolerance_study",
    "written_tolerances",
]
