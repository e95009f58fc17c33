"""`simulate` for all models that `load` accepts: names, files and objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from os import PathLike
from typing import Any, ParamSpec

from mechsim.errors import AssemblyError, MobilityError
from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import MotionLaws
from mechsim.simulation.run import Run
from mechsim.simulation.run import simulate as simulated

P = ParamSpec("P")


def _accepting_names(run: Callable[P, Run]) -> Callable[P, Run]:
    """Return a run function that also accepts a name, FILE.toml or FILE.py:OBJECT, as `load` does."""

    @wraps(run)
    def load_and_run(*args: P.args, **options: P.kwargs) -> Run:
        positional: Any = args
        if args and isinstance(args[0], str | PathLike):
            text = str(args[0])
            # MuJoCo runs the text or file of an MJCF model unchanged
            if "<" not in text and not text.lower().endswith((".xml", ".urdf")):
                positional = load(text), *args[1:]
        result = run(*positional, **options)
        if positional and isinstance(positional[0], KinematicSolver):
            _require_ranges(positional[0], options.get("motion_laws"), result)
        return result

    return load_and_run


def _require_ranges(solver: KinematicSolver, laws: object, run: Run) -> None:
    """Raise AssemblyError if a joint leaves its range; models of files in MJCF have their limits."""
    if not solver.ranges or solver.source is not None:
        return
    if isinstance(laws, MotionLaws):
        solver = replace(solver, motion_laws=laws)
    try:
        solution = solver.whole_motion(run.motion.angle)
    except (AssemblyError, MobilityError):
        # undetermined motions have no solution
        return
    solver.within_ranges(solution)


simulate = _accepting_names(simulated)
