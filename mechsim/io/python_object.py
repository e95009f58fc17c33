"""A mechanism from a Python file: FILE.py:OBJECT."""

import inspect
import os
import runpy
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mechsim import units
from mechsim.errors import InputError, MechsimError
from mechsim.io.model_source import ModelDescription, ModelSource, Parameters, Prescription
from mechsim.io.toml_values import suggestion
from mechsim.kinematics.designs import Dimension
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.mechanism import Mechanism


@dataclass(frozen=True)
class PythonObject(ModelSource):
    """An object in a Python file: a Mechanism, a catalogue object, or a function that returns one of them.

    Arguments of the function with numbers as defaults are parameters. The file is run once.

    Attributes:
        address: FILE.py:OBJECT.
    """

    address: str

    @cached_property
    def loaded(self) -> Any:
        """The object."""
        return run_object(self.address)

    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism that the object is or returns."""
        return ModelDescription(self.make(changed))

    def make(self, changed: Mapping[str, str | float]) -> KinematicSolver:
        """Return the solver for some arguments of the function, each as text or in SI.

        Raises:
            InputError: for a file that fails, an object that is no mechanism, or an unknown argument.
        """
        result, (path, _, name) = self.loaded, self.address.rpartition(":")
        if _is_factory(result):
            function, arguments = result, _arguments(self.address, result, changed)
            result = run_user_code(f"{path}: {name}()", lambda: function(**arguments))
        elif changed:
            raise InputError(f"{self.address}: an object in a Python file has no parameters; leave out --set")
        if isinstance(result, KinematicSolver):
            return result
        if isinstance(result, Mechanism):
            return KinematicSolver(result)
        raise InputError(
            f"{name} of {path} is of type {type(result).__name__}; give a Mechanism, the result of "
            "catalog.make, or a function that returns either"
        )

    def parameters(self, changed: Mapping[str, str | float]) -> Parameters:
        """Return the arguments with numbers as defaults; the file states no units."""
        if not _is_factory(self.loaded):
            return Parameters()
        values = _defaults(self.loaded) | _arguments(self.address, self.loaded, changed)
        return Parameters({name: Dimension(name, float(value), "1") for name, value in values.items()})


@dataclass(frozen=True)
class GivenObject(ModelSource):
    """A Mechanism, a catalogue object or a solver of loop equations, used unchanged."""

    model: Mechanism | KinematicSolver

    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism."""
        if changed:
            raise InputError(f"{self.model.name} is an object without parameters; leave out set")
        solver = KinematicSolver(self.model) if isinstance(self.model, Mechanism) else self.model
        return ModelDescription(solver)


def _is_factory(loaded: Any) -> bool:
    return callable(loaded) and not isinstance(loaded, Mechanism | KinematicSolver)


def _defaults(function: Any) -> dict[str, float]:
    with suppress(ValueError):  # a type of Python such as `int` has no signature
        return {
            parameter.name: parameter.default
            for parameter in inspect.signature(function).parameters.values()
            if isinstance(parameter.default, int | float) and not isinstance(parameter.default, bool)
        }
    return {}


def _arguments(model: str, function: Any, changed: Mapping[str, str | float]) -> dict[str, float]:
    defaults, arguments = _defaults(function), dict[str, float]()
    for name, value in changed.items():
        if name not in defaults:
            raise InputError(f"{model} has no parameter {name!r}{suggestion(name, defaults)}")
        number = units.of_any_kind(value, f"{name} of {model}")[0] if isinstance(value, str) else float(value)
        arguments[name] = int(number) if isinstance(defaults[name], int) and number == int(number) else number
    return arguments


def run_object(model: str) -> Any:
    """Run a Python file and return one of its objects.

    Raises:
        InputError: for a file that fails or does not define the object.
    """
    path, colon, name = model.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputError(f"{model!r} names no object; write FILE.py:OBJECT, as in fourbar.py:mechanism")
    if not os.path.isfile(path):
        raise InputError(f"there is no file {path}; name one that can be read")
    names: dict[str, Any] = run_user_code(path, lambda: runpy.run_path(path, run_name="mechsim_model"))
    if name not in names:
        defined = [name_ for name_ in names if not name_.startswith("__")]
        raise InputError(f"{path} defines no {name!r}{suggestion(name, defined)}")
    return names[name]


def run_user_code(what: str, call: Any) -> Any:
    """Return the result of a user's code; its errors become one-line messages."""
    try:
        return call()
    except MechsimError as error:
        raise InputError(f"{what}: {error}") from error
    except (Exception, SystemExit) as error:
        line = (str(error).splitlines() or [""])[0]
        raise InputError(f"{what} ends in {type(error).__name__}: {line}; repair the file") from error
