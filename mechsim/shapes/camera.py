"""The camera: where it looks from, how much it holds, and which pixel a point falls on.

Parallel projection throughout: a length across the picture has one scale everywhere, so a scale bar
tells the truth, and framing is exact.
"""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import Mechanism
from mechsim.shapes.planar import planar_normals

PRESETS = ("iso", "shaft", "top", "side")

# share of the picture kept free on each side for labels, scale bar and read-out
MARGIN = 0.09


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


def directions(
    mechanism: Mechanism, preset: str, upwards: tuple[float, float, float] = (0.0, 1.0, 0.0)
) -> tuple[Array, Array]:
    """Return (back, up) of a preset: unit vectors from scene to camera and to the top of the picture.

    `upwards` is what stands upright where the shaft does not: Y, in most scenes of MuJoCo's Z.

    "shaft" looks along the crank shaft, the crank turning anticlockwise at positive speed; "top"
    and "side" look across it; "iso" looks from a corner, or, for a planar mechanism, straight on
    its plane.
    """
    if preset not in PRESETS:
        raise InputError(f"there is no camera {preset!r}; known are {', '.join(PRESETS)}")
    shaft = np.asarray(mechanism.driven_joints[0].a.axis)
    up = np.array(upwards)
    if abs(float(shaft @ up)) > 0.9:
        up = np.array([0.0, upwards[2], upwards[1]])
    up = up - shaft * (shaft @ up)
    up /= np.linalg.norm(up)
    flat = planar_normals(mechanism) is not None
    side = np.cross(up, shaft) if flat else np.cross(shaft, up)
    back = {
        "shaft": shaft,
        "top": up,
        "side": side,
        "iso": shaft if flat else 0.75 * shaft + 0.62 * up + 0.95 * side,
    }[preset]
    if preset == "top":
        up = -shaft if flat else -side
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    back = back / np.linalg.norm(back)
    return back, np.cross(back, right)


def framed(
    back: Array, up: Array, points: Array, radii: Array, size: tuple[int, int], margin: float = MARGIN
) -> Camera:
    """Return the camera along `back` that holds balls about points, (n, 3) and (n,), with a margin."""
    right = np.cross(up, back)
    across, over, deep = points @ right, points @ up, points @ back
    left, width = _span(across, radii)
    bottom, height = _span(over, radii)
    share = 1.0 - 2.0 * margin
    held = max(height / share, width / share * size[1] / size[0])
    nearest = float((deep + radii).max())
    centre = (left + width / 2.0) * right + (bottom + height / 2.0) * up
    return Camera(centre + (nearest + held) * back, right, up, back, held, size)


def nice(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is no longer than a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= length * (1.0 + 1e-9)))


def _span(values: Array, radii: Array) -> tuple[float, float]:
    low, high = float((values - radii).min()), float((values + radii).max())
    return low, high - low
