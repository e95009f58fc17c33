"""Random mechanisms of the catalogue, every one solved: one formula takes arrays of parameters."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm, TwoBranchForm
from mechsim.analytic.catalog.many_designs import Bools, allowed, can_be_many, closed_at, solved
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.expansion import Block, Solved
from mechsim.studies.sensitivity.quantities import is_effort, is_rate

# poses solved in one go, whose arrays stay in a core's own cache; numbers kept at a time
BLOCK, KEPT = 8192, 6_400_000
# poses at the most, of which those with rates count so many times: about two seconds on one core
MOST, RATED = 10_000_000, 5


@dataclass(frozen=True)
class FormulaSamples:
    """Mechanisms with dimensions at random, solved by one formula.

    Attributes:
        solved: what solves one.
        form: the mechanism as it stands.
        parts: deviations in parts of the tolerances, (n, p), of mechanisms that can be put together.
    """

    solved: Solved
    form: ClosedForm
    parts: Array

    def blocks(self) -> Iterator[Block]:
        """Yield which of the quantities, (k,), and by how much all mechanisms are off there, (n, k)."""
        angles, columns = self.solved.moved.angles, self.solved.columns
        step = max(1, KEPT // (len(self.parts) * len(columns)))
        for first in range(0, len(angles), step):
            some = np.arange(first, min(first + step, len(angles)))
            which = np.concatenate([some + i * len(angles) for i in range(len(columns))])
            yield which, self.solved.less(self._values(angles[some]), which)

    def _values(self, angles: Array) -> Array:
        """Return the quantities at some angles, (n, columns * angles)."""
        columns, speed = self.solved.columns, self.solved.moved.rate
        rates = any(is_rate(one) for one in columns)
        joints = any(one.rpartition(".")[2].startswith(("q", "v", "a")) for one in columns)
        out = np.empty((len(self.parts), len(columns), len(angles)))
        for rows in _blocks(len(self.parts), len(angles)):
            varied = _varied(self.solved, self.parts[rows])
            told = dict(solved(self.form, varied, angles, speed, rates=rates, joints=joints).columns())
            for i, name in enumerate(columns):
                out[rows, i] = told[name].reshape(-1, len(angles))
        return out.reshape(len(out), -1)


def formula_samples(of: Solved, parts: Array) -> tuple[FormulaSamples, Bools] | None:
    """Return mechanisms that one formula solves, and which of all cannot be put together, (n,).

    None where there is no such formula, or where it would take too long.

    Args:
        of: what solves one.
        parts: deviations of all in parts of the tolerances, (n, p).
    """
    form, angles, columns = of.moved.form, of.moved.angles, of.columns
    poses = len(parts) * len(angles) * (RATED if any(is_rate(one) for one in columns) else 1)
    if poses > MOST or not isinstance(form, TwoBranchForm) or not can_be_many(form, of.bounds):
        return None
    told = solved(form, _varied(of, parts[:1]), angles[:1], 1.0, rates=True, joints=True)
    if any(is_effort(one) for one in columns) or not {*columns} <= dict(told.columns()).keys():
        return None
    # near change points an array of parameters has no branch of its own for each
    if form.change_points():
        return None
    good = allowed(form, _varied(of, parts))
    for rows in _blocks(len(parts), len(angles)):
        good[rows] &= closed_at(form, _varied(of, parts[rows]), angles)
    return FormulaSamples(of, form, parts[good]), ~good


def _blocks(count: int, poses: int) -> Iterator[slice]:
    step = max(1, BLOCK // poses)
    return (slice(first, first + step) for first in range(0, count, step))


def _varied(of: Solved, parts: Array) -> dict[str, Array]:
    """Return the dimensions of mechanisms: name -> (n,) in SI."""
    values = of.moved.family.values()
    return {name: values[name] + parts[:, i] * bound for i, (name, bound) in enumerate(of.bounds.items())}
