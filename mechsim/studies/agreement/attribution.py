"""Where the distance between a run in time and a claim comes from: formula, softness, step, drive, rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.errors import MechsimError
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.claim import Claim
from mechsim.studies.agreement.comparand import Comparand
from mechsim.studies.agreement.comparison import Scales, errors
from mechsim.studies.agreement.stepped_runs import TwoRuns, runs_of

PARTS = ("formula", "softness", "time step", "drive", "rest")
KINDS = ("position", "joint")

# what is claimed where the drivers of another comparand are
AskedAgain = Callable[[Comparand], Sequence[Claim]]


@dataclass(frozen=True)
class Attribution:
    """The distance of one quantity, taken apart.

    Attributes:
        name: of the quantity.
        unit: of all parts.
        at: crank angle in [rad], or time of motion laws in [s], where the distance is largest.
        at_unit: of it; "row" where a table has no times.
        whole: the largest distance between run and claim.
        parts: part -> how far it moves the run from the claim there, along the distance: they add up to it.
        largest: part -> the most that it is anywhere, by itself.
        how: what was run.
    """

    name: str
    unit: str
    at: float
    at_unit: str
    whole: float
    parts: dict[str, float]
    largest: dict[str, float]
    how: str

    def as_dict(self) -> dict[str, Any]:
        """Return it as `mechsim validate --json` prints it."""
        told = {"unit": self.unit, "whole": self.whole, "quantity": self.name, "at": self.at}
        told["at_unit"] = self.at_unit
        return {**self.parts, **told, "largest": self.largest, "run": self.how}

    @property
    def says(self) -> str:
        """The parts in one line."""
        parts = ", ".join(f"{name} {self.parts[name]:.2g}" for name in PARTS)
        return f"run against {self.name}: {self.whole:.2g} {self.unit} = {parts}"


def attributed(
    comparand: Comparand, claims: Sequence[Claim], scales: Scales, again: AskedAgain | None = None
) -> list[Attribution]:
    """Return where the distances between a run and claims come from, the largest first.

    Args:
        comparand: what moves, and when.
        claims: what is said of it; places of points and coordinates of joints count.
        scales: by which distances of several kinds are compared.
        again: asks the same where the run's drivers were; None where only a table tells.

    Raises:
        MechsimError: where nothing can be run; says why.
    """
    some = [claim for claim in claims if claim.named.kind in KINDS]
    if not some:
        return []
    runs = runs_of(comparand, [claim.named for claim in some])
    there = None
    if again is not None:
        there = {claim.named.name: claim for claim in again(runs.plain.there)}
    found = [
        _of_one(runs, i, claim, None if there is None else there[claim.named.name])
        for i, claim in enumerate(some)
    ]
    return sorted(
        found, key=lambda one: -one.whole / scales.of(next(c.named for c in some if c.named.name == one.name))
    )


def _of_one(runs: TwoRuns, i: int, claim: Claim, there: Claim | None) -> Attribution:
    named = claim.named

    def gap(one: Array, other: Array) -> Array:
        return errors(named, one, other)

    asked = runs.asked.exact(named)
    plain, fine = (run.there.exact(named) for run in (runs.plain, runs.fine))
    run, finer = runs.plain.values[i], runs.fine.values[i]
    whole = gap(run, claim.values)
    soft = gap(finer, fine)
    parts = {
        "formula": gap(asked, claim.values) if there is None else gap(plain, there.values),
        "softness": soft,
        "time step": gap(gap(run, plain), soft),
        "drive": gap(plain, asked),
    }
    parts["rest"] = gap(whole, np.sum([*parts.values()], axis=0))
    size = np.linalg.norm(whole, axis=1)
    at = int(np.argmax(size))
    along = whole[at] / size[at] if size[at] > 0.0 else np.zeros(whole.shape[1])
    instants = runs.asked.instants
    return Attribution(
        name=named.name,
        unit=named.unit,
        at=float(instants.value[at]),
        at_unit=instants.unit,
        whole=float(size[at]),
        parts={name: float(part[at] @ along) for name, part in parts.items()},
        largest={name: float(np.linalg.norm(part, axis=1).max()) for name, part in parts.items()},
        how=runs.how,
    )


def told(
    comparand: Comparand, claims: Sequence[Claim], scales: Scales, again: AskedAgain | None
) -> dict[str, Any]:
    """Return the attribution of the quantity farthest off as plain data, with all; a note where none is."""
    try:
        found = attributed(comparand, claims, scales, again)
    except MechsimError as error:
        return {"note": str(error)}
    if not found:
        return {}
    return {
        **found[0].as_dict(),
        "says": found[0].says,
        "quantities": {one.name: one.as_dict() for one in found},
    }
