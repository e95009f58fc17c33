"""The libraries of sweeps, installed by `mechsim[sweep]` and imported on demand."""

import warnings
from importlib import import_module
from typing import Any

from mechsim.errors import needs


def library(name: str) -> Any:
    """Return a library.

    Raises:
        MissingToolError: if it is not installed.
    """
    with needs("sweep"), warnings.catch_warnings():
        # harmless according to numpy's documentation
        warnings.filterwarnings("ignore", "numpy.ndarray size changed")
        return import_module(name)
