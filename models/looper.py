"""Looper drive: spatial five-link with a cylindrical pair, its dimensions and its closed form."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim import InputError
from mechsim.formulas import (
    EX,
    EZ,
    ORIGIN,
    Arcs,
    Array,
    ClosedForm,
    LinkFrame,
    Values,
    circle_sphere,
    column,
    cos_sin,
    cross,
    dot,
    norm,
    rotate,
    values,
)
from mechsim.kinematics.vector_method import trig_quartic
from mechsim.kinematics.vector_method.root_branches import Sheet, sheets
from mechsim.kinematics.vector_method.trig_polynomial import reachable_arcs, sampled_polynomial
from mechsim.numerics.arrays import REVOLUTION, shifted_into
from mechsim.numerics.jets import Jet, jet_root

Side = int
# in nine hundred random linkages at most five roots had the same sign
SIDES = tuple(sign * count for count in range(1, 9) for sign in (1, -1))


class _Planar(NamedTuple):
    """The planar four-bar: A, unit vectors along crank, O2B and AB, and perpendicular to AB, (3, n) each."""

    a: Any
    crank: Any
    swing: Any
    ahead: Any
    across: Any


@dataclass(frozen=True)
class PlanarLoop:
    """The planar four-bar O1ABO2, and C with the coupler in its plane; fields may be (n,).

    Attributes:
        crank: length O1A in [m].
        coupler: length AB in [m].
        rocker: length O2B in [m].
        pivot: O2, (3, 1) in [m].
        branch: sign of O2B . (O2A x eZ).
        along: coordinate of C along AB from A, in [m].
        across: coordinate of C perpendicular to AB, in [m].
    """

    crank: Any
    coupler: Any
    rocker: Any
    pivot: Array
    branch: Any
    along: Any
    across: Any

    def crank_range(self) -> Arcs:
        """Return the intervals of crank angle in which the four-bar O1ABO2 closes, split at change points."""
        whole = reachable_arcs(sampled_polynomial(self.discriminant, 2))
        cuts = np.array(self.change_points())
        if not len(cuts):
            return whole
        arcs: list[tuple[float, float]] = []
        for low, high in ((cuts[0], cuts[0] + REVOLUTION),) if whole.full else whole.arcs:
            inside = np.sort(cuts + REVOLUTION * np.ceil((low - cuts) / REVOLUTION))
            ends = np.unique([low, *inside[inside < high], high])
            arcs += [(float(a), float(b)) for a, b in pairwise(ends)]
        return Arcs(False, tuple(arcs))

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles at which the four-bar lies flat, in [-pi, pi) rad."""
        return sampled_polynomial(self.discriminant, 2).touching

    def point(self, angles: ArrayLike) -> Array:
        """Return C with the coupler in the plane XY, (n, 3) in [m]; NaN where the four-bar does not close.

        Source: paper 004, eqs (4), (5).
        """
        flat = self.directions(np.atleast_1d(np.asarray(angles, dtype=np.float64)))
        return (flat.a + self.along * flat.ahead + self.across * flat.across).T

    def discriminant(self, angles: Array) -> Array:
        """4 c2 e2 - (e2 + c2 - b2)2 for rocker c, coupler b and e = |O2A|."""
        to_crank = self.crank * rotate(column(EX), column(EZ), angles) - self.pivot
        reach2 = dot(to_crank, to_crank)
        return 4.0 * self.rocker**2 * reach2 - (reach2 + self.rocker**2 - self.coupler**2) ** 2

    def directions(self, angle: Values) -> _Planar:
        """Return A and the directions of crank, rocker and coupler at crank angles (n,) in [rad]."""
        ez = column(EZ)
        crank = rotate(column(EX), ez, angle)
        a = self.crank * crank
        swing = circle_sphere(self.pivot, ez, self.rocker, a, self.coupler, self.branch)
        rod = self.pivot + self.rocker * swing - a
        # normalise, so that the relative error of a short coupler is not amplified by a long arm
        ahead = rod / norm(rod)
        return _Planar(a, crank, swing, ahead, cross(ez, ahead))


class Looper(ClosedForm):
    """Looper drive of a sewing machine: a spatial five-bar."""

    array_parameters = frozenset(
        ("crank", "coupler", "arm", "arm_angle", "rocker", "frame", "follower", "axis_y", "axis_z")
    )

    def check(self) -> None:
        if not abs(np.sin(self.arm_angle)) > 1e-6:
            raise InputError(
                f"looper: arm_angle is {self.arm_angle} rad, which puts C on the line AB, where it cannot "
                "turn about it; give an angle that is no multiple of pi"
            )

    @cached_property
    def pivot(self) -> Array:
        """The rocker's pivot O2, (3, 1) in [m]."""
        return self.frame * column((np.cos(self.frame_angle), np.sin(self.frame_angle), 0.0))

    @cached_property
    def plane(self) -> PlanarLoop:
        """The planar four-bar O1ABO2, and C in the frame of its coupler."""
        along, across = self.arm * np.cos(self.arm_angle), self.arm * np.sin(self.arm_angle)
        return PlanarLoop(self.crank, self.coupler, self.rocker, self.pivot, self.branch, along, across)

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles at which the four-bar lies flat, in [-pi, pi) rad; they bound the range.

        The closed form keeps the sign of its branch, while a real looper continues with the other sign.
        """
        return self.plane.change_points()

    def planar_point(self, angles: ArrayLike) -> Array:
        """Return C with the coupler in the plane XY, (n, 3) in [m]; NaN where the loop cannot close."""
        return self.plane.point(angles)

    def crank_range(self) -> Arcs:
        sheet = self._sheet
        return sheet[0].arcs(sheet[1]) if sheet else Arcs(False, ())

    def assemblies(self, angle: float) -> list[Self]:
        angles = np.array([angle])
        return [
            assembly
            for assembly, sheet, layer in self._all_assemblies
            if not np.isnan(sheet.unrolled(angles, layer)[0])
        ]

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the smaller of the two sines with the signs `branch` and `side`, (n,).

        It does not distinguish several roots with the same sign (side 2 and 3) from the first.
        """
        to_a, to_b = (points[name] - self.pivot[:, 0] for name in "AB")
        planar = (to_b * np.cross(to_a, np.asarray(EZ))).sum(-1) / (self.rocker * np.sqrt((to_a**2).sum(-1)))
        ab, ac = points["B"] - points["A"], points["C"] - points["A"]
        swept = abs(self.coupler * self.arm * np.sin(self.arm_angle) * self.follower)
        spatial = ((points["C"] - points["D"]) * np.cross(ab, ac)).sum(-1) / swept
        return np.minimum(self.branch * planar, np.sign(self.side) * spatial)

    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array:
        """Return the smaller of two angles, (n,) in [rad]: coupler AB to rocker, and circle of C to cylinder.

        The first is that of the four-bar. The second is zero if C, rotating about AB, moves along the
        cylinder, so that the follower no longer constrains the coupler.
        """
        a, b, c, d = (points[name].T for name in "ABCD")
        planar = np.abs(cross(b - a, (b - self.pivot) / self.rocker)[2]) / self.coupler
        turning = cross(b - a, c - a) / abs(self.coupler * self.arm * np.sin(self.arm_angle))
        spatial = np.abs(dot(turning, c - d)) / self.follower
        return np.arcsin(np.minimum(np.minimum(planar, spatial), 1.0))

    @cached_property
    def _sheets(self) -> list[tuple[Sheet, int]]:
        """Every root with the sign of `side`, in order: its sheet and layer."""
        sign = 1 if self.side > 0 else -1
        with np.errstate(invalid="ignore", divide="ignore"):
            listed = sheets(
                lambda angles: _stacked(self._cylinder(self.plane.directions(angles))),
                self.plane.crank_range(),
                sign,
            )
        layers = range(max((sheet.layers for sheet in listed), default=0))
        return [(sheet, layer) for layer in layers for sheet in listed if layer < sheet.layers]

    @cached_property
    def _all_assemblies(self) -> list[tuple[Self, Sheet, int]]:
        """This mechanism in every assembly mode, with its sheet and layer; slow, therefore cached."""
        members: list[tuple[Self, Sheet, int]] = []
        for branch in (1, -1):
            for sign in (1, -1):
                first = self.with_parameters(branch=branch, side=sign)
                for count, (sheet, layer) in enumerate(first._sheets, 1):
                    member = first.with_parameters(side=sign * count)
                    # all roots of one sign share the sheets
                    vars(member)["_sheets"] = first._sheets
                    members.append((member, sheet, layer))
        return members

    @property
    def _sheet(self) -> tuple[Sheet, int] | None:
        number = abs(self.side) - 1
        return self._sheets[number] if number < len(self._sheets) else None

    def _cylinder(self, flat: _Planar) -> trig_quartic.Coefficients:
        """Return (y_C - q)2 + (z_C - p)2 - f2 as a polynomial of the cone angle.

        Source: paper 004, eqs (2): with the cone angle t, y_C = y0 + r cos t and z_C = R sin t.
        """
        height = flat.a[1] + self.plane.along * flat.ahead[1] - self.axis_y
        flank, out, depth = self.plane.across * flat.across[1], self.plane.across, self.axis_z
        # (r2 - R2)/2 from the slant of the coupler, which avoids a difference of squares
        second = -0.5 * (out * flat.ahead[1]) ** 2
        mean = height**2 + 0.5 * (flank**2 + out**2) + (depth - self.follower) * (depth + self.follower)
        return mean, 2.0 * height * flank, -2.0 * depth * out, second, 0.0

    def _cone_angle(self, angle: Values, flat: _Planar) -> Values:
        """Return the root on the selected sheet at each crank angle, (n,) in [rad]; NaN off the sheet."""
        coefficients = self._cylinder(flat)
        at_rest = _stacked(coefficients)
        root_angle = self._root_on_sheet(values(angle), at_rest)
        if not isinstance(angle, Jet):
            return root_angle
        return jet_root(
            lambda t: trig_quartic.polynomial_value(coefficients, t),
            root_angle,
            trig_quartic.derivative(at_rest, root_angle),
        )

    def _root_on_sheet(self, angles: Array, coefficients: Array) -> Array:
        if self._sheet is None:
            return np.full_like(angles, np.nan)
        sheet, layer = self._sheet
        roots = trig_quartic.real_roots(coefficients)
        fits = np.sign(self.side) * trig_quartic.derivative(coefficients, roots) > 0.0
        unrolled = sheet.unrolled(_within(angles, self.crank_range()), layer)
        away = np.abs(np.mod(roots - sheet.guide(unrolled) + np.pi, 2.0 * np.pi) - np.pi)
        best = np.argmin(np.where(fits, away, np.inf), 0)
        columns = np.arange(len(angles))
        valid = fits[best, columns] & ~np.isnan(away[best, columns])
        return np.where(valid, roots[best, columns], np.nan)

    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """The planar four-bar, then C on its circle about AB, rotated by the cone angle from the plane."""
        flat = self.plane.directions(angle)
        return self._posed(flat, self._cone_angle(angle, flat))

    def start_frames(self, count: int) -> Iterator[tuple[str, LinkFrame]] | None:
        """Return frames of designs at crank angle 0; NaN if several roots have the sign.

        None for a further root, whose number depends on the whole revolution.
        """
        if abs(self.side) != 1:
            return None
        flat = self.plane.directions(np.zeros(count))
        coefficients = _stacked(self._cylinder(flat))
        roots = trig_quartic.real_roots(coefficients)
        fits = np.sign(self.side) * trig_quartic.derivative(coefficients, roots) > 0.0
        alone = np.where(fits, roots, 0.0).sum(0)
        return self._posed(flat, np.where(fits.sum(0) == 1, alone, np.nan))

    def _posed(self, flat: _Planar, cone_angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        c, s = cos_sin(cone_angle)
        ex, ez = column(EX), column(EZ)
        coupler = LinkFrame(flat.a, x=flat.ahead, y=c * flat.across + s * ez)
        yield "crank", LinkFrame(column(ORIGIN), x=flat.crank, z=ez)
        yield "coupler", coupler
        yield "rocker", LinkFrame(self.pivot, x=flat.swing, z=ez)
        tip = coupler.point((self.plane.along, self.plane.across, 0.0))
        foot = tip[0] * ex + column((0.0, self.axis_y, self.axis_z))
        yield "follower", LinkFrame(foot, x=ex, y=(tip - foot) / self.follower)


def _stacked(coefficients: trig_quartic.Coefficients) -> Array:
    """Return the coefficients without derivatives, (5, n)."""
    rest = (
        values(coefficient) if isinstance(coefficient, Jet) else coefficient for coefficient in coefficients
    )
    return np.stack(np.broadcast_arrays(*rest))


def _direction(angle: float) -> tuple[float, float, float]:
    return float(np.cos(angle)), float(np.sin(angle)), 0.0


def _within(angles: Array, arcs: Arcs) -> Array:
    """Return the crank angles of a motion shifted into a range above one revolution, (n,); NaN outside."""
    if arcs.full or not arcs.arcs or np.ptp(arcs.arcs[0]) <= REVOLUTION:
        return angles
    low, high = arcs.arcs[0]
    shifted = shifted_into(angles, (low, high), arcs.start())
    return np.where((shifted >= low) & (shifted <= high), shifted, np.nan)
