"""A user's own MJCF scene in plain MuJoCo, over its own motion: runs, exact closure, limit, errors, time."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
from mechsim.studies.scenes.closed_start import begun_closed, start_error
from mechsim.studies.scenes.exact_closure import ExactClosure
from mechsim.studies.scenes.scene_errors import MEASURES, By, SceneErrors, errors_of
from mechsim.studies.scenes.scene_limit import SceneLimit, limit_of
from mechsim.studies.scenes.scene_run import SceneRun, stepped
from mechsim.studies.scenes.step_time import step_times
from mechsim.studies.scenes.user_scene import UserScene, scene_of, spec_of

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
