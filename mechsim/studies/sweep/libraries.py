"""The libraries that sweeps stand on, brought by `mechsim[sweep]` and imported when they are wanted."""

import warnings
from importlib import import_module
from typing import Any

from mechsim.errors import needs


def library(name: str) -> Any:
    """Return a library.

    Raises:
        MissingToolError: where it is not installed.
    """
    with needs("sweep"), warnings.catch_warnings():
        # numpy says itself that this means nothing
        warnings.filterwarnings("ignore", "numpy.ndarray size changed")
        return import_module(name)
