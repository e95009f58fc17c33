"""What the fixture `mechsim` gives: models by the names they have beside the test."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mechsim.analytic.forms import Form
from mechsim.studies.agreement.agreement import Agreement
from mechsim.subjects.subject import load
from mechsim.testing.assertion import Formula, Model, assert_agrees


@dataclass(frozen=True, slots=True)
class Beside:
    """Models and formulas in a folder.

    Attributes:
        folder: of the test.
    """

    folder: Path

    def load(self, model: str | Path, **asked: Any) -> Form:
        """Return a model of the folder, or a known one, as `ms.load` does."""
        return load(str(self._found(model)), **asked)

    def assert_agrees(
        self, model: Model, formula: Formula | None = None, tolerance: float | str | None = None, **asked: Any
    ) -> Agreement:
        """Return how a model of the folder and a formula agree, as `ms.testing.assert_agrees` does."""
        __tracebackhide__ = True
        return assert_agrees(self._found(model), self._found(formula), tolerance, **asked)

    def _found(self, given: Any) -> Any:
        """Return the path of a file of the folder; anything else as it is."""
        if not isinstance(given, str | Path):
            return given
        file, python, _ = str(given).rpartition(".py:")
        return (
            str(self.folder / given)
            if (self.folder / (f"{file}.py" if python else given)).is_file()
            else given
        )
