"""Table of a published problem: the error of each quantity and its tolerance."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mechsim.simulation.dynamics.forward_run import SteppedRun


@dataclass(frozen=True, slots=True)
class Row:
    """A quantity of a problem: its error, tolerance and unit, and the reason of the tolerance."""

    quantity: str
    error: float
    tolerance: float
    unit: str
    reason: str

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; NaN is not."""
        return self.error <= self.tolerance


def energy_error(run: SteppedRun, work: np.ndarray | float = 0.0) -> float:
    """Return the largest error of the energy balance relative to the exchanged energy; work in [J], (n,)."""
    balance = run.kinetic + run.potential - work
    exchanged = max(np.abs(run.kinetic).max(), np.ptp(run.potential), np.abs(work).max())
    return float(np.abs(balance - balance[0]).max() / exchanged)


def show(title: str, rows: Iterable[Row]) -> int:
    """Print a table; return 0 if every row passes, else 1."""
    print(title)
    failed = 0
    for row in rows:
        relation = "<=" if row.passed else "> "
        values = f"{row.error:9.2e} {relation} {row.tolerance:8.1e}"
        print(f"  {row.quantity:<44} {values} {row.unit:<5} {row.reason}")
        failed += not row.passed
    return int(failed > 0)
