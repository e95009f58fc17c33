"""Canvas: the shapes drawn so far, and what all of them need to know of the mechanism."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.maths.arrays import Array
from mechsim.model.mechanism import GROUND, End, Joint, Mechanism, joint_coordinate
from mechsim.model.mechanism import IDENTITY as GROUND_POSE
from mechsim.shapes.body import link_colours, rod_radius
from mechsim.shapes.planar import layers_of, planar_normals
from mechsim.shapes.shape import HOUSING, Kind, Rgba, Shape, vector


class Canvas:
    """What link shapes are drawn on.

    Attributes:
        mechanism: what is drawn.
        travel: joint -> least and greatest displacement along its axis in [m], where known.
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

    def add(self, link: str, kind: Kind, frm: ArrayLike, to: ArrayLike, size: float, rgba: Rgba) -> None:
        """Draw a round solid between two places of a link."""
        self.out[link].append(Shape(kind, vector(frm), vector(to), (size,), rgba))

    def disc(self, link: str, end: End, low: float, high: float, radius: float, rgba: Rgba) -> None:
        """Draw a cylinder about a joint's axis, between two heights over the joint's point."""
        point, axis = np.asarray(end.point), np.asarray(end.axis)
        self.add(link, "cylinder", point + low * axis, point + high * axis, radius, rgba)

    def bearing(self, end: End, low: float, high: float) -> None:
        """Draw a bearing on the ground between two heights over a joint's point."""
        self.disc(GROUND, end, low, high, 2.2 * self.r, HOUSING)
        self.out[GROUND][-1] = replace(self.out[GROUND][-1], role="bearing")

    def height(self, link: str) -> float:
        """Return the middle of a planar link's layer, along its normal."""
        return 1.6 * self.r * self.layers.get(link, 0.0)

    @property
    def back(self) -> float:
        """Where the mounting plate of a planar mechanism stands, along the ground's normal."""
        lowest = min(self.height(link.name) for link in self.mechanism.links)
        return lowest - (5.0 if self.mechanism.gears else 2.6) * self.r

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
        here = 0.0
        if joint.a.link in guess and joint.b.link in guess:
            here = float(joint_coordinate(joint, guess[joint.a.link], guess[joint.b.link])[..., 0])
        driver = self.mechanism.driven_joints[0].b
        arms = [vector(end.point) for end in self.mechanism.ends(driver.link)]
        reach = 2.0 * max(float(np.linalg.norm(np.subtract(arm, driver.point))) for arm in arms)
        return here - reach, here + reach


def upright_end(end: End, normal: Array) -> End:
    """Return the end with its axis along the plane's normal."""
    return replace(end, axis=vector(normal))
