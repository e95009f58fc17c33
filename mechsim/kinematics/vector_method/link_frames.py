"""Frames of links at rest or in motion: points, joint coordinates, angular velocities.

A frame of arrays gives poses, a frame of jets gives the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mechsim.kinematics.vector_method.vectors import array_cross, column, cross, dot
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import EX, EY, EZ
from mechsim.mechanism.motion import JointMotion, LinkMotion, PointMotion
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet, Values, angle_of, values

# rate of a constant frame, (3, 1)
REST = np.zeros((3, 1))


@dataclass(frozen=True)
class LinkFrame:
    """A link's origin and axes in the ground frame, (3, n) each, or (3, 1) if constant.

    One axis may be omitted: it is the vector product of the other two, computed when needed. So are the
    angular velocity and acceleration, (3, n) each, if `spin` does not give them.
    """

    origin: Values
    x: Values | None = None
    y: Values | None = None
    z: Values | None = None
    spin: tuple[Array, Array] | None = None

    def axis(self, i: int) -> Any:
        """Return axis x, y or z by its index."""
        stored = self.x if i == 0 else self.y if i == 1 else self.z
        return self._third if stored is None else stored

    @property
    def has_rates(self) -> bool:
        """Whether an axis is a jet, or the angular velocity known."""
        return self.spin is not None or any(isinstance(axis, Jet) for axis in self._axes)

    @property
    def _axes(self) -> tuple[Any, Any, Any]:
        return self.x, self.y, self.z

    @cached_property
    def _third(self) -> Any:
        i = next(i for i in range(3) if self._axes[i] is None)
        return cross(self.axis((i + 1) % 3), self.axis((i + 2) % 3))

    def direction(self, local: Sequence[Any] | Array) -> Any:
        """Return a vector given in the link's frame, (3, n); its components are (n,) for many designs."""
        components = [_times(number, self.axis(i)) for i, number in enumerate(local) if _counts(number)]
        return sum(components[1:], components[0]) if components else np.zeros((3, 1))

    def point(self, local: Sequence[Any]) -> Any:
        """Return the position of a point given in the link's frame, (3, n) in [m]."""
        return self.origin + self.direction(local) if any(map(_counts, local)) else self.origin

    @cached_property
    def pose(self) -> "LinkFrame":
        """The frame without its rates."""
        x, y, z = (None if axis is None else values(axis) for axis in self._axes)
        return LinkFrame(values(self.origin), x, y, z)

    def rotation(self, n: int) -> Array:
        """Return the matrices whose columns are the axes, (n, 3, 3)."""
        matrix = np.empty((3, 3, n))
        for i in range(3):
            matrix[:, i] = self.pose.axis(i)
        return matrix.transpose(2, 0, 1)

    @cached_property
    def angular_rates(self) -> tuple[Array, Array]:
        """Angular velocity and acceleration, (3, n) or (3, 1) each.

        Source: with w, the vector product of the axes u and v, the velocity has the components v'.w, -u'.w
        and u'.v along u, v and w; u'' and v'' give the acceleration, less the products of these components.
        A link with a constant axis rotates about it.
        """
        if self.spin is not None:
            return self.spin
        missing = next((i for i in range(3) if self._axes[i] is None), 2)
        u, v, w = self.axis((missing + 1) % 3), self.axis((missing + 2) % 3), self.pose.axis(missing)
        if not isinstance(u, Jet):
            return (u * dot(w, v.rate), u * dot(w, v.second)) if isinstance(v, Jet) else (REST, REST)
        if not isinstance(v, Jet):
            return -v * dot(w, u.rate), -v * dot(w, u.second)
        along_u, along_v, along_w = dot(w, v.rate), -dot(w, u.rate), dot(v.value, u.rate)
        return (
            along_u * u.value + along_v * v.value + along_w * w,
            (dot(w, v.second) - along_v * along_w) * u.value
            + (along_u * along_w - dot(w, u.second)) * v.value
            + (dot(v.value, u.second) - along_u * along_v) * w,
        )


def _times(number: Any, axis: Any) -> Any:
    """Return a multiple of an axis; the axis itself for the factor one, which most joint frames have."""
    return axis if isinstance(number, float) and number == 1.0 else number * axis


def _counts(number: Any) -> bool:
    return bool(number.any() if isinstance(number, np.ndarray) else number)


GROUND_FRAME = LinkFrame(np.zeros((3, 1)), column(EX), column(EY), column(EZ))


def rows(position: Values, n: int) -> Array:
    """Return positions, (3, n) or (3, 1), as the rows of a motion, (n, 3)."""
    return _expanded(values(position), (3, n)).T


def _expanded(array: Array, shape: tuple[int, ...]) -> Array:
    """Return an array broadcast to a shape."""
    if array.shape == shape:
        return array
    expanded = np.empty(shape, array.dtype)
    expanded[...] = array
    return expanded


def point_motion(position: Values, n: int) -> PointMotion:
    """Return the motion of a point, fields (n, 3)."""
    if not isinstance(position, Jet):
        nothing = np.zeros((n, 3))
        return PointMotion(rows(position, n), nothing, nothing)
    return PointMotion(rows(position, n), rows(position.rate, n), rows(position.second, n))


def motion_of_frame(frame: LinkFrame, n: int) -> LinkMotion:
    """Return the motion of a link, fields (n, 3) and (n, 3, 3)."""
    origin, (spin, acceleration) = point_motion(frame.origin, n), frame.angular_rates
    return LinkMotion(
        origin.position,
        frame.rotation(n),
        origin.velocity,
        rows(spin, n),
        origin.acceleration,
        rows(acceleration, n),
    )


def frame_of(link: LinkMotion, angle_only: bool) -> LinkFrame:
    """Return the frame of a link in motion; an axis u has the rates w x u and a x u + w x (w x u).

    For the angle of a hinge only, origin and axes need no rates.
    """
    spin, change = link.angular_velocity.T, link.angular_acceleration.T

    def axis(i: int) -> Values:
        u = link.rotation[..., i].T
        if angle_only:
            return u
        rate = array_cross(spin, u)
        return Jet(u, rate, array_cross(change, u) + array_cross(spin, rate))

    x = link.position.T
    origin = x if angle_only else Jet(x, link.velocity.T, link.acceleration.T)
    return LinkFrame(origin, axis(0), axis(1), axis(2), (spin, change))


def joint_coordinates(
    joint: Joint, a: LinkFrame, b: LinkFrame, sides: tuple[Array, Array] | None = None
) -> list[Values]:
    """Return the coordinates of a joint between two frames, (n,) each in [m] or in (-pi, pi] rad.

    The frames of its sides are (3, 3), by default those of the joint, or (3, 3, n) of many designs.
    """
    kind, coordinates = KINDS[joint.kind], list[Values]()
    frames = (joint.a.frame, joint.b.frame) if sides is None else sides
    columns_a, (reference_b, side_b, axis_b) = map(_columns, frames)
    reference, side, axis = columns_a
    if kind.slides:
        gap = b.point(joint.b.point) - a.point(joint.a.point)
        coordinates += [dot(gap, a.direction(columns_a[COLUMN[along]])) for along in kind.slides]
    if kind.ball or not kind.turns:
        return coordinates
    if kind.hinge:
        return [_hinge_angle(columns_a, reference_b, a, b)]
    # b's axis (crossed axes) or b's reference, in the frame of side a
    observed = b.direction(axis_b if kind.crossed else reference_b)
    coordinates.append(np.arctan2(dot(a.direction(side), observed), dot(a.direction(reference), observed)))
    if kind.crossed:
        back = a.direction(axis)
        coordinates.append(np.arctan2(-dot(b.direction(side_b), back), dot(b.direction(reference_b), back)))
    return coordinates


def _columns(frame: Array) -> Any:
    """Return the columns of a frame, of one design as plain numbers, which are faster."""
    return frame.T.tolist() if frame.ndim == 2 else frame.swapaxes(0, 1)


def _hinge_angle(columns: Sequence[Any], reference_b: Sequence[Any], a: LinkFrame, b: LinkFrame) -> Values:
    """Return the angle of a hinge, (n,), with its rates where the frames have them.

    The rates are those of link b relative to link a about the axis, whose own rate is perpendicular to it.

    Args:
        columns: reference, side and axis in frame a.
        reference_b: the reference in frame b.
        a: frame of the first link.
        b: frame of the second link.
    """
    reference, side, axis = (a.pose.direction(column) for column in columns)
    observed = b.pose.direction(reference_b)
    angle = angle_of(dot(side, observed), dot(reference, observed))
    if not (a.has_rates or b.has_rates):
        return angle
    velocity, acceleration = (
        second - first for first, second in zip(a.angular_rates, b.angular_rates, strict=True)
    )
    return Jet(angle, dot(axis, velocity), dot(axis, acceleration))


def motions_of_joint(joint: Joint, coordinates: Sequence[Values], n: int) -> dict[str, JointMotion]:
    """Return the motion of each joint coordinate, by its name."""
    kind, motions = KINDS[joint.kind], {}
    for i, (name, unit, coordinate) in enumerate(
        zip(joint.coordinates, kind.units, coordinates, strict=True)
    ):
        jet = coordinate if isinstance(coordinate, Jet) else Jet(coordinate, np.zeros(1), np.zeros(1))
        value, rate, second = (_expanded(field, (n,)) for field in (jet.value, jet.rate, jet.second))
        motions[name] = JointMotion(value, rate, second, unit, None if kind.single else i)
    return motions
