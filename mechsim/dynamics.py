"""Dynamics of anything that `load` takes: a name, a file, a MuJoCo object or a mechanism.

The functions are those of `mechsim.kinetics`, which take mechanisms and solvers only.
"""

from collections.abc import Callable
from functools import partial, wraps
from os import PathLike
from typing import Any, ParamSpec, TypeVar

from mechsim import kinetics
from mechsim.io.readers import load
from mechsim.kinetics import *  # noqa: F403 (the names of `__all__`)

P = ParamSpec("P")
R = TypeVar("R")


def _loading(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function of a model that also takes a name, a path or a MuJoCo object."""

    @wraps(function)
    def load_and_call(*args: P.args, **options: P.kwargs) -> R:
        source: Any = args[0] if args else None
        # MuJoCo is not imported to recognise its objects
        if isinstance(source, str | PathLike) or type(source).__name__ in ("MjModel", "MjSpec"):
            made = partial(load, source, still=True)
            rest: Any = (made if options.get("parameters") else made(), *args[1:])
            return function(*rest, **options)
        return function(*args, **options)

    return load_and_call


dynamic_model = _loading(kinetics.dynamic_model)
equilibria = _loading(kinetics.equilibria)
holding = _loading(kinetics.holding)
holding_range = _loading(kinetics.holding_range)
load_curve = _loading(kinetics.load_curve)
modes = _loading(kinetics.modes)
nearest_equilibrium = _loading(kinetics.nearest_equilibrium)
response = _loading(kinetics.response)
run = _loading(kinetics.run)
run_many = _loading(kinetics.run_many)

__all__: list[str] = []
__all__ += kinetics.__all__
