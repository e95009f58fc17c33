"""Offset slider-crank: its dimensions and its closed form."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.base import Array, Detail, TwoBranchForm, choice, length, offset
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.vectors import Sign, column, sine_of
from mechsim.model.mechanism import EX, EY, GROUND, End, Joint, Link, Mechanism
from mechsim.model.motion import JointMotion, Motion


@dataclass(frozen=True, kw_only=True)
class SliderCrank(TwoBranchForm):
    """Planar slider-crank O-A-B in the XY plane, the slider B moving along X at height `offset`.

    The crank angle counts from +X. `branch` is +1 if B lies ahead of A along the slide, else -1.
    """

    name: ClassVar[str] = "slider_crank"

    crank: float = length(0.05, "length OA")
    rod: float = length(0.2, "length AB")
    offset: float = offset(0.01, "height of the slide above O")
    branch: Sign = choice(1, (1, -1), "assembly: +1 if B lies ahead of A along the slide")

    @property
    def mechanism(self) -> Mechanism:
        guess, start = self.guess()
        tip, eye = (self.crank, 0.0, 0.0), (self.rod, 0.0, 0.0)
        on_slide = End(GROUND, (0.0, self.offset, 0.0), axis=EX, mark=EY)
        return Mechanism(
            name=self.name,
            links=(Link("crank"), Link("rod"), Link("slider")),
            joints=(
                Joint("crank", "revolute", End(GROUND), End("crank")),
                Joint("A", "revolute", End("crank", tip), End("rod")),
                Joint("B", "revolute", End("rod", eye), End("slider")),
                Joint("slide", "prismatic", on_slide, End("slider", axis=EX, mark=EY)),
            ),
            driver="crank",
            points={"A": ("crank", tip), "B": ("slider", (0.0, 0.0, 0.0))},
            guess=guess,
            start=start,
        )

    def margin(self, angles: ArrayLike) -> Array:
        """rod2 - h2 for the height h of the slide above A."""
        return self.rod**2 - (self.offset - self.crank * np.sin(np.asarray(angles))) ** 2

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        return self.branch * (points["B"] - points["A"])[:, 0]

    def transmission_angle(self, angles: ArrayLike) -> Array:
        points = self.positions(angles)
        along = np.abs((points["B"] - points["A"])[:, 0]) / self.rod
        return np.arcsin(np.minimum(along, 1.0))

    def _motion(self, angles: Array, speed: Array, acceleration: Array, detail: Detail) -> Motion:
        zero, ex = np.zeros_like(angles), column(EX)
        a = self.crank * np.stack([np.cos(angles), np.sin(angles), zero])
        height = self.offset - a[1]
        reach = self.branch * _leg(self.rod, height)
        b = np.stack([a[0] + reach, np.full_like(angles, self.offset), zero])
        if detail == "places":
            points = {"A": link_frames.point(a), "B": link_frames.point(b)}
            return Motion("closed form", angles, speed, acceleration, points)

        tangent = np.stack([-a[1], a[0], zero])
        a_v, a_a = speed * tangent, acceleration * tangent - speed**2 * a
        # the loop |AB| = rod with B held to the slide, differentiated once and twice by time
        gap_v = height * a_v[1] / reach
        gap_a = (height * a_a[1] - a_v[1] ** 2 - gap_v**2) / reach
        b_v, b_a = (a_v[0] + gap_v) * ex, (a_a[0] + gap_a) * ex
        points = {"A": link_frames.point(a, a_v, a_a), "B": link_frames.point(b, b_v, b_a)}
        if detail == "rates":
            return Motion("closed form", angles, speed, acceleration, points)
        ahead = (b - a) / self.rod
        spin, pull = link_frames.planar_turn(b - a, b_v - a_v, b_a - a_a)
        return Motion(
            "closed form",
            angles,
            speed,
            acceleration,
            points,
            links={
                "crank": link_frames.planar_link(
                    link_frames.point(np.zeros_like(a)), a / self.crank, speed, acceleration
                ),
                "rod": link_frames.planar_link(points["A"], ahead, spin, pull),
                "slider": link_frames.planar_link(points["B"], np.broadcast_to(ex, a.shape), zero, zero),
            },
            joints={
                "crank": JointMotion(angles, speed, acceleration),
                "A": JointMotion(np.arctan2(ahead[1], ahead[0]) - angles, spin - speed, pull - acceleration),
                "slide": JointMotion(b[0], b_v[0], b_a[0], "m"),
            },
        )


def _leg(hypotenuse: float, leg: Array) -> Array:
    """Return the other leg of a right triangle; NaN where there is none by more than rounding."""
    return hypotenuse * sine_of(leg / hypotenuse)
