"""A TOML file with a formula as a test file with one test."""

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from mechsim.errors import MechsimError


class FormulaItem(pytest.Item):
    """The test that a file's mechanism agrees with the formula it names."""

    def runtest(self) -> None:
        """Run it."""
        root = Path.cwd()
        path = self.path.relative_to(root) if self.path.is_relative_to(root) else self.path
        # what is only collected needs none of it
        assertion: Any = import_module("mechsim.testing.assertion")
        assertion.assert_agrees(str(path))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: object = None) -> str:
        """Return a difference or a refusal as it is said, without the code that said it."""
        if isinstance(excinfo.value, AssertionError | MechsimError):
            return str(excinfo.value)
        return str(super().repr_failure(excinfo))

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return where the test stands."""
        return self.path, 0, self.nodeid


class TomlFile(pytest.File):
    """A file that describes a mechanism and names a formula."""

    def collect(self) -> Iterable[pytest.Item]:
        """Return its one test."""
        item = FormulaItem.from_parent(self, name="formula")
        item.add_marker("mechsim")
        return [item]
