"""Dimensions fitted to measured motion by least squares, with exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.errors import InputError, MechsimError
from mechsim.io.readers import parametric_model
from mechsim.kinematics.designs import Dimension
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import Array, wrapped
from mechsim.numerics.resources import Progress, no_progress
from mechsim.studies.measured_table import MeasuredMotion, measured_of, read_measured, single
from mechsim.studies.sensitivity.moved_family import MovedFamily, family_at
from mechsim.studies.sensitivity.sensitivity import Subject, dimension_names

# relative singular value of the scaled derivatives below which it is rounding
RANK_TOLERANCE = 1e-7
# component of an undetermined direction from which a dimension counts as undetermined
MIN_COMPONENT = 0.1
# largest number of mechanisms that are solved; relative change at convergence
MAX_MECHANISMS, CONVERGENCE_TOLERANCE = 100, 1e-10

FitOutcome = Literal["fitted", "underdetermined", "not converged"]


@dataclass(frozen=True)
class Fit:
    """Dimensions that fit measured motion best.

    Attributes:
        moved: the mechanism with these dimensions, at the measured angles.
        outcome: "underdetermined" if the measurements do not determine all dimensions.
        start: dimension -> initial value, in SI.
        values: dimension -> fitted value.
        units: dimension -> its SI unit.
        deviations: dimension -> standard deviation, for determined dimensions.
        covariance: of the dimensions in their order, (p, p), for determined directions.
        together: groups of undetermined dimensions: the measurement determines one combination fewer than a
            group has dimensions.
        rms: quantity -> root mean square of the residuals, in SI.
        spread: root mean square of the weighted residuals over the redundant values. With deviations
            it is about 1 if these are correct. Without any it estimates them, relative to the mechanism's
            size and in [rad].
        weighed: whether standard deviations were given.
        free: number of measured values beyond the number of dimensions.
        condition: condition number of the scaled derivatives.
        tried: number of mechanisms solved.
    """

    JSON: ClassVar[tuple[str, ...]] = (
        *("mechanism", "outcome", "values", "deviations", "within_95", "start", "units", "covariance"),
        *("correlations", "indistinguishable=together", "rms", "spread", "weighed", "condition", "rows"),
        "tried",
    )

    moved: MovedFamily
    outcome: FitOutcome
    start: Mapping[str, float]
    values: Mapping[str, float]
    units: Mapping[str, str]
    deviations: Mapping[str, float]
    covariance: Sequence[Sequence[float]]
    together: Sequence[tuple[str, ...]]
    rms: Mapping[str, float]
    spread: float
    weighed: bool
    free: int
    condition: float
    tried: int

    __repr__ = short_repr

    def within(self, fraction: float = 0.95) -> dict[str, float]:
        """Return half the width of the confidence interval of each dimension, in SI.

        The distribution is normal if standard deviations were given, otherwise Student's t.
        """
        from scipy.stats import norm, t

        share = 0.5 * (1.0 + fraction)
        factor = norm.ppf(share) if self.weighed else t.ppf(share, self.free) if self.free > 0 else np.inf
        return {name: float(factor) * deviation for name, deviation in self.deviations.items()}

    @property
    def within_95(self) -> dict[str, float]:
        """Half the width of the 95 % interval of each determined dimension."""
        return self.within()

    @property
    def mechanism(self) -> str:
        """Name of the mechanism."""
        return self.moved.designs.name

    @property
    def rows(self) -> int:
        """Number of measured instants."""
        return len(self.moved.angles)

    @property
    def correlations(self) -> dict[str, float]:
        """Correlation of each pair "A and B" of dimensions with standard deviations."""
        names, covariance = list(self.values), np.array(self.covariance)
        scale = np.sqrt(np.diag(covariance))
        pairs = [(i, j) for i in range(len(names)) for j in range(i) if scale[i] * scale[j] > 0.0]
        return {
            f"{names[j]} and {names[i]}": float(covariance[i, j] / (scale[i] * scale[j])) for i, j in pairs
        }


def fit_dimensions(
    moved: MovedFamily,
    measured: MeasuredMotion,
    vary: Sequence[str],
    *,
    offset: bool = False,
    progress: Progress = no_progress,
) -> Fit:
    """Return the dimensions for which a mechanism moves as it was measured.

    scipy's `least_squares` (trust region) minimises the sum of squares of the residuals, relative to their
    standard deviations, with exact derivatives and from the nominal dimensions. Without standard deviations,
    lengths are scaled by the mechanism's size, angles by 1 rad, rates and forces by the largest measured
    value with the same unit.

    Args:
        moved: the mechanism, with its speed and forces; its angles are replaced by the measured ones.
        measured: the measured motion.
        vary: names of dimensions; a position stands for its components.
        offset: whether the zero of the crank's encoder is unknown too: CRANK.offset is the crank angle minus
            the measured angle.
        progress: called with a text and the finished fraction.

    Raises:
        InputError: for an unknown dimension or quantity, fewer values than dimensions, an offset without a
            crank, or an offset with forces under loads that follow its angle.
        AssemblyError: if the initial mechanism cannot be assembled at every measured instant.
    """
    from scipy.optimize import least_squares

    subject = replace(moved, angles=measured.angles)
    named = single(measured.values, subject)
    names = dimension_names(subject, vary)
    subject.designs.require_independent(names)
    if offset:
        # reject an unknown crank zero that the measurement cannot determine
        name = subject.designs.name
        if not subject.offset:
            raise InputError(
                f"{name} has no single crank without a motion law, so no crank zero; leave the offset out"
            )
        acting = subject.acting(subject.solver)
        if (acting.loads or acting.couples or acting.crank_torque) and subject.loaded(named.values()):
            raise InputError(
                f"{name}: forces under loads that follow the crank do not determine its zero; "
                "leave out the forces or the loads"
            )
        names.append(subject.offset)
    if measured.count < len(names):
        raise InputError(
            f"{measured.count} measured values do not determine {len(names)} dimensions; "
            "measure more, or vary fewer"
        )
    problem = _Problem(subject, measured, named, names, progress)
    start = np.zeros(len(names))
    problem.residuals(start)
    derivatives: Any = problem.derivatives
    options: Any = dict.fromkeys(("xtol", "ftol", "gtol"), CONVERGENCE_TOLERANCE)
    solution: Any = least_squares(
        problem.tried, start, derivatives, method="trf", max_nfev=MAX_MECHANISMS, **options
    )
    return problem.result(solution.x, solution.status > 0)


class _Problem:
    """The functions that least squares needs, with dimensions relative to their scales."""

    def __init__(
        self,
        moved: MovedFamily,
        measured: MeasuredMotion,
        named: Mapping[str, str],
        names: list[str],
        progress: Progress,
    ):
        self.moved, self.measured, self.named, self.names = moved, measured, named, names
        self.progress, self.count = progress, 0
        self.columns = [*dict.fromkeys(named.values())]
        length = moved.solver.mechanism.characteristic_length
        dimensions = {**moved.designs.dimensions, moved.offset: Dimension(moved.offset, 0.0, "rad")}
        self.start = {name: dimensions[name].value for name in names}
        self.dimension_units = {name: dimensions[name].unit for name in names}
        scales = {name: {"m": length, "1": abs(value) or 1.0} for name, value in self.start.items()}
        self.scale = np.array([own.get(self.dimension_units[name], 1.0) for name, own in scales.items()])
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
                f"{', '.join(deviations)} have standard deviations, but {column} has none; add a "
                f"column {column}±"
            )
        unit, values = self.units[column], self.measured.values
        alike = [float(np.abs(values[name]).max()) for name in values if self.units[name] == unit]
        scale = {"m": length, "rad": 1.0}.get(unit) or max(alike) or 1.0
        return np.full(len(self.measured.angles), scale)

    def dimensions(self, x: Array) -> dict[str, float]:
        """Return the dimensions of scaled variables."""
        changes = (x * self.scale).tolist()
        return {name: self.start[name] + by for name, by in zip(self.names, changes, strict=True)}

    def residuals(self, x: Array) -> Array:
        """Return the residuals relative to their standard deviations, (m,).

        Raises:
            MechsimError: for dimensions without an assembly.
        """
        self.count += 1
        self.progress(f"{self.count} mechanisms", 0.0)
        values = self.moved.values(self.columns, self.dimensions(x))
        off = {name: values[own] - self.measured.values[name] for name, own in self.named.items()}
        # multiples of a revolution are not measured
        off |= {name: wrapped(angle) for name, angle in off.items() if self.units[name] == "rad"}
        return np.concatenate([off[name] / self.weights[name] for name in self.named])

    def tried(self, x: Array) -> Array:
        """Return the residuals; infinite without an assembly, so that least squares shortens its step."""
        try:
            return self.residuals(x)
        except MechsimError:
            return np.full(self.measured.count, np.inf)

    def derivatives(self, x: Array) -> Array:
        """Return exact derivatives of the residuals, (m, p)."""
        by = self.moved.derivatives(self.columns, self.names, self.dimensions(x)).by
        columns = [
            [by[name][quantity] / self.weights[column] for name in self.names]
            for column, quantity in self.named.items()
        ]
        return np.concatenate(columns, axis=1).T * self.scale

    def result(self, x: Array, converged: bool) -> Fit:
        """Return the result of a fit."""
        residuals, derivatives = self.residuals(x), self.derivatives(x)
        _, singular, right = np.linalg.svd(derivatives, full_matrices=True)
        singular = np.pad(singular, (0, len(self.names) - len(singular)))
        determined = singular > RANK_TOLERANCE * singular[0]
        # values that cannot change, as positions normal to a planar linkage, contain no errors
        free = int(((residuals != 0.0) | derivatives.any(1)).sum()) - int(determined.sum())
        spread = float(np.sqrt((residuals**2).sum() / free)) if free > 0 else 0.0
        unit = 1.0 if self.weighed else spread
        covariance = (right[determined].T / singular[determined] ** 2) @ right[determined] * unit**2
        covariance = covariance * np.outer(self.scale, self.scale)
        together = tuple(_groups(right[~determined], self.names))
        undetermined_names = {name for group in together for name in group}
        values = self.dimensions(x)
        pieces = zip(self.weights.items(), np.split(residuals, len(self.named)), strict=True)
        rms = {column: float(np.sqrt(((own * weight) ** 2).mean())) for (column, weight), own in pieces}
        spreads = dict(zip(self.names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
        deviations = {name: own for name, own in spreads.items() if name not in undetermined_names}
        outcome: FitOutcome = "underdetermined" if together else "fitted" if converged else "not converged"
        own = {name: value for name, value in values.items() if name != self.moved.offset}
        angles = self.moved.angles + values.get(self.moved.offset, 0.0)
        return Fit(
            moved=replace(self.moved, designs=family_at(self.moved.designs, own), angles=angles),
            outcome=outcome,
            start=self.start,
            values=values,
            units=self.dimension_units,
            deviations=deviations,
            covariance=covariance.tolist(),
            together=together,
            rms=rms,
            spread=spread,
            weighed=self.weighed,
            free=free,
            condition=float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf,
            tried=self.count,
        )


def _groups(undetermined: Array, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return groups of dimensions connected by directions (d, p) along which no measured value changes."""
    from scipy.sparse.csgraph import connected_components

    involved = np.sqrt((undetermined**2).sum(0)) > MIN_COMPONENT
    joined = (np.abs(undetermined.T @ undetermined) > MIN_COMPONENT**2) & np.outer(involved, involved)
    _, labels = connected_components(joined, directed=False)
    groups = [np.flatnonzero((labels == label) & involved) for label in dict.fromkeys(labels)]
    return [tuple(names[i] for i in group.tolist()) for group in groups if len(group)]


def fit(
    model: Subject,
    table: str | Path | Mapping[str, ArrayLike],
    vary: str | Sequence[str],
    *,
    offset: bool = False,
    speed: float | str = 1.0,
    forces: Forces | None = None,
) -> Fit:
    """Return the dimensions for which a model moves as it was measured.

    Args:
        model: as for `moved`; the fit starts from its dimensions.
        table: measured motion: columns angle in [rad] (t in [s] under motion laws) and quantities with our
            names or those of `reference/` (torque:crank), in SI; a column P3.x± is the standard deviation of
            P3.x. A .csv or .npz file, or a mapping.
        vary: dimensions to fit.
        offset: whether the zero of the crank's encoder is unknown too: CRANK.offset is the crank angle minus
            the angle in the table.
        speed: crank speed in [rad/s] or text, as "600rpm"; only rates and forces depend on it.
        forces: applied forces, if forces were measured; None takes those of the file.

    Raises:
        InputError: for an invalid table, an unknown dimension, or fewer values than dimensions.
        AssemblyError: if the initial mechanism cannot be assembled at every measured instant.
    """
    subject = model
    if not isinstance(subject, MovedFamily):
        # the table has the instants
        crank_speed = units.si(speed, "rad/s", "the speed")
        subject = MovedFamily(parametric_model(subject), np.zeros(1), crank_speed, forces)
    where = "the table" if isinstance(table, Mapping) else str(table)
    columns = table if isinstance(table, Mapping) else read_measured(where)
    names = [vary] if isinstance(vary, str) else vary
    return fit_dimensions(subject, measured_of(columns, subject.solver, where), names, offset=offset)
