"""Bennett linkage: four skew revolutes with one degree of freedom due to special dimensions."""

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np

from mechsim import End, InputError
from mechsim.formulas import (
    EX,
    EZ,
    ORIGIN,
    Array,
    ClosedForm,
    LinkFrame,
    Values,
    column,
    cos_sin,
    cross,
    rotate,
)

# largest ratio of the half-angle tangents; beyond it the rocker moves almost in jumps
MAX_RATIO = 1e6


class Bennett(ClosedForm):
    """Bennett linkage: an overconstrained spatial four-bar."""

    def check(self) -> None:
        for name in ("twist0", "twist1"):
            twist = getattr(self, name)
            if not 1e-6 < abs(twist) < np.pi - 1e-6:
                raise InputError(
                    f"{self.name}: {name} is {twist} rad; give one between 0 and pi, or 0 and -pi"
                )
        if self.twist0 * self.twist1 < 0.0:
            raise InputError(
                f"{self.name}: twist0 is {self.twist0} rad and twist1 {self.twist1} rad; give both one sign"
            )
        if not 1.0 / MAX_RATIO < abs(self.ratio) < MAX_RATIO:
            raise InputError(
                f"{self.name}: twist0 and twist1 are both {self.twist0} rad, a chain that folds flat; "
                "give two different twists"
            )

    @cached_property
    def length1(self) -> float:
        """Length of crank and rocker in [m]: Bennett's condition."""
        return float(self.length0 * np.sin(self.twist1) / np.sin(self.twist0))

    @cached_property
    def ratio(self) -> float:
        """tan(rocker / 2) / tan(crank / 2) = sin((twist1 + twist0)/2) / sin((twist1 - twist0)/2)."""
        with np.errstate(divide="ignore"):
            return np.sin(0.5 * (self.twist1 + self.twist0)) / np.sin(0.5 * (self.twist1 - self.twist0))

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Zero if the linkage lies flat along X, and everywhere if twist1 is a right angle."""
        pivot = np.array([self.length0, 0.0, 0.0])
        normal = np.cross(points["A"] - pivot, self._rocker_axis)
        side = ((points["B"] - pivot) * normal).sum(-1)
        return -float(np.cos(self.twist1)) * side * points["A"][:, 1]

    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array:
        """Return the angle whose sine is the ratio of the lower to the higher speed of crank and rocker.

        The hinges of the coupler transmit moments, too, so that the angle of the coupler alone is not
            sufficient: a
        Bennett linkage moves on if A, B and both pivots lie in a line.
        """
        half = 0.5 * angles
        speed = np.abs(self.ratio) / (np.cos(half) ** 2 + (self.ratio * np.sin(half)) ** 2)
        return np.arcsin(np.minimum(speed, 1.0 / speed))

    @cached_property
    def _rocker_axis(self) -> Array:
        return np.array([0.0, -np.sin(self.twist0), np.cos(self.twist0)])

    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """tan(u/2) = r tan(f/2): f crank angle, u rocker angle from X and coupler angle from the crank.

        With B on the rocker's circle, |AB| = length0 is, in the half-angle tangents t and w,
        (length1 - length0) w2 - 2 length1 cos(twist0) t w + (length0 + length1) t2 = 0. Under Bennett's
        condition these are two straight lines w = r t; the axes at B select one of them.
        """
        ex, ez, pivot = column(EX), column(EZ), column((self.length0, 0.0, 0.0))
        axis = column(self._rocker_axis)
        c, s = cos_sin(0.5 * angle)
        s = self.ratio * s
        spread = c * c + s * s
        cosine, sine = (c - s) * (c + s) / spread, 2.0 * s * c / spread  # of the rocker angle
        radial = rotate(ex, ez, angle)
        crank = LinkFrame(column(ORIGIN), x=radial, z=ez)
        yield "crank", crank
        yield "rocker", LinkFrame(pivot, x=cosine * ex + sine * cross(axis, ex), z=axis)
        hinge = crank.direction((0.0, -float(np.sin(self.twist1)), float(np.cos(self.twist1))))
        ahead = cosine * radial + sine * cross(hinge, radial)
        yield "coupler", LinkFrame(crank.point((self.length1, 0.0, 0.0)), x=ahead, z=hinge)


def _far_end(link: str, reach: float, twist: float) -> End:
    """Return the far end of a link: along its x axis, with its axis rotated about x by the twist."""
    axis = (0.0, -float(np.sin(twist)), float(np.cos(twist)))
    return End(link, (reach, 0.0, 0.0), axis)
