"""Mechanisms with two assembly modes."""

import copy
from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.kinematics.formulas.closed_form import ClosedForm
from mechsim.kinematics.formulas.parameters import FormulaParameter
from mechsim.kinematics.path_instants import crank_angles
from mechsim.kinematics.vector_method import trig_polynomial
from mechsim.kinematics.vector_method.trig_polynomial import SignedRoot, TrigPolynomial, reachable_arcs
from mechsim.kinematics.vector_method.vectors import Sign
from mechsim.mechanism.motion import ChangePointPolicy
from mechsim.mechanism.motion_laws import Arcs, interval_around
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.jets import Values, values

# smallest discriminant at a start, relative to the largest: nearer to a dead centre the modes coincide
MIN_START_DISCRIMINANT = 1e-3
# crank angles within this of a change point, in [rad], are that change point
AT_POINT = 1e-9
# distance in [rad] from a change point to the configuration that counts as right after it
AFTER_POINT = 1e-6


def first_sign_angle(angles: Array, change_points: Sequence[float], direction: float) -> float:
    """Return the crank angle at which the sign applies: the first one, or right after it at a change point.

    Args:
        angles: crank angles in the order of the motion, (n,) in [rad].
        change_points: in [rad], of any revolution.
        direction: sign of the crank's motion if all angles are equal.
    """
    first = float(angles[0])
    distance = first - np.asarray(change_points)
    if np.abs(distance - REVOLUTION * np.round(distance / REVOLUTION)).min() > AT_POINT:
        return first
    displacement = angles - first
    moved = displacement[np.abs(displacement) > AT_POINT]
    ahead = float(moved[0]) if len(moved) else direction
    return first + (-AFTER_POINT if ahead < 0.0 else AFTER_POINT)


def segment(
    angle: float, change_points: Sequence[float], arc: tuple[float, float] | None
) -> tuple[float, float]:
    """Return the interval of crank angles around an angle that is free of change points, in [rad].

    Args:
        angle: in [rad], no change point.
        change_points: in [rad], of any revolution.
        arc: reachable interval that bounds it; None for a crank that rotates fully.
    """
    points = np.asarray(change_points)
    below = points + REVOLUTION * np.floor((angle - points) / REVOLUTION)
    low, high = float(below.max()), float((below + REVOLUTION).min())
    return (low, high) if arc is None else (max(low, arc[0]), min(high, arc[1]))


# parameter that each mechanism with two assembly modes has in addition
CHANGE_POINT = FormulaParameter(
    "change_point", "smooth", "1", "policy at change points", ("smooth", "branch")
)


class TwoBranchForm(ClosedForm):
    """Formulas of a mechanism with two assembly modes, selected by the parameter `branch`.

    A subclass defines `discriminant`, whose sign changes are the dead centres.

    Attributes:
        branch: +1 or -1, a parameter of each such mechanism.
        discriminant_degree: degree of the discriminant.
    """

    branch: Sign
    discriminant_degree: int = 2

    @abstractmethod
    def discriminant(self, angles: ArrayLike) -> Array:
        """Return the discriminant at crank angles, (n,): zero at a dead centre, negative without a solution.

        It is a trigonometric polynomial of the crank angle, of degree `discriminant_degree`, so
        that its roots, the dead centres, are exact.
        """

    def crank_range(self) -> Arcs:
        return self._arcs

    def change_points(self) -> tuple[float, ...]:
        return self._root.touching

    @property
    def period(self) -> float:
        return (
            2.0 * REVOLUTION
            if len(self.change_points()) % 2 and self.change_point == "smooth"
            else REVOLUTION
        )

    def with_change_point(self, change_point: ChangePointPolicy | None) -> Self:
        if change_point in (None, self.change_point):
            return self
        made = self.with_parameters(change_point=change_point)
        if self._keeps_assembly:
            vars(made).update(_keeps_assembly=True, _start_angle=self._start_angle)
        return made

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> Self:
        angles = crank_angles(self.name, angles)
        if self._keeps_assembly or not self._root.touching:
            return self
        sign_angle = first_sign_angle(self.within_range(angles), self._root.touching, direction)
        made = copy.copy(self)
        vars(made)["_keeps_assembly"] = True
        vars(made).pop("_all_assemblies", None)
        if self._root.sign(sign_angle) != self._root.sign(self._start_angle):
            vars(made).pop("mechanism", None)
            vars(made)["_start_angle"] = self._clear_angle(sign_angle)
        return made

    def across(self, angle: Values) -> Any:
        """Return the square root of the discriminant, continued at change points by the policy, (n,).

        At the first configuration (see `starting_at`) it has the sign of `branch`. None without change
        points, where the sign never changes.
        """
        if not self._root.touching:
            return None
        angle = self.within_range(angle)
        if self.change_point == "branch":
            return self.branch * self._root.folded(angle)
        return self.branch * self._root.sign(self._start_angle) * self._root.over(angle)

    def within_range(self, angle: Values) -> Any:
        """Return crank angles within the revolution of the range, (n,)."""
        if self._arcs.full or not self._arcs.arcs:
            return angle
        return angle - REVOLUTION * np.floor((values(angle) - self._arcs.arcs[0][0]) / REVOLUTION)

    @cached_property
    def _polynomial(self) -> TrigPolynomial:
        return trig_polynomial.sampled_polynomial(self.discriminant, self.discriminant_degree)

    @cached_property
    def _arcs(self) -> Arcs:
        return reachable_arcs(self._polynomial)

    @cached_property
    def _root(self) -> SignedRoot:
        return trig_polynomial.signed_root(self._polynomial)

    @cached_property
    def _keeps_assembly(self) -> bool:
        """Whether the first crank angle is known, so that later ones do not change the assembly mode."""
        return False

    def _start(self) -> float:
        start, arcs = super()._start(), self.crank_range()
        if self._root.touching:
            return self._clear_angle(first_sign_angle(np.array([start]), self._root.touching, 1.0))
        return self._separated(start, arcs.arcs)

    def _clear_angle(self, angle: float) -> float:
        """Return a crank angle in [rad] with well separated assembly modes and no change point in between."""
        full, turns = self._arcs.full, round(self.period / REVOLUTION)
        angle -= turns * REVOLUTION * np.round(angle / (turns * REVOLUTION)) if full else 0.0
        arc = segment(angle, self._root.touching, None if full else interval_around(self._arcs, angle))
        return self._separated(angle, [arc])

    def _separated(self, angle: float, arcs: Sequence[tuple[float, float]]) -> float:
        """Return a crank angle, or another one in arcs if the assembly modes nearly coincide there, in [rad].

        Near a dead centre no guess distinguishes them.
        """
        spread = np.concatenate([[angle], *(np.linspace(low, high, 25) for low, high in arcs)])
        discriminants = self.discriminant(spread)
        distinct = discriminants[0] > MIN_START_DISCRIMINANT * discriminants.max()
        return angle if distinct else float(spread[np.argmax(discriminants)])

    def assemblies(self, angle: float) -> Sequence[Self]:
        discriminant = (
            self._root.rest.value(angle) if self._root.touching else self.discriminant(np.array([angle]))[0]
        )
        if not discriminant >= 0.0:
            return []
        return self._all_assemblies

    @cached_property
    def _all_assemblies(self) -> list[Self]:
        """This mechanism in both assembly modes, cached with their dead centres."""
        own = None if self._keeps_assembly else self.branch
        return [self if branch == own else self.with_parameters(branch=branch) for branch in (1, -1)]
