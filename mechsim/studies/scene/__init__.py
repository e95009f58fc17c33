"""Custom MJCF scenes in plain MuJoCo: motion, runs, exact closure, errors, cost, tuned settings."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
from mechsim.studies.scene.converged_reference import ConvergedReference, compute_reference
from mechsim.studies.scene.errors import (
    MEASURES,
    By,
    SceneErrors,
    SceneEvaluator,
    SceneTrial,
    errors_of,
    start_error,
)
from mechsim.studies.scene.exact_closure import ExactClosure
from mechsim.studies.scene.run import SceneRun, run_scene, step_times
from mechsim.studies.scene.scene import UserScene, scene_of, spec_of, with_assembled_start

__all__ = [
    "MEASURES",
    "By",
    "ConvergedReference",
    "ExactClosure",
    "SceneErrors",
    "SceneEvaluator",
    "SceneRun",
    "SceneTrial",
    "UserScene",
    "compute_reference",
    "errors_of",
    "run_scene",
    "scene_of",
    "spec_of",
    "start_error",
    "step_times",
    "with_assembled_start",
]
