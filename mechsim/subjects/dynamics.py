"""Dynamics of anything that `load` takes: a name, a file, a MuJoCo object or a mechanism.

The functions are those of `mechsim.analytic.dynamics`, which take mechanisms and solvers only.
"""

from collections.abc import Callable
from functools import partial, wraps
from os import PathLike
from typing import Any, ParamSpec, TypeVar

from mechsim.analytic import dynamics
from mechsim.analytic.dynamics import *  # noqa: F403 (the names of `__all__`)
from mechsim.subjects.readers import load

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


dynamic_model = _loading(dynamics.dynamic_model)
equilibria = _loading(dynamics.equilibria)
holding = _loading(dynamics.holding)
holding_range = _loading(dynamics.holding_range)
load_curve = _loading(dynamics.load_curve)
modes = _loading(dynamics.modes)
nearest_equilibrium = _loading(dynamics.nearest_equilibrium)
response = _loading(dynamics.response)
run = _loading(dynamics.run)
run_many = _loading(dynamics.run_many)

__all__: list[str] = []
__all__ += dynamics.__all__
