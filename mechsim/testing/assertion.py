"""An assertion for test suites: a model agrees with a formula; a failure states the likely cause."""

from __future__ import annotations

import inspect
import shlex
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mechsim.io.formula_file import with_formulas
from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import State
from mechsim.studies.agreement.agreement import SPEED, Agreement, compare_model, comparison_inputs, parametric
from mechsim.studies.validate import validate
from mechsim.testing.running import RUNNING, RunningTest

# width in characters, and number of failed quantities in a message
WIDTH_OF_MESSAGE, MAX_LISTED = 78, 3
Model = str | Path | KinematicSolver | Mechanism
Formula = str | Path | Callable[..., Any]


def assert_agrees(
    model: Model,
    formula: Formula | None = None,
    tolerance: float | str | None = None,
    *,
    set: Mapping[str, str | float] | None = None,
    drive: Mapping[str, str | State] | None = None,
    duration: str | float | None = None,
    speed: float | str = SPEED,
) -> Agreement:
    """Return the agreement of a model with a formula; fail if they differ.

    Args:
        model: a name, FILE.toml, FILE.xml, FILE.py:OBJECT, or a solver from `ms.load`.
        formula: a function of the drivers' coordinates, FILE.py:FUNC or FILE.csv; the default is the formula
            in the model's file. It is run.
        tolerance: tolerance of positions in [m] or text such as "10um"; those of other quantities are
            proportional. The default is 1e-8 of the workspace size, and rounding for the formula in the
            model's file.
        set: parameter -> its value, as in `ms.load`.
        drive: coordinate -> its motion law, as in `ms.load`.
        duration: duration of the motion laws, as in `ms.load`.
        speed: crank speed, in [rad/s] or text such as "600rpm".

    Raises:
        AssertionError: if a quantity exceeds its tolerance; states the verdict, the likely cause, and the
            command that repeats the comparison.
        InputError: for an invalid model or formula, in one sentence.
    """
    __tracebackhide__ = True
    source = str(model) if isinstance(model, Path) else model
    crank_speed, limit = comparison_inputs(speed, tolerance)
    designs = parametric(source, set, drive, duration)
    agreement = compare_model(designs, formula, speed=crank_speed, tolerance=limit)
    running = RUNNING.get()
    if running is not None:
        _record(running, agreement)
    if agreement.passed:
        return agreement
    # the command that repeats the comparison: of mechsim, else of pytest
    command = shlex.join(["pytest", running.name]) if running is not None else "run this test again"
    against, laws = _named(formula), drive or {}
    plain = all(isinstance(law, str) for law in laws.values())
    if isinstance(source, str) and plain and (against or formula is None):
        words = ["mechsim", "validate", source]
        words += ["--against", against] if against else []
        words += [word for name, value in (set or {}).items() for word in ("--set", f"{name}={value}")]
        words += [word for name, value in laws.items() for word in ("--drive", f"{name}={value}")]
        words += [] if duration is None else ["--duration", str(duration)]
        command = shlex.join(words)
    raise AssertionError(_failure(agreement, command))


def assert_file_agrees(path: str) -> None:
    """Fail if a TOML file differs from its formula, which is run; formulas that solve are validated.

    Raises:
        AssertionError: as `assert_agrees`.
        InputError: for an invalid file or formula.
    """
    __tracebackhide__ = True
    if with_formulas(path) == path:
        assert_agrees(path)
        return
    validation = validate(path, stepped=False)
    if not validation.passed:
        raise AssertionError(f"{validation}\n{shlex.join(['mechsim', 'validate', path])}")


def _record(running: RunningTest, agreement: Agreement) -> None:
    """Record the result in the JUnit file."""
    running.record("mechsim.model", agreement.solver.name)
    running.record("mechsim.against", agreement.source)
    running.record("mechsim.outcome", agreement.outcome)
    if agreement.checks:
        worst = max(agreement.checks, key=lambda check: check.severity)
        running.record("mechsim.worst", worst.title)
        running.record("mechsim.worst.value", f"{worst.worst:.6g} {worst.unit}")
        running.record("mechsim.worst.tolerance", f"{worst.tolerance:.6g} {worst.unit}")
    if agreement.findings:
        running.record("mechsim.cause", agreement.findings[0].message)


def _failure(agreement: Agreement, command: str) -> str:
    """Return the message of a failed assertion, lines of 78 columns unless a command is longer."""
    failed = sorted((c for c in agreement.checks if not c.passed), key=lambda check: -check.severity)
    lines = [f"{agreement.solver.name} does not agree with {agreement.source}"]
    for check in failed[:MAX_LISTED]:
        text = f"{check.title}: off by {check.worst:.3g} {check.unit}, tolerance {check.tolerance:.3g}"
        lines.append(f"  {textwrap.shorten(text, WIDTH_OF_MESSAGE - 2)}")
    if len(failed) > MAX_LISTED:
        lines.append(f"  and {len(failed) - MAX_LISTED} more of {len(agreement.checks)} quantities")
    cause = "none of the known mistakes explains the difference"
    if certain := [finding.message for finding in agreement.findings if finding.certain]:
        cause = " or ".join(certain)
    elif agreement.findings:
        best = agreement.findings[0]
        cause = f"perhaps: {best.message} (explains {100.0 * best.explains:.0f} %)"
    lines += textwrap.wrap(f"cause:  {cause}", WIDTH_OF_MESSAGE, subsequent_indent=" " * 8)
    return "\n".join([*lines, f"again:  {command}"])


def _named(formula: Formula | None) -> str:
    """Return FILE.py:FUNC of a function that a file defines; empty for any other function."""
    if formula is None or isinstance(formula, str | Path):
        return str(formula or "")
    name, home = getattr(formula, "__qualname__", ""), inspect.getmodule(formula)
    file = getattr(home, "__file__", None)
    if not file or not name.isidentifier() or getattr(home, name, None) is not formula:
        return ""
    path = Path(file)
    return f"{path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path}:{name}"


@dataclass(frozen=True, slots=True)
class ModelFolder:
    """Models and formulas in a folder.

    Attributes:
        folder: folder of the test.
    """

    folder: Path

    def load(self, model: str | Path, **options: Any) -> KinematicSolver:
        """Return a model of the folder, or a known one, as `ms.load`."""
        return load(str(self._path_of(model)), **options)

    def assert_agrees(
        self,
        model: Model,
        formula: Formula | None = None,
        tolerance: float | str | None = None,
        **options: Any,
    ) -> Agreement:
        """Return the agreement of a model of the folder with a formula, as `ms.testing.assert_agrees`."""
        __tracebackhide__ = True
        return assert_agrees(self._path_of(model), self._path_of(formula), tolerance, **options)

    def _path_of(self, source: Any) -> Any:
        """Return the path of a file of the folder; other values are returned unchanged."""
        if not isinstance(source, str | Path):
            return source
        file, python, _ = str(source).rpartition(".py:")
        exists = (self.folder / (f"{file}.py" if python else source)).is_file()
        return str(self.folder / source) if exists else source
