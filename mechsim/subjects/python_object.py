"""A mechanism that a Python file makes: FILE.py:OBJECT."""

import inspect
import os
import runpy
from collections.abc import Callable, Mapping
from typing import Any

from mechsim import units
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.forms import Form
from mechsim.errors import InputError, MechsimError
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.toml_source import nearest


def read_python(model: str, changed: Mapping[str, str | float] | None = None) -> Form:
    """Run a Python file and return the mechanism that one of its objects is or returns.

    Args:
        model: FILE.py:OBJECT; the object is a Mechanism, what the catalogue makes, or a function that returns
            either and whose arguments have defaults.
        changed: argument of the function -> its value, as text or in SI.

    Raises:
        InputError: for a file that cannot be run, an object that is no mechanism, or an unknown argument.
    """
    return python_maker(model)(changed or {})


def python_maker(model: str) -> Callable[[Mapping[str, str | float]], Form]:
    """Run a Python file and return what makes its mechanisms from arguments, as `read_python` does.

    Raises:
        InputError: as `object_of`.
    """
    found, (path, _, name) = object_of(model), model.rpartition(":")

    def make(changed: Mapping[str, str | float]) -> Form:
        made = found
        if _makes(found):
            given = _given(model, found, changed)
            made = tried(f"{path}: {name}()", lambda: found(**given))
        elif changed:
            raise InputError(f"{model}: an object in a Python file has no parameters; leave out --set")
        if isinstance(made, ClosedForm | LoopForm):
            return made
        if isinstance(made, Mechanism):
            return LoopForm(made)
        raise InputError(
            f"{name} of {path} is of type {type(made).__name__}; give a Mechanism, what catalog.make "
            "returns, or a function that returns either"
        )

    return make


def parameters_of(model: str) -> dict[str, float]:
    """Return the parameters of a mechanism in a Python file: arguments with numbers as defaults -> those.

    Raises:
        InputError: as `object_of`.
    """
    found = object_of(model)
    return dict(_defaults(found)) if _makes(found) else {}


def _makes(found: Any) -> bool:
    return callable(found) and not isinstance(found, Mechanism | ClosedForm | LoopForm)


def _defaults(function: Any) -> dict[str, float]:
    told = inspect.signature(function).parameters.values()
    return {
        one.name: one.default
        for one in told
        if isinstance(one.default, int | float) and not isinstance(one.default, bool)
    }


def _given(model: str, function: Any, changed: Mapping[str, str | float]) -> dict[str, float]:
    known, given = _defaults(function), dict[str, float]()
    for name, value in changed.items():
        if name not in known:
            raise InputError(f"{model} has no parameter {name!r}{nearest(name, known)}")
        number = units.of_any_kind(value, f"{name} of {model}")[0] if isinstance(value, str) else float(value)
        given[name] = int(number) if isinstance(known[name], int) and number == int(number) else number
    return given


def object_of(model: str) -> Any:
    """Run a Python file and return one of its objects.

    Raises:
        InputError: for a file that cannot be run, or that makes no such object.
    """
    path, colon, name = model.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputError(f"{model!r} names no object; write FILE.py:OBJECT, as in fourbar.py:mechanism")
    if not os.path.isfile(path):
        raise InputError(f"there is no file {path}; name one that can be read")
    names: dict[str, Any] = tried(path, lambda: runpy.run_path(path, run_name="mechsim_model"))
    if name not in names:
        own = [one for one in names if not one.startswith("__")]
        raise InputError(f"{path} makes no {name!r}{nearest(name, own)}")
    return names[name]


def tried(what: str, call: Any) -> Any:
    """Return what a user's code returns; its errors in one line."""
    try:
        return call()
    except MechsimError as error:
        raise InputError(f"{what}: {error}") from error
    except (Exception, SystemExit) as error:
        line = (str(error).splitlines() or [""])[0]
        raise InputError(f"{what} ends in {type(error).__name__}: {line}; mend the file") from error
