"""Offset slider-crank: its dimensions and its closed form."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike

from mechsim.formulas import (
    EX,
    EZ,
    ORIGIN,
    Array,
    LinkFrame,
    TwoBranchForm,
    Values,
    column,
    rotate,
    sine_of,
)


class SliderCrank(TwoBranchForm):
    """Planar slider-crank whose slider may be offset."""

    array_parameters = frozenset(("crank", "rod", "offset", "branch"))

    def discriminant(self, angles: ArrayLike) -> Array:
        """rod2 - h2 for the height h of the slide above A."""
        return self.rod**2 - (self.offset - self.crank * np.sin(np.asarray(angles))) ** 2

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        return self.branch * (points["B"] - points["A"])[:, 0]

    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array:
        along = np.abs((points["B"] - points["A"])[:, 0]) / self.rod
        return np.arcsin(np.minimum(along, 1.0))

    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """B lies ahead of A by a leg of the right triangle with hypotenuse AB; the height is the other."""
        ez, origin = column(EZ), column(ORIGIN)
        ahead = rotate(column(EX), ez, angle)
        a = self.crank * ahead
        reach = self.across(angle)
        if reach is None:
            reach = self.branch * self.rod * sine_of((self.offset - a[1]) / self.rod)
        b = column((0.0, self.offset, 0.0)) + (a[0] + reach) * column(EX)
        yield "crank", LinkFrame(origin, x=ahead, z=ez)
        yield "slider", LinkFrame(b, x=column(EX), z=ez)
        yield "rod", LinkFrame(a, x=(b - a) / self.rod, z=ez)
