"""The camera: viewing direction, framing, and the pixel of a point.

The projection is parallel: the scale is the same everywhere, so that a scale bar is valid everywhere and
framing is exact.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism, Up, unit_vector
from mechsim.mechanism.motion_plane import hinged_normals
from mechsim.numerics.arrays import Array
from mechsim.shapes.body import extent, hull
from mechsim.shapes.shape import HOUSING, Shape, vector

# fraction of the height above which all bearings of a hanging robot lie
HANGING = 0.7
PRESETS = ("iso", "shaft", "top", "side")
# azimuth and elevation of a file's camera in [deg], as MuJoCo's free camera counts them
Angles = tuple[float, float]
# fraction of the picture that is free on each side for labels, scale bar and read-out
BORDER = 0.09
# cosine of the angle to an axis above which a shaft counts as parallel to it
PARALLEL = 0.9


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera with parallel projection.

    Attributes:
        position: in [m], (3,).
        right: unit vector to the right of the picture, (3,).
        up: unit vector to its top, (3,).
        back: unit vector from the scene to the camera, (3,).
        height: height of the visible area in [m].
        resolution: of the picture (width, height) in pixels.
    """

    position: Array
    right: Array
    up: Array
    back: Array
    height: float
    resolution: tuple[int, int]

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return self.resolution[1] / self.height

    def pixel(self, points: Array) -> Array:
        """Return the pixels of points, x to the right and y down; (..., 3) -> (..., 2)."""
        off = points - self.position
        x = self.resolution[0] / 2.0 + self.scale * (off @ self.right)
        y = self.resolution[1] / 2.0 - self.scale * (off @ self.up)
        return np.stack([x, y], -1)


def upright(mechanism: Mechanism, up: Up | None = None) -> Array:
    """Return the unit vector that points up, (3,): `up`, else the axis of the description, else y.

    A mechanism that moves in a horizontal plane is drawn in that plane, with its y axis up (z if y is
    vertical). If nothing states the axis and the first driver's axis is parallel to y, z is up.
    """
    stated = up or mechanism.up
    vertical = unit_vector(stated or "y")
    standing = abs(float(_shaft(mechanism) @ vertical)) > PARALLEL
    if standing and (stated is None or hinged_normals(mechanism)):
        return _other_axis(vertical)
    return vertical


def _other_axis(vertical: Array) -> Array:
    """Return the y axis, or z if the vertical is parallel to y."""
    return unit_vector("y" if abs(float(vertical[1])) < PARALLEL else "z")


def free_camera(angles: Angles) -> tuple[Array, Array]:
    """Return (back, up) of MuJoCo's free camera at an azimuth and an elevation in [deg]; z is vertical."""
    (sin_a, sin_e), (cos_a, cos_e) = np.sin(np.deg2rad(angles)), np.cos(np.deg2rad(angles))
    back = np.array([-cos_e * cos_a, -cos_e * sin_a, -sin_e])
    return back, np.array([-sin_e * cos_a, -sin_e * sin_a, cos_e])


def free_camera_angles(back: Array, up: Array) -> Angles:
    """Return the azimuth and the elevation in [deg] of MuJoCo's free camera that looks against `back`.

    `up` decides the azimuth where the camera looks along z.
    """
    ahead = -back[:2] if np.hypot(*back[:2]) > 1.0 - PARALLEL else up[:2] * np.sign(back[2])
    return float(np.rad2deg(np.arctan2(ahead[1], ahead[0]))), -float(np.rad2deg(np.arcsin(back[2])))


def directions(
    mechanism: Mechanism, preset: str, up: Up | None = None, angles: Angles | None = None
) -> tuple[Array, Array]:
    """Return (back, up) of a preset: unit vectors from scene to camera and to the top of the picture.

    `up` is the axis that points up, see `upright`. "shaft" looks along the crank shaft, with the crank
    rotating anticlockwise at positive speed; "top" and "side" look across it; "iso" looks from a corner, or,
    for a planar mechanism, perpendicular to its plane. With the `angles` of a file's camera "iso" is that
    camera; for a planar mechanism it looks from its side of the plane.
    """
    if preset not in PRESETS:
        raise InputError(f"there is no camera {preset!r}; choose from {', '.join(PRESETS)}")
    shaft = _shaft(mechanism)
    vertical = upright(mechanism, up)
    if abs(float(shaft @ vertical)) > PARALLEL:
        if preset == "shaft":
            vertical = _other_axis(vertical)
        else:
            shaft = unit_vector("x" if abs(float(vertical[0])) < PARALLEL else "y")
    vertical = vertical - shaft * float(shaft @ vertical)
    vertical /= np.linalg.norm(vertical)
    flat = hinged_normals(mechanism) is not None
    if preset == "iso" and angles is not None and up is None:
        if not flat:
            return free_camera(angles)
        shaft = shaft * (1.0 if float(shaft @ free_camera(angles)[0]) >= 0.0 else -1.0)
    side = np.cross(vertical, shaft) if flat else np.cross(shaft, vertical)
    back: Array = {
        "shaft": shaft,
        "top": vertical,
        "side": side,
        "iso": shaft if flat else 0.75 * shaft + 0.62 * vertical + 0.95 * side,
    }[preset]
    if preset == "top":
        vertical = -shaft if flat else -side
    right = np.cross(vertical, back)
    right /= np.linalg.norm(right)
    back = back / np.linalg.norm(back)
    return back, np.cross(back, right)


def _shaft(mechanism: Mechanism) -> Array:
    """Return the normal of the plane of motion, else the axis of the first driver or joint."""
    normals = hinged_normals(mechanism)
    return normals[GROUND] if normals else np.asarray((*mechanism.driven_joints, *mechanism.joints)[0].a.axis)


def framed(
    back: Array,
    up: Array,
    points: Array,
    radii: Array,
    resolution: tuple[int, int],
    border: float = BORDER,
    foot: float = 0.0,
) -> Camera:
    """Return the camera along `back` that shows balls about points, (n, 3) and (n,), with a margin.

    The fraction `foot` of the picture's height is free at the bottom, or the margin if that is larger.
    """
    foot = max(0.0, foot - border)
    right = np.cross(up, back)
    across, over, deep = points @ right, points @ up, points @ back
    x_low, width = span(across, radii)
    y_low, height = span(over, radii)
    share = 1.0 - 2.0 * border
    visible_height = max(height / (share - foot), width / share * resolution[1] / resolution[0])
    nearest = float((deep + radii).max())
    centre = (x_low + width / 2.0) * right + (y_low + (height - foot * visible_height) / 2.0) * up
    return Camera(centre + (nearest + visible_height) * back, right, up, back, visible_height, resolution)


def clearest_pose(mechanism: Mechanism, poses: Mapping[str, Pose], view: tuple[Array, Array]) -> int:
    """Return the index of the pose with the largest projected area of joints and tracked points.

    The area is that of the ellipse of inertia of their projections; it is 0 if all are collinear.

    Args:
        mechanism: the mechanism.
        poses: link -> poses, (n, ...), or one pose; ground included.
        view: unit vectors to the right and to the top of the picture, (3,) each.
    """
    joints = [(end.link, end.point) for joint in mechanism.joints for end in (joint.a, joint.b)]
    every = [*joints, *mechanism.points.values()]
    points = [poses[link].point(local) @ np.column_stack(view) for link, local in every]
    stacked = np.stack(np.broadcast_arrays(*map(np.atleast_2d, points)))
    offsets = stacked - stacked.mean(0)
    return int(np.argmax(np.linalg.det(np.einsum("knx,kny->nxy", offsets, offsets))))


def nice(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that does not exceed a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= length * (1.0 + 1e-9)))


def span(values: Array, radii: Array) -> tuple[float, float]:
    """Return the lowest position of balls along an axis, and the length that they cover."""
    low, high = float((values - radii).min()), float((values + radii).max())
    return low, high - low


@dataclass(frozen=True, slots=True)
class Wall:
    """A plane with a grid on it.

    Attributes:
        point: its centre, (3,) in [m].
        normal: unit normal towards the mechanism, (3,).
        half: half its edge lengths in [m], the first along `across`.
        across: unit vector along its first edge, (3,).
    """

    point: Array
    normal: Array
    half: tuple[float, float]
    across: Array

    @property
    def frame(self) -> Array:
        """Axes as columns: along the first edge, the second, along the normal; (3, 3)."""
        return np.column_stack([self.across, np.cross(self.normal, self.across), self.normal])


def backdrop(
    mechanism: Mechanism,
    camera: Camera,
    up: Array,
    low: Array,
    high: Array,
    grid_step: float,
    path: float = 0.0,
) -> Wall:
    """Return the plane behind a mechanism, as large as the picture needs.

    Args:
        mechanism: the mechanism in front of it.
        camera: the camera.
        up: unit vector along a coordinate axis, the normal of a floor, (3,).
        low: smallest coordinates that must lie in front, (3,) in [m].
        high: largest coordinates, (3,) in [m].
        grid_step: edge of a grid cell in [m]; the grid passes through the origin, so that it can be read.
        path: of the camera, in [m].
    """
    normal, centre, back = _backdrop_axis(mechanism, camera.back, up), camera.position, camera.back
    facing = float(normal @ back)
    lowest = np.where(normal < 0.0, high, low) @ np.abs(normal) * np.sign(normal.sum())
    point = centre - back * ((centre @ normal - lowest) / facing)
    across = np.eye(3)[(int(np.argmax(np.abs(normal))) + 1) % 3]
    for edge in (across, np.cross(normal, across)):
        point = point + edge * (np.round(point @ edge / grid_step) * grid_step - point @ edge)
    reach = path + 0.75 * camera.height * max(1.0, camera.resolution[0] / camera.resolution[1])
    half = float(np.ceil(reach / facing / grid_step)) * grid_step
    return Wall(point, normal, (half, half), across)


def lowered(low: Array, high: Array, up: Array, by: float) -> tuple[Array, Array, float]:
    """Return a box, (3,) and (3,), extended downwards by a length, and the height of its floor along `up`."""
    low, high = np.where(up > 0.5, low - by, low), np.where(up < -0.5, high + by, high)
    return low, high, float(np.minimum(low * up, high * up).sum())


def stands(shapes: Iterable[Shape], up: Array, floor: float, radius: float) -> list[Shape]:
    """Return a post with a foot for every bearing, down to a floor at a height along the unit vector `up`.

    Of several bearings above one another only the lowest gets a post; the others share its shaft or rail.
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


def _ceiling(bearings: Array, up: Array, radius: float) -> list[Shape]:
    """Return a frame over bearings."""
    heights = bearings @ up
    corners = bearings + (heights.max() + 4.0 * radius - heights)[:, None] * up
    # the axes of the ring's plane
    ring = corners[hull(corners @ np.eye(3)[np.abs(up) < PARALLEL].T)]
    rods = [*zip(bearings, corners, strict=True), *zip(ring, np.roll(ring, 1, axis=0), strict=True)]
    return [Shape("capsule", vector(a), vector(b), (1.6 * radius,), HOUSING) for a, b in rods]


def add_stands(
    ground: list[Shape], up: Array, floor: float, radius: float, balls: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Add `stands`, or the frame of a hanging robot, to the shapes of the ground; return all balls."""
    top = float((balls[0] @ up + balls[1]).max())
    bearings = np.array([shape.centre for shape in ground if shape.role == "bearing"]).reshape(-1, 3)
    hangs = len(bearings) > 2 and not (bearings @ up).min() < floor + HANGING * (top - floor)
    posts = _ceiling(bearings, up, radius) if hangs else stands(ground, up, floor, radius)
    ground.extend(posts)
    feet = extent([(IDENTITY, posts)])
    return np.vstack([balls[0], feet[0]]), np.append(balls[1], feet[1])


def _backdrop_axis(mechanism: Mechanism, back: Array, up: Array) -> Array:
    """Return the normal of the plane behind the mechanism: a floor or a wall."""
    normals = hinged_normals(mechanism)
    if normals and abs(float(normals[GROUND] @ back)) > 0.5:
        return normals[GROUND] * np.sign(normals[GROUND] @ back)
    if abs(float(up @ back)) > 0.3:
        return up * np.sign(float(up @ back))
    axes = np.eye(3)
    along = axes @ back
    nearest = int(np.argmax(np.abs(along)))
    return axes[nearest] * np.sign(along[nearest])
