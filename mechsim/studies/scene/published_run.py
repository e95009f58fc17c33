"""The run of an MJCF file in plain MuJoCo with its own settings, and its loop-closure errors."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from mechsim.mechanism.finding import Finding, Severity
from mechsim.numerics.arrays import Array, worst


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedRun:
    """The run of a file with its own settings.

    Attributes:
        path: path of the file.
        settings: time step in [s], integrator, solver, `solref` of the loops (None if they differ).
        driven: description of the driver actuation.
        instants: crank angle in [rad] at each record, or time in [s] under motion laws, (n,).
        instants_unit: unit of the instants, "rad" or "s".
        gaps: largest distance between the two sides of a connect or weld, (n,) in [m].
        errors: largest distance of a tracked point from the exact closure at the run's own drivers, (n,).
        note: reason for a missing run or error; empty otherwise.
        run: whether the file was run.
    """

    JSON: ClassVar[tuple[str, ...]] = ("settings", "driven", "loop_closure=gap", "error", "note")

    path: str
    settings: Mapping[str, Any]
    driven: str = ""
    instants: Array = field(default_factory=lambda: np.zeros(0))
    instants_unit: Literal["rad", "s"] = "rad"
    gaps: Array = field(default_factory=lambda: np.zeros(0))
    errors: Array = field(default_factory=lambda: np.zeros(0))
    note: str = ""
    run: bool = True

    @property
    def gap(self) -> float:
        """The largest gap, in [m]; infinite for a diverged run."""
        return self._worst(self.gaps)

    @property
    def error(self) -> float:
        """The largest error, in [m]; infinite for a diverged run."""
        return self._worst(self.errors)

    def _worst(self, values: Array) -> float:
        if not len(values):
            return np.inf if self.run else np.nan
        return worst(values)

    @property
    def label(self) -> str:
        """The settings in a few words."""
        loops = self.settings.get("solref")
        compliance = "" if loops is None else f", solref {' '.join(f'{value:g}' for value in loops)}"
        step = 1e3 * float(self.settings["timestep"])
        return f"timestep {step:g} ms, {self.settings['integrator']}, {self.settings['solver']}{compliance}"

    def finding(self, tolerance: float) -> Finding:
        """Return the result of the run as a finding: an error beyond a tolerance in [m], else a note."""
        message, remedy = f"with the file's own settings ({self.label}) {self.note}", ""
        severity: Severity = "error" if self.run else "warning"
        if not self.run:
            message = f"the file's own settings ({self.label}) are not checked: {self.note}"
        elif not self.note:
            message = (
                f"with the file's own settings ({self.label}) loops open by up to {self.gap:.2g} m, and "
                f"points are up to {self.error:.2g} m from the exact closure"
            )
            severity = "note" if max(self.gap, self.error) <= tolerance else "error"
        if severity == "error":
            remedy = f"`mechsim tune {self.path} --tolerance {tolerance:.2g}m -o tuned.xml` finds settings"
        return Finding(
            kind="published",
            object=self.path,
            value=self.gap if self.run else 0.0,
            target=tolerance,
            message=message,
            remedy=remedy,
            severity=severity,
        )
