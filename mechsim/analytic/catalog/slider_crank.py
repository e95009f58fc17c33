"""Offset slider-crank: its dimensions and its closed form."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.formulas import Declaration, Geometry, choice, length, position
from mechsim.analytic.catalog.two_branch import TwoBranchForm
from mechsim.analytic.vector_method.link_frames import LinkFrame
from mechsim.analytic.vector_method.vectors import Sign, column, sine_of, spun
from mechsim.model.joints import End, Joint
from mechsim.model.links import EX, EY, EZ, GROUND, ORIGIN, Link
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Values


@dataclass(frozen=True, kw_only=True)
class SliderCrank(TwoBranchForm):
    """Planar slider-crank whose slider may be offset.

    O-A-B lies in the XY plane; the slider B moves along X at the height `offset`.

    The crank angle is measured from +X. `branch` is +1 if B lies ahead of A along the slide, else -1.
    """

    declaration = Declaration(
        "slider_crank", array_parameters=frozenset(("crank", "rod", "offset", "branch"))
    )
    crank: float = length(0.05, "length OA")
    rod: float = length(0.2, "length AB")
    offset: float = position(0.01, "height of the slide above O")
    branch: Sign = choice(1, (1, -1), "assembly: +1 if B lies ahead of A along the slide")

    @property
    def description(self) -> Mechanism:
        joints = self.geometry().joints
        (tip, _), (eye, _), (slide, _) = (joints[name] for name in ("A", "B", "slide"))
        on_slide = End(GROUND, slide, axis=EX, reference=EY)
        return Mechanism(
            name=self.name,
            links=(Link("crank"), Link("rod"), Link("slider")),
            joints=(
                Joint("crank", "revolute", End(GROUND), End("crank")),
                Joint("A", "revolute", End("crank", tip), End("rod")),
                Joint("B", "revolute", End("rod", eye), End("slider")),
                Joint("slide", "prismatic", on_slide, End("slider", axis=EX, reference=EY)),
            ),
            driver="crank",
            points={"A": ("crank", tip), "B": ("slider", (0.0, 0.0, 0.0))},
        )

    def geometry(self) -> Geometry:
        tip = (self.crank, 0.0, 0.0)
        return Geometry(
            points={"A": tip, "B": ORIGIN},
            joints={
                "A": (tip, ORIGIN),
                "B": ((self.rod, 0.0, 0.0), ORIGIN),
                "slide": ((0.0, self.offset, 0.0), ORIGIN),
            },
        )

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
        ahead = spun(column(EX), ez, angle)
        a = self.crank * ahead
        reach = self.across(angle)
        if reach is None:
            reach = self.branch * self.rod * sine_of((self.offset - a[1]) / self.rod)
        b = column((0.0, self.offset, 0.0)) + (a[0] + reach) * column(EX)
        yield "crank", LinkFrame(origin, x=ahead, z=ez)
        yield "slider", LinkFrame(b, x=column(EX), z=ez)
        yield "rod", LinkFrame(a, x=(b - a) / self.rod, z=ez)
