"""Dimensions fitted to measured motion by least squares, with exact derivatives."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim import files, units
from mechsim.analytic.derivatives.dimensions import Dimension
from mechsim.errors import InputError, MechsimError
from mechsim.model.forces import Forces
from mechsim.model.motion import short_repr
from mechsim.numerics.angles import wrapped
from mechsim.numerics.arrays import Array
from mechsim.studies.measured_table import MeasuredMotion, measured_of, single
from mechsim.studies.sensitivity.moved_family import MovedFamily, family_at
from mechsim.studies.sensitivity.sensitivity import Subject, dimension_names, moved_along
from mechsim.subjects.readers import parametric_model

# singular values of the scaled derivatives below this part of the largest are rounding
RANK_TOLERANCE = 1e-7
# component of such a direction from which a dimension counts as undetermined
SHARE = 0.1
# mechanisms tried at the most, and the relative change at which a fit has come to rest
MAX_MECHANISMS, REST = 100, 1e-10

FitOutcome = Literal["fitted", "underdetermined", "not converged"]


@dataclass(frozen=True)
class Fit:
    """Dimensions that fit measured motion best.

    Attributes:
        moved: the mechanism with them, moved as it was measured.
        outcome: "underdetermined" where the measurements do not determine all dimensions.
        start: dimension -> value from which it began, in SI.
        values: dimension -> value found.
        units: dimension -> its SI unit.
        deviations: dimension -> standard deviation; none of those that are undetermined.
        covariance: of the dimensions in their order, (p, p); of those that are determined.
        together: groups of undetermined dimensions: the measurement determines of each group one
            dimension fewer than it has.
        rms: quantity -> root mean square of what is left, in SI.
        spread: root of what is left by the numbers measured beyond those wanted, in the deviations that were
            given; about 1 where these are true. Without any, what they would have to be, as parts of the
            mechanism's size and in [rad].
        weighed: whether deviations were given.
        free: number of measured values beyond the number of dimensions.
        condition: of the scaled derivatives: the accuracy of the best combination relative to the worst.
        tried: mechanisms solved.
    """

    moved: MovedFamily
    outcome: FitOutcome
    start: Mapping[str, float]
    values: Mapping[str, float]
    units: Mapping[str, str]
    deviations: Mapping[str, float]
    covariance: Array
    together: Sequence[tuple[str, ...]]
    rms: Mapping[str, float]
    spread: float
    weighed: bool
    free: int
    condition: float
    tried: int

    __repr__ = short_repr

    def within(self, fraction: float = 0.95) -> dict[str, float]:
        """Return how far to either side of what was found a dimension lies with so much certainty, in SI.

        By the normal distribution where deviations were given, else by Student's t.
        """
        from scipy.stats import norm, t

        share = 0.5 * (1.0 + fraction)
        factor = norm.ppf(share) if self.weighed else t.ppf(share, self.free) if self.free > 0 else np.inf
        return {name: float(factor) * deviation for name, deviation in self.deviations.items()}

    @property
    def correlations(self) -> dict[tuple[str, str], float]:
        """Correlation of each two dimensions that have a deviation."""
        names = list(self.values)
        scale = np.sqrt(np.diag(self.covariance))
        pairs = [(i, j) for i in range(len(names)) for j in range(i) if scale[i] * scale[j] > 0.0]
        return {(names[j], names[i]): float(self.covariance[i, j] / (scale[i] * scale[j])) for i, j in pairs}


def fit_dimensions(
    moved: MovedFamily,
    measured: MeasuredMotion,
    vary: Sequence[str],
    *,
    offset: bool = False,
    progress: Callable[[str, float], None] = lambda _, __: None,
) -> Fit:
    """Return the dimensions with which a mechanism moves most nearly as it was measured.

    The sum of squares of what is left, in the deviations given, is made smallest by scipy's `least_squares`
    (trust region) with exact derivatives, from the dimensions as they stand. Where no deviations are given,
    lengths count in the mechanism's size, angles in [rad], rates and efforts in the largest that was measured
    in their unit.

    Args:
        moved: the mechanism, and its speed and forces; its angles are those measured.
        measured: what was measured.
        vary: names of dimensions, whole places by their parts.
        offset: whether the zero of the crank's encoder is unknown, too: CRANK.offset is how far the crank
            stood ahead of what was read.
        progress: called with a text and the finished fraction.

    Raises:
        InputError: for an unknown dimension or quantity, fewer numbers than dimensions, or an offset of what
            has no crank, or of efforts under loads that follow its angle.
        AssemblyError: where the mechanism from which it begins cannot stand at what was measured.
    """
    from scipy.optimize import least_squares

    subject = replace(moved, angles=measured.angles)
    named = single(measured.values, subject)
    names = dimension_names(subject, vary)
    subject.designs.require_independent(names)
    if offset:
        _require_offset(subject, named.values())
        names.append(subject.offset)
    if measured.count < len(names):
        raise InputError(
            f"{measured.count} numbers are measured and {len(names)} dimensions wanted; "
            "measure more, or vary fewer"
        )
    problem = _Problem(subject, measured, named, names, progress)
    problem.residuals(np.zeros(len(names)))
    derivatives: Any = problem.derivatives
    solution: Any = least_squares(
        problem.tried,
        np.zeros(len(names)),
        derivatives,
        method="trf",
        xtol=REST,
        ftol=REST,
        gtol=REST,
        max_nfev=MAX_MECHANISMS,
    )
    return problem.result(solution.x, solution.status > 0)


def _require_offset(moved: MovedFamily, columns: Iterable[str]) -> None:
    """Refuse an unknown zero where none can be found."""
    name = moved.designs.name
    if not moved.offset:
        raise InputError(
            f"{name} has no lone crank without a motion law whose zero could be unknown; leave it out"
        )
    acting = moved.loading.acting(moved.solver)
    if (acting.loads or acting.couples or acting.crank_torque) and moved.loaded(columns):
        raise InputError(
            f"{name}: forces under loads that follow the crank do not determine its zero; "
            "leave them or the loads out"
        )


class _Problem:
    """What least squares asks for, dimensions relative to their scales."""

    def __init__(
        self,
        moved: MovedFamily,
        measured: MeasuredMotion,
        named: Mapping[str, str],
        names: list[str],
        progress: Callable[[str, float], None],
    ):
        self.moved, self.measured, self.named, self.names = moved, measured, named, names
        self.progress, self.count = progress, 0
        self.columns = [*dict.fromkeys(named.values())]
        length = moved.solver.mechanism.characteristic_length
        dimensions = {**moved.designs.dimensions, moved.offset: Dimension(moved.offset, 0.0, "rad")}
        self.start = {name: dimensions[name].value for name in names}
        self.dimension_units = {name: dimensions[name].unit for name in names}
        scales = {"m": lambda _: length, "1": lambda value: abs(value) or 1.0}
        self.scale = np.array(
            [scales.get(dimensions[name].unit, lambda _: 1.0)(self.start[name]) for name in names]
        )
        self.units = {column: moved.quantity(name).unit for column, name in named.items()}
        self.weighed = bool(measured.deviations)
        self.weights = {column: self._weight(column, length) for column in named}

    def _weight(self, column: str, length: float) -> Array:
        """Return the scale of a column's residuals, (n,)."""
        deviations = self.measured.deviations
        if column in deviations:
            return deviations[column]
        if self.weighed:
            raise InputError(
                f"it is said how well {', '.join(deviations)} is known, but not how well {column} is; add a "
                f"column {column}±"
            )
        unit, values = self.units[column], self.measured.values
        alike = [float(np.abs(values[name]).max()) for name in values if self.units[name] == unit]
        scale = {"m": length, "rad": 1.0}.get(unit) or max(alike) or 1.0
        return np.full(len(self.measured.angles), scale)

    def dimensions(self, x: Array) -> dict[str, float]:
        """Return dimensions from parts of their scales."""
        return {
            name: self.start[name] + float(fraction)
            for name, fraction in zip(self.names, x * self.scale, strict=True)
        }

    def residuals(self, x: Array) -> Array:
        """Return what is left, (m,), in the deviations.

        Raises:
            MechsimError: for dimensions that leave no assembly.
        """
        self.count += 1
        self.progress(f"{self.count} mechanisms", 0.0)
        values = self.moved.values(self.columns, self.dimensions(x))
        off = [self._off(column, values[name]) / self.weights[column] for column, name in self.named.items()]
        return np.concatenate(off)

    def _off(self, column: str, values: Array) -> Array:
        off = values - self.measured.values[column]
        # whole revolutions are not measured
        return wrapped(off) if self.units[column] == "rad" else off

    def tried(self, x: Array) -> Array:
        """Return what is left; infinite where there is no assembly, which least squares goes back from."""
        try:
            return self.residuals(x)
        except MechsimError:
            return np.full(self.measured.count, np.inf)

    def derivatives(self, x: Array) -> Array:
        """Return exact derivatives of what is left, (m, p)."""
        by = self.moved.derivatives(self.columns, self.names, self.dimensions(x)).by
        rows = [
            np.concatenate(
                [by[name][quantity] / self.weights[column] for column, quantity in self.named.items()]
            )
            for name in self.names
        ]
        return np.array(rows).T * self.scale

    def result(self, x: Array, rested: bool) -> Fit:
        """Return what came of it."""
        residuals, derivatives = self.residuals(x), self.derivatives(x)
        _, singular, right = np.linalg.svd(derivatives, full_matrices=True)
        singular = np.pad(singular, (0, len(self.names) - len(singular)))
        determined = singular > RANK_TOLERANCE * singular[0]
        # numbers that stay what they are, as positions normal to a planar linkage, show no errors
        free = int(((residuals != 0.0) | derivatives.any(1)).sum()) - int(determined.sum())
        spread = float(np.sqrt((residuals**2).sum() / free)) if free > 0 else 0.0
        unit = 1.0 if self.weighed else spread
        covariance = (right[determined].T / singular[determined] ** 2) @ right[determined] * unit**2
        covariance = covariance * np.outer(self.scale, self.scale)
        together = tuple(_groups(right[~determined], self.names))
        lost = {name for group in together for name in group}
        values = self.dimensions(x)
        pieces = np.split(residuals, len(self.named))
        rms = {
            column: float(np.sqrt(((piece * self.weights[column]) ** 2).mean()))
            for column, piece in zip(self.named, pieces, strict=True)
        }
        deviations = {
            name: float(np.sqrt(covariance[i, i])) for i, name in enumerate(self.names) if name not in lost
        }
        outcome: FitOutcome = "underdetermined" if together else "fitted" if rested else "not converged"
        own = {name: value for name, value in values.items() if name != self.moved.offset}
        angles = self.moved.angles + values.get(self.moved.offset, 0.0)
        return Fit(
            moved=replace(self.moved, designs=family_at(self.moved.designs, own), angles=angles),
            outcome=outcome,
            start=self.start,
            values=values,
            units=self.dimension_units,
            deviations=deviations,
            covariance=covariance,
            together=together,
            rms=rms,
            spread=spread,
            weighed=self.weighed,
            free=free,
            condition=float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf,
            tried=self.count,
        )


def _groups(undetermined: Array, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return groups of dimensions that directions (d, p) join, along which nothing measured changes."""
    reach = np.sqrt((undetermined**2).sum(0))
    joined = (np.abs(undetermined.T @ undetermined) > SHARE**2) & np.outer(reach > SHARE, reach > SHARE)
    remaining = [i for i in range(len(names)) if reach[i] > SHARE]
    groups: list[tuple[str, ...]] = []
    while remaining:
        group = {remaining[0]}
        while more := {j for i in group for j in np.flatnonzero(joined[i]).tolist()} - group:
            group |= more
        groups.append(tuple(names[i] for i in sorted(group)))
        remaining = [i for i in remaining if i not in group]
    return groups


def fit(
    model: Subject,
    table: str | Path | Mapping[str, ArrayLike],
    vary: str | Sequence[str],
    *,
    offset: bool = False,
    speed: float | str = 1.0,
    forces: Forces | None = None,
) -> Fit:
    """Return the dimensions with which a subject moves most nearly as it was measured.

    Args:
        model: as `moved` takes it; the fit begins from its dimensions.
        table: measured motion: columns angle in [rad] (t in [s] under motion laws) and quantities named like
            ours or in `reference/` (torque:crank), in SI; a column P3.x± is the standard deviation of P3.x.
            A .csv or .npz file, or a mapping.
        vary: dimensions to find.
        offset: whether the zero of the crank's encoder is unknown, too: CRANK.offset is how far the crank
            stood ahead of the angles in the table.
        speed: of the crank in [rad/s] or text, as "600rpm", which only rates and efforts depend on.
        forces: what acts on it, where efforts were measured; None takes what its file says.

    Raises:
        InputError: for a table that does not serve, an unknown dimension, or fewer numbers than dimensions.
        AssemblyError: where it cannot stand at what was measured as it begins.
    """
    subject = model
    if not isinstance(subject, MovedFamily):
        # the table has the instants
        crank_speed = units.si(speed, "rad/s", "the speed")
        subject = moved_along(parametric_model(subject), np.zeros(1), crank_speed, forces)
    if isinstance(table, Mapping):
        columns: Mapping[str, Array] = {
            name: np.asarray(values, dtype=np.float64) for name, values in table.items()
        }
        where = "the table"
    else:
        columns, where = files.read(table), str(table)
    names = [vary] if isinstance(vary, str) else vary
    return fit_dimensions(subject, measured_of(columns, subject.solver, where), names, offset=offset)
