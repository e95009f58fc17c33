"""A mechanism that a Python file makes: FILE.py:OBJECT."""

import inspect
import os
import runpy
from collections.abc import Callable, Mapping
from typing import Any

from mechsim import units
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import InputError, MechsimError
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.toml_values import suggestion


def read_python(model: str, changed: Mapping[str, str | float] | None = None) -> Form:
    """Run a Python file and return the mechanism that one of its objects is or returns.

    Args:
        model: FILE.py:OBJECT; the object is a Mechanism, what the catalogue makes, or a function that returns
            either and whose arguments have defaults.
        changed: argument of the function -> its value, as text or in SI.

    Raises:
        InputError: for a file that cannot be run, an object that is no mechanism, or an unknown argument.
    """
    return python_factory(model)(changed or {})


def python_factory(model: str) -> Callable[[Mapping[str, str | float]], Form]:
    """Run a Python file and return what makes its mechanisms from arguments, as `read_python` does.

    Raises:
        InputError: as `object_of`.
    """
    loaded, (path, _, name) = run_object(model), model.rpartition(":")

    def make(changed: Mapping[str, str | float]) -> Form:
        result = loaded
        if _is_factory(loaded):
            arguments = _arguments(model, loaded, changed)
            result = run_user_code(f"{path}: {name}()", lambda: loaded(**arguments))
        elif changed:
            raise InputError(f"{model}: an object in a Python file has no parameters; leave out --set")
        if isinstance(result, ClosedForm | LoopForm):
            return result
        if isinstance(result, Mechanism):
            return LoopForm(result)
        raise InputError(
            f"{name} of {path} is of type {type(result).__name__}; give a Mechanism, what catalog.make "
            "returns, or a function that returns either"
        )

    return make


def parameters_of(model: str) -> dict[str, float]:
    """Return the parameters of a mechanism in a Python file: arguments with numbers as defaults -> those.

    Raises:
        InputError: as `object_of`.
    """
    loaded = run_object(model)
    return dict(_defaults(loaded)) if _is_factory(loaded) else {}


def _is_factory(loaded: Any) -> bool:
    return callable(loaded) and not isinstance(loaded, Mechanism | ClosedForm | LoopForm)


def _defaults(function: Any) -> dict[str, float]:
    parameters = inspect.signature(function).parameters.values()
    return {
        parameter.name: parameter.default
        for parameter in parameters
        if isinstance(parameter.default, int | float) and not isinstance(parameter.default, bool)
    }


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
        InputError: for a file that cannot be run, or that makes no such object.
    """
    path, colon, name = model.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputError(f"{model!r} names no object; write FILE.py:OBJECT, as in fourbar.py:mechanism")
    if not os.path.isfile(path):
        raise InputError(f"there is no file {path}; name one that can be read")
    names: dict[str, Any] = run_user_code(path, lambda: runpy.run_path(path, run_name="mechsim_model"))
    if name not in names:
        defined = [name_ for name_ in names if not name_.startswith("__")]
        raise InputError(f"{path} makes no {name!r}{suggestion(name, defined)}")
    return names[name]


def run_user_code(what: str, call: Any) -> Any:
    """Return what a user's code returns; its errors in one line."""
    try:
        return call()
    except MechsimError as error:
        raise InputError(f"{what}: {error}") from error
    except (Exception, SystemExit) as error:
        line = (str(error).splitlines() or [""])[0]
        raise InputError(f"{what} ends in {type(error).__name__}: {line}; mend the file") from error
