"""Planar four-bar linkage with a coupler point: its dimensions and its closed form."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.formulas import Declaration, Geometry, angle, choice, length
from mechsim.analytic.catalog.two_branch import TwoBranchForm
from mechsim.analytic.vector_method.link_frames import LinkFrame
from mechsim.analytic.vector_method.vectors import Sign, circle_sphere, column, cross, dot, spun
from mechsim.errors import AssemblyError
from mechsim.model.joints import End, Joint
from mechsim.model.links import EX, EY, EZ, GROUND, ORIGIN, Link, vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Values, cos_sin


@dataclass(frozen=True, kw_only=True)
class FourBar(TwoBranchForm):
    """Planar four-bar linkage with a coupler point.

    O-A-B-O4 lies in the XY plane, O at the origin and O4 at (ground, 0).

    The crank angle is measured from +X. The coupler point C is at distance `arm` from A, at the angle
    `arm_angle` from AB. `branch` is the sign of O4B . (O4A x eZ): +1 if B lies left of the line from A to O4.
    """

    declaration = Declaration(
        "four_bar",
        array_parameters=frozenset(("ground", "crank", "coupler", "rocker", "branch", "arm", "arm_angle")),
    )

    ground: float = length(0.100, "distance of the pivots O, O4")
    crank: float = length(0.032, "length OA")
    coupler: float = length(0.091, "length AB")
    rocker: float = length(0.074, "length O4B")
    branch: Sign = choice(1, (1, -1), "assembly: sign of O4B . (O4A x eZ)")
    arm: float = length(0.058, "distance of the coupler point C from A")
    arm_angle: float = angle(np.deg2rad(31.0), "angle from AB to AC")

    @property
    def description(self) -> Mechanism:
        geometry = self.geometry()
        joints, point = geometry.joints, vector(geometry.points["C"])
        (tip, _), (on_coupler, on_rocker), (pivot, _) = (joints[name] for name in ("A", "B", "rocker"))
        return Mechanism(
            name=self.name,
            links=(Link("crank"), Link("coupler", outline=(point,)), Link("rocker")),
            joints=(
                Joint("crank", "revolute", End(GROUND), End("crank")),
                Joint("A", "revolute", End("crank", tip), End("coupler")),
                Joint("B", "revolute", End("coupler", on_coupler), End("rocker", on_rocker)),
                Joint("rocker", "revolute", End(GROUND, pivot), End("rocker")),
            ),
            driver="crank",
            points={"A": ("crank", tip), "B": ("rocker", on_rocker), "C": ("coupler", point)},
        )

    def geometry(self) -> Geometry:
        tip, end = (self.crank, 0.0, 0.0), (self.rocker, 0.0, 0.0)
        coupler_point = (self.arm * np.cos(self.arm_angle), self.arm * np.sin(self.arm_angle), 0.0)
        return Geometry(
            points={"A": tip, "B": end, "C": coupler_point},
            joints={
                "A": (tip, ORIGIN),
                "B": ((self.coupler, 0.0, 0.0), end),
                "rocker": ((self.ground, 0.0, 0.0), ORIGIN),
            },
        )

    def discriminant(self, angles: ArrayLike) -> Array:
        """4 r2 d2 - (d2 + r2 - l2)2 for rocker r, coupler l and d = |O4A|."""
        tip = self.crank * spun(column(EX), column(EZ), np.asarray(angles))
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
        ahead = spun(column(EX), ez, angle)
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
        sign, points along (-sin(f/2), cos(f/2)), which leads through. A rhombus lies flat at f = pi, too.
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
        across, back = (spun(column(direction), column(EZ), half) for direction in (EY, (-1.0, 0.0, 0.0)))
        return along * across - self.branch * side * aside * back
