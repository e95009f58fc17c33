"""Curves on links, x(s), y(s), z(s) in [m], for points and rollers that follow them.

The centre of a roller of radius r follows the offset curve c + r n with the normal n.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mechsim.mechanism.cams import SegmentedLaw
from mechsim.mechanism.coupling_functions import PlainFunction, TabledFunction, WrittenFunction
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet

# sides of the polygon whose area determines the outside of a closed curve
SIDES = 500


@dataclass(frozen=True)
class GuideCurve:
    """A curve, or the path of a roller's centre along it.

    Attributes:
        name: of the curve, for messages.
        axes: x and y, or x, y and z, as functions of s in [m].
        interval: of s; a period of a closed curve.
        closed: whether it repeats after this interval.
        bounded: whether it ends with the interval.
        offset: distance of the roller's centre to the left of increasing s, in [m].
    """

    # fields with numbers on which a motion depends
    NUMBERS: ClassVar[tuple[str, ...]] = ("axes", "offset")

    name: str
    axes: tuple[PlainFunction, ...]
    interval: tuple[float, float]
    closed: bool = False
    bounded: bool = False
    offset: float = 0.0

    def jets(self, s: Array) -> list[Jet]:
        """Return x, y and, of a spatial curve, z with their first two derivatives by s."""
        pairs = [axis.with_derivative(s) for axis in self.axes]
        if self.offset == 0.0:
            return [value for value, _ in pairs]
        (x, dx), (y, dy) = pairs
        scale: Any = self.offset / np.sqrt(dx * dx + dy * dy)
        return [x - scale * dy, y + scale * dx]

    def curvature(self, s: Array) -> Array:
        """Return the curvature of the curve without its offset in [1/m], positive to the left."""
        (_, dx), (_, dy) = (axis.with_derivative(s) for axis in self.axes)
        return (dx.value * dy.rate - dy.value * dx.rate) / np.hypot(dx.value, dy.value) ** 3

    def outside(self) -> float:
        """Return -1 if the outside of a closed planar curve is to the right of increasing s, else 1."""
        x, y = (axis(np.linspace(*self.interval, SIDES + 1))[0] for axis in self.axes)
        return -float(np.sign((x[:-1] * np.diff(y) - y[:-1] * np.diff(x)).sum()))


@dataclass(frozen=True)
class CurveAxis:
    """A coordinate of a curve as the function of a coupling.

    Attributes:
        curve: the curve.
        axis: 0, 1 or 2 for x, y or z.
    """

    NUMBERS: ClassVar[tuple[str, ...]] = ("curve",)

    curve: GuideCurve
    axis: int

    @property
    def text(self) -> str:
        """Its name, for messages."""
        return f"{'xyz'[self.axis]} of curve {self.curve.name}"

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of s in which an assembly is searched."""
        return self.curve.interval

    def __call__(self, s: Array) -> tuple[Array, Array, Array]:
        """Return the value and its first two derivatives at s; beyond the ends those of the tangents."""
        s, (low, high) = np.asarray(s), self.curve.interval
        if not self.curve.bounded:
            jet = self.curve.jets(s)[self.axis]
            return jet.value, jet.rate, jet.second
        inside = (low <= s.real) & (s.real <= high)
        nearest = np.where(inside, s, np.clip(s.real, low, high))
        jet = self.curve.jets(nearest)[self.axis]
        return jet.value + jet.rate * (s - nearest), jet.rate, np.where(inside, jet.second, 0.0)


CouplingFunction = WrittenFunction | TabledFunction | CurveAxis | SegmentedLaw
