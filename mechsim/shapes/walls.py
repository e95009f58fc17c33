"""What stands around a mechanism: a floor or wall with a grid, and posts that carry its bearings."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mechsim.model.link_poses import hinged_normals
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.shapes.camera import Camera
from mechsim.shapes.shape import HOUSING, Shape, vector


@dataclass(frozen=True, slots=True)
class Wall:
    """A plane with a grid on it.

    Attributes:
        point: its middle, (3,) in [m].
        normal: unit vector off it towards the mechanism, (3,).
        half: half its edges in [m], the first along `across`.
        across: unit vector along its first edge, (3,).
    """

    point: Array
    normal: Array
    half: tuple[float, float]
    across: Array

    @property
    def frame(self) -> Array:
        """Axes as columns: along the first edge, the second, off the wall; (3, 3)."""
        return np.column_stack([self.across, np.cross(self.normal, self.across), self.normal])


def backdrop(mechanism: Mechanism, camera: Camera, up: Array, low: Array, high: Array, cell: float) -> Wall:
    """Return the plane behind a mechanism, as large as the picture needs.

    Args:
        mechanism: what stands before it.
        camera: that looks at it.
        up: unit vector along a coordinate axis, across which a floor lies, (3,).
        low: least coordinates of what must lie in front, (3,) in [m].
        high: greatest coordinates, (3,) in [m].
        cell: edge of a grid cell in [m]; the grid passes through the origin, so that it can be read.
    """
    normal, centre, back = _backdrop_axis(mechanism, camera.back, up), camera.position, camera.back
    facing = float(normal @ back)
    lowest = np.where(normal < 0.0, high, low) @ np.abs(normal) * np.sign(normal.sum())
    point = centre - back * ((centre @ normal - lowest) / facing)
    across = np.eye(3)[(int(np.argmax(np.abs(normal))) + 1) % 3]
    for edge in (across, np.cross(normal, across)):
        point = point + edge * (np.round(point @ edge / cell) * cell - point @ edge)
    reach = 0.75 * camera.height * max(1.0, camera.size[0] / camera.size[1])
    half = float(np.ceil(reach / facing / cell)) * cell
    return Wall(point, normal, (half, half), across)


def corner(camera: Camera, low: Array, high: Array) -> list[Wall]:
    """Return the three coordinate planes that stand behind a box."""
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    walls: list[Wall] = []
    for i, axis in enumerate(np.eye(3)):
        side = 1.0 if camera.back[i] >= 0.0 else -1.0
        halves = float(half[(i + 1) % 3]), float(half[(i + 2) % 3])
        walls.append(Wall(middle - side * half[i] * axis, side * axis, halves, np.eye(3)[(i + 1) % 3]))
    return walls


def lowered(low: Array, high: Array, up: Array, by: float) -> tuple[Array, Array, float]:
    """Return a box, (3,) and (3,), extended downwards by a length, and the height of its floor along `up`."""
    low, high = np.where(up > 0.5, low - by, low), np.where(up < -0.5, high + by, high)
    return low, high, float(np.minimum(low * up, high * up).sum())


def stands(shapes: Iterable[Shape], up: Array, floor: float, radius: float) -> list[Shape]:
    """Return a post with a foot for every bearing, down to a floor at a height along the unit vector `up`.

    Of bearings above one another the lowest stands on the floor: the same shaft or rail carries the others.
    """
    posts: list[Shape] = []
    bearings = sorted((s for s in shapes if s.role == "bearing"), key=lambda s: float(s.centre @ up))
    for shape in bearings:
        floored = shape.centre + (floor - float(shape.centre @ up)) * up
        foot = floored + 0.8 * radius * up
        if all(float(np.linalg.norm(post.to - foot)) > radius for post in posts):
            posts.append(Shape("cylinder", vector(shape.centre), vector(foot), (1.3 * radius,), HOUSING))
            posts.append(Shape("cylinder", vector(foot), vector(floored), (3.2 * radius,), HOUSING))
    return posts


def _backdrop_axis(mechanism: Mechanism, back: Array, up: Array) -> Array:
    """Return the direction off the plane that stands behind the mechanism: a floor, or a wall."""
    normals = hinged_normals(mechanism)
    if normals and abs(float(normals[GROUND] @ back)) > 0.5:
        return normals[GROUND] * np.sign(normals[GROUND] @ back)
    if abs(float(up @ back)) > 0.3:
        return up * np.sign(float(up @ back))
    axes = np.eye(3)
    along = axes @ back
    nearest = int(np.argmax(np.abs(along)))
    return axes[nearest] * np.sign(along[nearest])
