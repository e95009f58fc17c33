"""Frames of links, at rest or in motion, and what follows from them: points, joint coordinates, turning.

A frame is made of arrays, which gives poses, or of jets, which gives the motion too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mechsim.analytic.vector_method.jets import Jet, Values, values
from mechsim.analytic.vector_method.vectors import column, cross, dot
from mechsim.maths.arrays import Array
from mechsim.model.joints import KINDS
from mechsim.model.mechanism import EX, EY, EZ, Joint, Vector
from mechsim.model.motion import JointMotion, LinkMotion, PointMotion


@dataclass(frozen=True)
class LinkFrame:
    """A link's origin and axes in the ground frame, (3, n) each, or (3, 1) where they never move.

    One axis may be left out: it is the vector product of the other two, made when asked for.
    """

    origin: Values
    x: Values | None = None
    y: Values | None = None
    z: Values | None = None

    def axis(self, i: int) -> Any:
        """Return axis x, y or z by number."""
        given = self._given[i]
        return self._third if given is None else given

    @property
    def _given(self) -> tuple[Any, Any, Any]:
        return self.x, self.y, self.z

    @cached_property
    def _third(self) -> Any:
        i = next(i for i in range(3) if self._given[i] is None)
        return cross(self.axis((i + 1) % 3), self.axis((i + 2) % 3))

    def direction(self, local: Sequence[Any] | Array) -> Any:
        """Return a vector given in the link's frame, (3, n); its parts are (n,) each for many designs."""
        parts = [part * self.axis(i) for i, part in enumerate(local) if _counts(part)]
        return sum(parts[1:], parts[0]) if parts else np.zeros((3, 1))

    def point(self, local: Sequence[Any]) -> Any:
        """Return the place of a point given in the link's frame, (3, n) in [m]."""
        return self.origin + self.direction(local) if any(map(_counts, local)) else self.origin

    def rotation(self, n: int) -> Array:
        """Return the matrices whose columns are the axes, (n, 3, 3)."""
        rest = LinkFrame(self.origin, *(None if axis is None else values(axis) for axis in self._given))
        matrix = np.empty((3, 3, n))
        for i in range(3):
            matrix[:, i] = rest.axis(i)
        return np.moveaxis(matrix, -1, 0)

    def turning(self) -> tuple[Array, Array]:
        """Return angular velocity and acceleration, (3, n) or (3, 1) each.

        Source: for axes e, e' = w x e, so that the sum of e x e' is 2 w and that of e x e'' is 2 w'. A
        link with an axis that never moves turns about it.
        """
        moving = [axis for axis in self._given if isinstance(axis, Jet)]
        fixed = [axis for axis in self._given if isinstance(axis, np.ndarray)]
        if not moving:
            return np.zeros((3, 1)), np.zeros((3, 1))
        if fixed:
            axis, across = fixed[0], cross(fixed[0], moving[0].value)
            return axis * dot(across, moving[0].rate), axis * dot(across, moving[0].second)
        axes = [self.axis(i) for i in range(3)]
        spin = [cross(axis.value, axis.rate) for axis in axes]
        acceleration = [cross(axis.value, axis.second) for axis in axes]
        return 0.5 * np.sum(spin, 0), 0.5 * np.sum(acceleration, 0)


def _counts(part: Any) -> bool:
    return bool(np.any(part))


GROUND_FRAME = LinkFrame(np.zeros((3, 1)), column(EX), column(EY), column(EZ))


def vector(numbers: Array | Sequence[Any]) -> Vector:
    """Return three numbers as a plain tuple."""
    x, y, z = (float(number) for number in numbers)
    return x, y, z


def place(position: Values, n: int) -> Array:
    """Return a place, (3, n) or (3, 1), as the rows of a motion, (n, 3)."""
    return np.broadcast_to(values(position), (3, n)).T


def point_motion(position: Values, n: int) -> PointMotion:
    """Return the motion of a point, fields (n, 3)."""
    if not isinstance(position, Jet):
        nothing = np.zeros((n, 3))
        return PointMotion(place(position, n), nothing, nothing)
    return PointMotion(place(position, n), place(position.rate, n), place(position.second, n))


def link_motion(frame: LinkFrame, n: int) -> LinkMotion:
    """Return the motion of a link, fields (n, 3) and (n, 3, 3)."""
    origin, (spin, acceleration) = point_motion(frame.origin, n), frame.turning()
    return LinkMotion(
        origin.position,
        frame.rotation(n),
        origin.velocity,
        place(spin, n),
        origin.acceleration,
        place(acceleration, n),
    )


def joint_coordinate(joint: Joint, a: LinkFrame, b: LinkFrame, side_a: Array | None = None) -> Any:
    """Return the coordinate of a joint that has one between two frames, (n,) in [m] or in (-pi, pi] rad.

    The frame of its side a is (3, 3), as the joint has it, or (3, 3, n) of many designs.
    """
    frame = joint.a.frame if side_a is None else side_a
    mark, side, axis = (vector(frame[:, i]) if frame.ndim == 2 else frame[:, i] for i in range(3))
    if KINDS[joint.kind].slides:
        return dot(b.point(joint.b.point) - a.point(joint.a.point), a.direction(axis))
    seen = b.direction(vector(joint.b.frame[:, 0]))
    return np.arctan2(dot(a.direction(side), seen), dot(a.direction(mark), seen))


def joint_motion(joint: Joint, coordinate: Values, n: int) -> JointMotion:
    """Return the motion of a joint from its coordinate."""
    unit = "m" if KINDS[joint.kind].slides else "rad"
    if not isinstance(coordinate, Jet):
        coordinate = Jet(coordinate, np.zeros(1), np.zeros(1))
    value, rate, second = coordinate.value, coordinate.rate, coordinate.second
    return JointMotion(np.broadcast_to(value, n), np.broadcast_to(rate, n), np.broadcast_to(second, n), unit)
