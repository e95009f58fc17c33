"""The libraries that sweeps stand on, brought by `mechsim[sweep]` and imported when they are wanted."""

from importlib import import_module
from typing import Any

from mechsim.errors import MissingToolError

REMEDY = "pip install 'mechsim[sweep]' brings it"


def library(name: str, what: str) -> Any:
    """Return a library.

    Raises:
        MissingToolError: where it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        raise MissingToolError(f"{what} needs {name.partition('.')[0]}, which is missing; {REMEDY}") from None
