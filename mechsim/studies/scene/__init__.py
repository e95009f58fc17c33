"""A user's own MJCF scene in plain MuJoCo, over its own motion: runs, exact closure, limit, errors, time."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
from mechsim.studies.scene.converged_reference import SceneLimit, limit_of
from mechsim.studies.scene.errors import MEASURES, By, SceneErrors, errors_of, start_error
from mechsim.studies.scene.evaluator import SceneRun, step_times, stepped
from mechsim.studies.scene.exact_closure import ExactClosure
from mechsim.studies.scene.scene import UserScene, begun_closed, scene_of, spec_of

__all__ = [
    "MEASURES",
    "By",
    "ExactClosure",
    "SceneErrors",
    "SceneLimit",
    "SceneRun",
    "UserScene",
    "begun_closed",
    "errors_of",
    "limit_of",
    "scene_of",
    "spec_of",
    "start_error",
    "step_times",
    "stepped",
]
