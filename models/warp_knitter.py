"""Two-crank six-link mechanism of a warp-knitting machine: its dimensions and its closed form."""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from typing import Any, Self

import numpy as np

from mechsim import InputError, Pose
from mechsim.formulas import (
    EX,
    EZ,
    ORIGIN,
    Arcs,
    Array,
    ClosedForm,
    LinkFrame,
    Values,
    column,
    rotate,
    values,
)
from mechsim.kinematics.vector_method import triad
from mechsim.kinematics.vector_method.triad import (
    carried,
    cross,
    determinant,
    flat,
    leg_vectors,
    moments,
    xyz,
)
from mechsim.kinematics.vector_method.triad_path import Pivots, TriadPath
from mechsim.mechanism.links import GROUND
from mechsim.numerics.jets import Jet

# largest number of teeth of a gear
MAX_TEETH = 1000
# joint -> the links it connects, the one nearer the frame first
LINKS_OF_JOINT = {
    "crank": (GROUND, "crank1"),
    "crank2": (GROUND, "crank2"),
    "A": ("crank1", "rod3"),
    "B": ("rod3", "base"),
    "D": ("crank2", "rod5"),
    "C": ("rod5", "base"),
    "K": ("base", "rocker"),
    "rocker": (GROUND, "rocker"),
}
# revolutions of crank 1 after which a gear ratio without common period counts as a full turn
MAX_REVOLUTIONS = 100

# largest gear ratio: the mode is traced revolution by revolution of crank 2, for minutes beyond this
MAX_RATIO = 1000.0


class WarpKnitter(ClosedForm):
    """Needle drive of a warp knitting machine: two geared cranks."""

    gear = "gear_ratio"

    def check(self) -> None:
        if self.gear_ratio == 0.0:
            raise InputError(
                f"{self.name}: gear_ratio is 0; give the revolutions of crank 2 per revolution of crank 1"
            )
        if not 1.0 / MAX_RATIO <= abs(self.gear_ratio) <= MAX_RATIO:
            raise InputError(
                f"{self.name}: gear_ratio is {self.gear_ratio}; "
                f"give one from 1/{MAX_RATIO:g} to {MAX_RATIO:g}, of either sign"
            )
        if self.assembly != int(self.assembly):
            raise InputError(f"{self.name}: assembly is {self.assembly}; give a whole number")
        self.values["assembly"] = self.assembly = int(self.assembly)
        count = len(self._at_zero)
        # if there is none, solving reports the dimensions
        if self.assembly < 1 or 0 < count < self.assembly:
            raise InputError(
                f"{self.name}: assembly is {self.assembly}, but at crank angle 0 there are {count}; "
                f"give a number from 1 to {max(count, 1)}"
            )

    @property
    def sides(self) -> tuple[float, float, float]:
        """Lengths of the three legs of the triad: rod 3, rod 5, rocker, in [m]."""
        return self.rod3, self.rod5, self.rocker

    @property
    def platform(self) -> tuple[complex, complex, complex]:
        """B, C, K in the frame of the base link, in [m]."""
        return 0j, complex(*self.base_c), complex(*self.base_k)

    @property
    def pivots(self) -> Pivots:
        """Motion of A, D and E with the angle of crank 1."""
        return Pivots(
            (0j, complex(*self.pivot2), complex(*self.pivot_rocker)),
            (self.crank1, self.crank2, 0.0),
            (1.0, self.gear_ratio, 0.0),
            (0.0, self.phase, 0.0),
        )

    def guess(self) -> tuple[dict[str, Pose], float]:
        """Return link poses at crank angle 0, where modes are numbered; none if it cannot be assembled."""
        return super().guess() if self._path is not None else ({}, 0.0)

    def _start(self) -> float:
        return 0.0

    def crank_range(self) -> Arcs:
        """Return the interval of crank angle that this assembly mode reaches from crank angle 0.

        If both cranks return after every revolution of crank 1, an interval shorter than a revolution starts
        in [-pi, pi), as for any mechanism. Else it contains 0: a triad may pass into another mode and reach
        its dead centre more than a revolution later. If the cranks never return together, 100 revolutions in
        either direction count as a full rotation.

        Accuracy: 1e-12 rad.
        """
        if self._path is None:
            return Arcs(False, ())
        if self._path.round() is not None:
            return Arcs(True, ((-np.pi, np.pi),))
        limit = 2.0 * np.pi * MAX_REVOLUTIONS
        low, high = self._path.end(-1, -limit), self._path.end(1, limit)
        if low is None and high is None:
            return Arcs(True, ((-np.pi, np.pi),))
        low, high = -limit if low is None else low, limit if high is None else high
        if period_of(self.gear_ratio) == 2.0 * np.pi > high - low:
            shift = 2.0 * np.pi * np.floor((low + np.pi) / (2.0 * np.pi))
            low, high = float(low - shift), float(high - shift)
        return Arcs(False, ((low, high),))

    def assemblies(self, angle: float) -> Sequence[Self]:
        """Return the mechanism in each assembly mode that leads from crank angle 0 to this one."""
        at_angle = np.array([angle])
        return [
            member
            for member in self._all_assemblies
            if member._path is not None and np.isfinite(member._path.poses(at_angle)[0][0])
        ]

    def assembly_points(self, angle: float) -> list[tuple[dict[str, int | None], dict[str, Array]]]:
        """Return every real assembly mode at a crank angle; its number is None without a path from 0."""
        numbered = [(member.assembly, member.positions([angle])) for member in self.assemblies(angle)]
        numbered_points = [(n, {name: p[0] for name, p in points.items()}) for n, points in numbered]
        longest = max(*self.sides, *(abs(point) for point in self.platform))
        listed: list[tuple[dict[str, int | None], dict[str, Array]]] = []
        for pose in self._assemblies_at(self.pivots.positions(angle)):
            points = {name: xyz(point) for name, point in self._points(angle, *pose).items()}
            gaps = [
                max(float(np.abs(points[name] - other[name]).max()) for name in points)
                for _, other in numbered_points
            ]
            nearest = int(np.argmin(gaps)) if gaps else None
            matched = nearest is not None and gaps[nearest] < 1e-6 * longest
            listed.append(
                (
                    {"assembly": numbered_points[nearest][0] if matched and nearest is not None else None},
                    points,
                )
            )
        return listed

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the triad's determinant divided by that of this assembly mode at crank angle 0, (n,).

        Its sign changes only at a dead centre. Three of six modes share it.
        """
        a, b, c, d, k = (flat(points[name]) for name in "ABCDK")
        legs = [b - a, c - d, k - complex(*self.pivot_rocker)]
        value = determinant(legs, [0.0, cross(c - b, legs[1]), cross(k - b, legs[2])])
        return value / self._nominal_determinant

    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array:
        """Return the angle between the rocker and the force on it, (n,) in [rad], 0 to pi/2.

        Rods 3 and 5 transmit only axial forces, so that the force of the base link on K points along the line
        from K to the intersection of the lines of both rods. At zero the triad locks.
        """
        a, b, c, d, k = (flat(points[name]) for name in "ABCDK")
        e3, e5 = (b - a) / self.rod3, (c - d) / self.rod5
        e6 = (k - (self.pivot_rocker[0] + 1j * self.pivot_rocker[1])) / self.rocker
        force = cross(c - k, e5) * e3 - cross(b - k, e3) * e5
        magnitude = np.maximum(abs(force), np.finfo(np.float64).tiny)
        return np.arcsin(np.minimum(abs(cross(force, e6)) / magnitude, 1.0))

    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """The base link from the triad; rods and rocker between its points and the pivots."""
        origin, direction = self._base(angle)
        a, d, e = self.pivots.positions_of(angle)
        b, c, k = (origin + direction * point for point in self.platform)
        ez = column(EZ)
        yield "crank1", LinkFrame(column(ORIGIN), x=rotate(column(EX), ez, angle), z=ez)
        driven = self.gear_ratio * angle + self.phase
        yield "crank2", LinkFrame(column((*self.pivot2, 0.0)), x=rotate(column(EX), ez, driven), z=ez)
        yield "base", LinkFrame(xyz(b), x=xyz(direction), z=ez)
        yield "rod3", LinkFrame(xyz(a), x=xyz((b - a) / self.rod3), z=ez)
        yield "rod5", LinkFrame(xyz(d), x=xyz((c - d) / self.rod5), z=ez)
        yield "rocker", LinkFrame(column((*self.pivot_rocker, 0.0)), x=xyz((k - e) / self.rocker), z=ez)

    def _base(self, angle: Values) -> tuple[Any, Any]:
        """Return position and orientation of the base link as complex numbers, (n,) each."""
        angles = values(angle)
        if self._path is None:
            return np.full(angles.shape, np.nan + 0j), np.full(angles.shape, np.nan + 0j)
        origin, direction = self._path.poses(angles)
        if not isinstance(angle, Jet):
            return origin, direction
        return carried(origin, direction, self.pivots.positions_of(angle), self.platform)

    def _points(self, angle: float, origin: complex, direction: complex) -> dict[str, complex]:
        """Return A, B, C, D, K at one crank angle for a pose of the base link."""
        a, d, _ = self.pivots.positions(angle)
        b, c, k = (origin + direction * point for point in self.platform)
        return dict(zip("ABCDK", (a, b, c, d, k), strict=True))

    def _assemblies_at(self, pivots: list[complex]) -> list[tuple[complex, complex]]:
        """Return position and orientation of the base link in every assembly mode, by increasing angle."""
        moved, fixed = ([(z.real, z.imag) for z in points] for points in (pivots, self.platform))
        poses = triad.triad_modes(moved, fixed, self.sides)
        return [(complex(x, y), complex(np.exp(1j * t))) for x, y, t in poses[np.isfinite(poses[:, 2])]]

    @cached_property
    def _at_zero(self) -> list[tuple[complex, complex]]:
        return self._assemblies_at(self.pivots.positions(0.0))

    @cached_property
    def _all_assemblies(self) -> list[Self]:
        """This mechanism in every assembly mode at crank angle 0, cached with their paths."""
        numbers = range(1, 1 + len(self._at_zero))
        return [self if n == self.assembly else self.with_parameters(assembly=n) for n in numbers]

    @cached_property
    def _path(self) -> TriadPath | None:
        if not self._at_zero:
            return None
        period = period_of(self.gear_ratio)
        return TriadPath(self.pivots, self.platform, self.sides, self._at_zero[self.assembly - 1], period)

    @cached_property
    def _nominal_determinant(self) -> float:
        origin, direction = self._at_zero[self.assembly - 1] if self._at_zero else (0j, 1.0 + 0j)
        vectors = leg_vectors(origin, direction, self.pivots.positions(0.0), self.platform)
        return determinant(vectors, moments(vectors, direction, self.platform))


def period_of(ratio: float) -> float | None:
    """Return the crank angle in [rad] after which both cranks repeat; None if there is none."""
    teeth = Fraction(ratio).limit_denominator(MAX_TEETH)
    if abs(float(teeth) - ratio) > 4.0 * np.finfo(np.float64).eps * abs(ratio):
        return None
    return 2.0 * np.pi * teeth.denominator
