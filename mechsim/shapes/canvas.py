"""Canvas: the shapes drawn so far, and what all of them need to know of the mechanism."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND
from mechsim.model.links import IDENTITY as GROUND_POSE
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.shapes.body import displacement, layers_of, link_colours, planar_normals, rod_radius
from mechsim.shapes.shape import HOUSING, STEEL, Kind, Rgba, Shape, vector


class Canvas:
    """What link shapes are drawn on.

    Attributes:
        mechanism: what is drawn.
        travel: joint -> least and greatest displacement in [m], where known; see `displacement`.
        outward: joint -> side of its shaft.
        r: radius of rods in [m].
        colours: link -> colour.
        normals: link -> normal of its plane of motion; None for a spatial mechanism.
        out: link -> shapes drawn so far.
    """

    def __init__(
        self, mechanism: Mechanism, travel: dict[str, tuple[float, float]], outward: dict[str, float]
    ):
        self.mechanism = mechanism
        self.travel = travel
        self.outward = outward
        self.r = rod_radius(mechanism)
        self.colours = link_colours(mechanism)
        self.normals = planar_normals(mechanism)
        self.layers = layers_of(mechanism) if self.normals else {}
        self.out: dict[str, list[Shape]] = {GROUND: [], **{link.name: [] for link in mechanism.links}}

    def add(self, link: str, kind: Kind, frm: ArrayLike, to: ArrayLike, radius: float, rgba: Rgba) -> None:
        """Draw a round solid between two points of a link."""
        self.out[link].append(Shape(kind, vector(frm), vector(to), (radius,), rgba))

    def disc(self, link: str, end: End, low: float, high: float, radius: float, rgba: Rgba) -> None:
        """Draw a cylinder about a joint's axis, between two heights over the joint's point."""
        point, axis = np.asarray(end.point), np.asarray(end.axis)
        self.add(link, "cylinder", point + low * axis, point + high * axis, radius, rgba)

    def bearing(self, end: End, low: float, high: float) -> None:
        """Draw a bearing on the ground between two heights over a joint's point."""
        self.disc(GROUND, end, low, high, 2.2 * self.r, HOUSING)
        self.carry()

    def shaft(self, joint: Joint, end: End) -> None:
        """Draw a shaft at a joint's end on the ground, and the bearing to which it leads."""
        away = self.outward.get(joint.name, -1.0)
        low, high = sorted((-2.2 * self.r * away, 9.0 * self.r * away))
        self.disc(GROUND, end, low, high, 1.1 * self.r, STEEL)
        low, high = sorted((4.2 * self.r * away, 7.8 * self.r * away))
        self.bearing(end, low, high)

    def carry(self) -> None:
        """Let a post carry what was drawn last on the ground."""
        self.out[GROUND][-1] = replace(self.out[GROUND][-1], role="bearing")

    def join(self, link: str, points: Sequence[ArrayLike]) -> None:
        """Draw a rod of a link from point to point."""
        for frm, to in pairwise(points):
            if float(np.linalg.norm(np.subtract(to, frm))) > 0.1 * self.r:
                self.add(link, "capsule", frm, to, self.r, self.colours[link])

    def height(self, link: str) -> float:
        """Return the middle of a planar link's layer, along its normal."""
        return 1.6 * self.r * self.layers.get(link, 0.0)

    def level(self, link: str) -> float:
        """Return the middle of a planar link's layer, of the ground the mounting plate, along its normal."""
        return self.back if link == GROUND else self.height(link)

    @property
    def back(self) -> float:
        """Where the mounting plate of a planar mechanism stands, along the ground's normal."""
        lowest = min(self.height(link.name) for link in self.mechanism.links)
        return lowest - (5.0 if self.mechanism.gears or self.mechanism.couplings else 2.6) * self.r

    def lift(self, end: End) -> Array:
        """Return the layer of a planar link as a vector in its frame; the ground takes that of its guest."""
        if not self.normals:
            return np.zeros(3)
        guided = end.link
        if end.link == GROUND:
            joint = next(j for j in self.mechanism.joints if end in (j.a, j.b))
            guided = joint.b.link if joint.a is end else joint.a.link
        return self.height(guided) * self.normals[end.link]

    def thickness(self, end: End) -> Array:
        """Return the direction in which what slides at a joint is thin."""
        return self.normals[end.link] if self.normals else end.frame[:, 1]

    def travel_of(self, joint: Joint) -> tuple[float, float]:
        """Return the least and greatest displacement of a joint, known or bounded by the crank's reach."""
        if joint.name in self.travel:
            return self.travel[joint.name]
        guess = {GROUND: GROUND_POSE, **self.mechanism.guess}
        current = 0.0
        if joint.a.link in guess and joint.b.link in guess:
            current = float(displacement(joint, guess[joint.a.link], guess[joint.b.link]))
        driver = self.mechanism.driven_joints[0].b
        arms = [vector(end.point) for end in self.mechanism.ends(driver.link)]
        reach = 2.0 * max(float(np.linalg.norm(np.subtract(arm, driver.point))) for arm in arms)
        return current - reach, current + reach


def upright_end(end: End, normal: Array) -> End:
    """Return the end with its axis along the plane's normal."""
    return replace(end, axis=vector(normal))
