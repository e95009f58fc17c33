"""Checks of models against formulas in your own test suite: an assertion, and a pytest plugin."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mechsim.testing.assertion import assert_agrees

__all__ = ["assert_agrees"]


if not TYPE_CHECKING:  # pytest loads the plugin in every run: import only what is used

    def __getattr__(name: str) -> Any:
        if name != "assert_agrees":
            raise AttributeError(f"module 'mechsim.testing' has no attribute {name!r}")
        return import_module("mechsim.testing.assertion").assert_agrees
