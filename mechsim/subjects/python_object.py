"""A mechanism that a Python file makes: FILE.py:OBJECT."""

import os
import runpy
from typing import Any

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.forms import Form
from mechsim.errors import InputError, MechsimError
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.toml_source import nearest


def read_python(model: str) -> Form:
    """Run a Python file and return the mechanism that one of its objects is or returns.

    Args:
        model: FILE.py:OBJECT; the object is a Mechanism, what the catalogue makes, or a function without
            arguments that returns either.

    Raises:
        InputError: for a file that cannot be run, or an object that is no mechanism.
    """
    found, (path, _, name) = object_of(model), model.rpartition(":")
    if callable(found) and not isinstance(found, Mechanism | ClosedForm | LoopForm):
        found = tried(f"{path}: {name}()", found)
    if isinstance(found, ClosedForm | LoopForm):
        return found
    if isinstance(found, Mechanism):
        return LoopForm(found)
    raise InputError(
        f"{name} of {path} is of type {type(found).__name__}; give a Mechanism, what catalog.make returns, "
        "or a function without arguments that returns either"
    )


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
