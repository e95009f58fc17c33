"""`simulate` for all models that `load` accepts: names, files and objects."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from os import PathLike
from typing import Any, ParamSpec

from mechsim.io.readers import load
from mechsim.simulation.run import Run
from mechsim.simulation.run import simulate as simulated

P = ParamSpec("P")


def _accepting_names(run: Callable[P, Run]) -> Callable[P, Run]:
    """Return a run function that also accepts a name, FILE.toml or FILE.py:OBJECT, as `load` does."""

    @wraps(run)
    def load_and_run(*args: P.args, **options: P.kwargs) -> Run:
        if args and isinstance(args[0], str | PathLike):
            text = str(args[0])
            # MuJoCo runs the text or file of an MJCF model unchanged
            if "<" not in text and not text.lower().endswith((".xml", ".urdf")):
                rest: Any = (load(text), *args[1:])
                return run(*rest, **options)
        return run(*args, **options)

    return load_and_run


simulate = _accepting_names(simulated)
