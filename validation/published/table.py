"""One way to print a published problem: quantity by quantity against its bound."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mechsim.simulation.dynamics.forward_run import SteppedRun


@dataclass(frozen=True, slots=True)
class Row:
    """One quantity of a problem: what was found, how far it may be off, its unit, and why so far."""

    quantity: str
    error: float
    bound: float
    unit: str
    why: str

    @property
    def passed(self) -> bool:
        """Whether the error is within the bound; NaN is not."""
        return self.error <= self.bound


def energy_error(run: SteppedRun, work: np.ndarray | float = 0.0) -> float:
    """Return the largest error of the energy balance relative to the exchanged energy; work in [J], (n,)."""
    balance = run.kinetic + run.potential - work
    exchanged = max(np.abs(run.kinetic).max(), np.ptp(run.potential), np.abs(work).max())
    return float(np.abs(balance - balance[0]).max() / exchanged)


def show(title: str, rows: Iterable[Row]) -> int:
    """Print a table; return 0 if every row is within its bound, else 1."""
    print(title)
    missed = 0
    for row in rows:
        relation = "<=" if row.passed else "> "
        print(f"  {row.quantity:<44} {row.error:9.2e} {relation} {row.bound:8.1e} {row.unit:<5} {row.why}")
        missed += not row.passed
    return int(missed > 0)
