"""RRSRR: spatial five-link crank-rocker, its dimensions and its closed form."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim import AssemblyError, Motion, Pose
from mechsim.formulas import (
    EX,
    EY,
    ORIGIN,
    Array,
    LinkFrame,
    TwoBranchForm,
    Values,
    circle_sphere,
    column,
    cross,
    dot,
    norm,
    rotate,
    rotation,
    rotation_product,
    values,
    with_value,
)

# cosine of v2 below which the rocker angle counts as undetermined: its acceleration grows as 1/cos2, and a
# third of the digits are lost already
POLE = 1e-6


class Rrsrr(TwoBranchForm):
    """Spatial five-bar: four revolute joints and one ball joint."""

    array_parameters = frozenset(("crank", "coupler", "link", "pivot", "gamma1", "gamma2", "branch"))

    @cached_property
    def rocker_frame(self) -> Array:
        """Frame at P02 whose third column is the rocker axis, (3, 3); T2 of paper 002."""
        return rotation_product(rotation("y", self.gamma1), rotation("x", self.gamma2))

    def discriminant(self, angles: ArrayLike) -> Array:
        """A2 + B2 - K2 of the closed form A cos v1 + B sin v1 = K."""
        f, (x, y, z) = np.asarray(angles), self.pivot
        ahead = self.crank - (y * np.cos(f) + z * np.sin(f))  # P02C . er
        distance2 = self.crank * (2.0 * ahead - self.crank) + x * x + y * y + z * z
        k = (self.link - self.coupler) * (self.link + self.coupler) - distance2
        return 4.0 * self.coupler**2 * (ahead**2 + x * x) - k**2

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        radial = points["C"] / self.crank
        to_c, rod = points["C"] - np.asarray(self.pivot), points["S"] - points["C"]
        a, along = (to_c * radial).sum(-1), (rod * radial).sum(-1)
        return self.branch * (a * rod[:, 0] - to_c[:, 0] * along)

    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array:
        """Return the angle between the force at S and the link's own direction, (n,) in [rad], 0 to pi/2.

        Hinges transmit no moment about their axes, so that the force at S is perpendicular to both free
        motions of S, with the coupler about C and with the link about its hinge. It lies in the plane of the
        link's direction, which does not move the rocker, and the direction in which the rocker moves S.
        """
        c, s = points["C"].T, points["S"].T
        tangent = cross(cross(c, column(EX)), s - c) / (self.crank * self.coupler)
        arm = (s - column(self.pivot)) / self.link
        push = cross(column(self.rocker_frame[:, 2]), arm)
        lever = norm(push)
        angle = np.arctan2(np.abs(dot(arm, tangent)), np.abs(dot(push, tangent)) / lever)
        return np.where(lever >= POLE, angle, np.nan)

    def transmission_angle(self, angles: ArrayLike) -> Array:
        angle = super().transmission_angle(angles)
        self._require_off_pole(np.atleast_1d(np.asarray(angles)), np.isfinite(angle))
        return angle

    def guess(self) -> tuple[dict[str, Pose], float]:
        poses, start = super().guess()
        if self.discriminant(start) >= 0.0:
            self._require_off_pole(np.array([start]), np.isfinite(poses["rocker"].rotation[:1, 0]))
        return poses, start

    def _require_off_pole(self, angles: Array, outside: NDArray[np.bool_]) -> None:
        if not outside.all():
            raise AssemblyError(
                f"{self.name}: at crank angle {angles[np.argmin(outside)]:.6g} rad S lies on the rocker "
                "axis, where the rocker angle is undetermined; rotate the axis by gamma1 or gamma2"
            )

    def check_finite(self, motion: Motion) -> None:
        if "rocker" in motion.links:
            stands = np.isfinite(motion.points["S"].acceleration[:, 0])
            finite = np.isfinite(motion.links["rocker"].rotation[:, 0, 0])
            self._require_off_pole(motion.angle, finite | ~stands)
        super().check_finite(motion)

    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """S lies on the coupler's circle about C and on the sphere about P02; link and rocker point at it."""
        origin, ex, pivot = column(ORIGIN), column(EX), column(self.pivot)
        radial = rotate(column(EY), ex, angle)  # er of papers.md
        hinge = cross(radial, ex)  # axis at C, about which v1 increases from er to ex
        c = self.crank * radial
        across = self.across(angle)
        rod = self.coupler * circle_sphere(c, hinge, self.coupler, pivot, self.link, self.branch, across)
        if across is None:
            rod = _determined(rod, cross(hinge, rod), c + rod - pivot, self.link)
        yield "crank", LinkFrame(origin, x=ex, y=radial)
        yield "coupler", LinkFrame(c, x=rod / self.coupler, z=hinge)
        axis, arm = column(self.rocker_frame[:, 2]), c + rod - pivot
        flat = arm - dot(arm, axis) * axis
        reach = norm(flat)
        reach_value = values(reach)
        ahead = flat / with_value(reach, np.where(reach_value >= POLE * self.link, reach_value, np.nan))
        yield "link", LinkFrame(pivot, x=arm / self.link, z=cross(ahead, axis))
        yield "rocker", LinkFrame(pivot, x=ahead, z=axis)


def _determined(rod: Values, swing: Values, arm: Values, link: float) -> Any:
    """Return rod vectors rotated by a few ulp so that |arm| is the length of the link.

    Otherwise the rounding of squares of longer links would exceed the loop-closure error of a short link.
    """
    gap = (norm(arm) - link) * link / dot(arm, swing)
    # a rotation above 1e-8 means a dead centre, where the error is rounding of another order
    gap_value = values(gap)
    return rod - with_value(gap, np.where(np.abs(gap_value) < 1e-8, gap_value, 0.0)) * swing
