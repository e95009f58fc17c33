"""The camera: where it looks from, how much it holds, and which pixel a point falls on.

Parallel projection throughout: a length across the picture has one scale everywhere, so a scale bar
tells the truth, and framing is exact.
"""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.model.link_poses import hinged_normals
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism, Up, unit_vector
from mechsim.numerics.arrays import Array

PRESETS = ("iso", "shaft", "top", "side")
# share of the picture kept free on each side for labels, scale bar and read-out
MARGIN = 0.09
# a shaft whose direction has this part along an axis stands along it
PARALLEL = 0.9


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera with parallel projection.

    Attributes:
        position: in [m], (3,).
        right: unit vector to the right of the picture, (3,).
        up: unit vector to its top, (3,).
        back: unit vector from the scene to the camera, (3,).
        height: of what the picture holds, in [m].
        size: of the picture (width, height) in pixels.
    """

    position: Array
    right: Array
    up: Array
    back: Array
    height: float
    size: tuple[int, int]

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return self.size[1] / self.height

    def pixel(self, points: Array) -> Array:
        """Return where points fall in the picture, x to the right and y down; (..., 3) -> (..., 2)."""
        off = points - self.position
        x = self.size[0] / 2.0 + self.scale * (off @ self.right)
        y = self.size[1] / 2.0 - self.scale * (off @ self.up)
        return np.stack([x, y], -1)


def upright(mechanism: Mechanism, up: Up | None = None) -> Array:
    """Return the unit vector that points up, (3,): of `up`, else the mechanism's own, else y.

    A mechanism that moves in one horizontal plane is drawn in that plane, its y axis up (z where y is
    vertical). Where nothing states what is up and the first driver's axis lies along y, z is up.
    """
    stated = up or mechanism.up
    vertical = unit_vector(stated or "y")
    standing = abs(float(_shaft(mechanism) @ vertical)) > PARALLEL
    if standing and (stated is None or hinged_normals(mechanism)):
        return _other_axis(vertical)
    return vertical


def _other_axis(vertical: Array) -> Array:
    """Return the y axis, or z where the vertical lies along y."""
    return unit_vector("y" if abs(float(vertical[1])) < PARALLEL else "z")


def directions(mechanism: Mechanism, preset: str, up: Up | None = None) -> tuple[Array, Array]:
    """Return (back, up) of a preset: unit vectors from scene to camera and to the top of the picture.

    `up` is the axis that points up, see `upright`.

    "shaft" looks along the crank shaft, the crank turning anticlockwise at positive speed; "top"
    and "side" look across it; "iso" looks from a corner, or, for a planar mechanism, straight on
    its plane.
    """
    if preset not in PRESETS:
        raise InputError(f"there is no camera {preset!r}; known are {', '.join(PRESETS)}")
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
    """Return the normal of the plane that all moves in, else the axis of the first driver."""
    normals = hinged_normals(mechanism)
    return normals[GROUND] if normals else np.asarray(mechanism.driven_joints[0].a.axis)


def framed(
    back: Array,
    up: Array,
    points: Array,
    radii: Array,
    size: tuple[int, int],
    margin: float = MARGIN,
    foot: float = 0.0,
) -> Camera:
    """Return the camera along `back` that holds balls about points, (n, 3) and (n,), with a margin.

    Of the picture's height the share `foot` stays free at the bottom, or the margin if that is more.
    """
    foot = max(0.0, foot - margin)
    right = np.cross(up, back)
    across, over, deep = points @ right, points @ up, points @ back
    left, width = _span(across, radii)
    bottom, height = _span(over, radii)
    share = 1.0 - 2.0 * margin
    held = max(height / (share - foot), width / share * size[1] / size[0])
    nearest = float((deep + radii).max())
    centre = (left + width / 2.0) * right + (bottom + (height - foot * held) / 2.0) * up
    return Camera(centre + (nearest + held) * back, right, up, back, held, size)


def nice(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is no longer than a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= length * (1.0 + 1e-9)))


def _span(values: Array, radii: Array) -> tuple[float, float]:
    low, high = float((values - radii).min()), float((values + radii).max())
    return low, high - low
