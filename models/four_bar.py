"""Planar four-bar linkage with a coupler point: its dimensions and its closed form."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim import AssemblyError
from mechsim.formulas import (
    EX,
    EY,
    EZ,
    ORIGIN,
    Array,
    LinkFrame,
    TwoBranchForm,
    Values,
    circle_sphere,
    column,
    cos_sin,
    cross,
    dot,
    rotate,
)


class FourBar(TwoBranchForm):
    """Planar four-bar linkage with a coupler point."""

    array_parameters = frozenset(("ground", "crank", "coupler", "rocker", "branch", "arm", "arm_angle"))

    def discriminant(self, angles: ArrayLike) -> Array:
        """4 r2 d2 - (d2 + r2 - l2)2 for rocker r, coupler l and d = |O4A|."""
        tip = self.crank * rotate(column(EX), column(EZ), np.asarray(angles))
        to_crank = tip - column((self.ground, 0.0, 0.0))
        reach2 = dot(to_crank, to_crank)
        return 4.0 * self.rocker**2 * reach2 - (reach2 + self.rocker**2 - self.coupler**2) ** 2

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        pivot = np.array([self.ground, 0.0, 0.0])
        normal = np.cross(points["A"] - pivot, np.asarray(EZ))
        return self.branch * ((points["B"] - pivot) * normal).sum(-1)

    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array:
        a, b = points["A"].T, points["B"].T
        arm = (b - column((self.ground, 0.0, 0.0))) / self.rocker
        return np.arcsin(np.minimum(np.abs(cross((b - a) / self.coupler, arm)[2]), 1.0))

    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """B lies on the rocker's circle about O4 and on the sphere about A."""
        ez, pivot = column(EZ), column((self.ground, 0.0, 0.0))
        ahead = rotate(column(EX), ez, angle)
        a = self.crank * ahead
        if np.all(self.ground == self.crank) and np.all(self.coupler == self.rocker):
            swing = self._kite_rocker(angle)
        else:
            swing = circle_sphere(pivot, ez, self.rocker, a, self.coupler, self.branch, self.across(angle))
        b = pivot + self.rocker * swing
        yield "crank", LinkFrame(column(ORIGIN), x=ahead, z=ez)
        yield "coupler", LinkFrame(a, x=(b - a) / self.coupler, z=ez)
        yield "rocker", LinkFrame(pivot, x=swing, z=ez)

    def _kite_rocker(self, angle: Values) -> Any:
        """Return the rocker's direction in a kite whose crank is as long as its frame, (3, n).

        At the change point A lies on O4, and coupler and rocker coincide. O4A, of signed length 2 r sin(f/2),
        points along (-sin(f/2), cos(f/2)), which is continuous there. A rhombus also lies flat at f = pi.
        """
        if self.change_point == "branch":
            raise AssemblyError(
                f"four_bar: crank and ground are {self.crank} m, coupler and rocker {self.rocker} m: where A "
                "lies on O4 no assembly mode leads into another; use change_point=smooth"
            )
        half = 0.5 * self.within_range(angle)
        cosine, sine = cos_sin(half)
        rhombus = self.crank == self.rocker
        along = self.crank / self.rocker * sine
        aside = cosine if rhombus else np.sqrt(1.0 - along * along)
        begin = 0.5 * self._start_angle
        side = float(np.sign(np.sin(begin) * (np.cos(begin) if rhombus else 1.0)))
        across, back = (rotate(column(direction), column(EZ), half) for direction in (EY, (-1.0, 0.0, 0.0)))
        return along * across - self.branch * side * aside * back
