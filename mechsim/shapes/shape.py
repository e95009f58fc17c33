"""A shape: a solid in a link's frame, and the colours of shapes."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.mechanism.links import Vector
from mechsim.numerics.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """Triangles in a link's frame.

    Attributes:
        vertices: (n, 3) in [m].
        faces: indices of vertices, (m, 3).
    """

    vertices: Array
    faces: NDArray[np.int32]

    @property
    def corners(self) -> Array:
        """The corners of its axis-aligned bounding box, (8, 3)."""
        low, high = self.vertices.min(0), self.vertices.max(0)
        return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T

    def coarser(self, grid_step: float) -> "TriangleMesh":
        """Return the mesh with all vertices in a grid cell merged at their centre; cells in [m]."""
        keys, group = np.unique(np.round(self.vertices / grid_step), axis=0, return_inverse=True)
        group = group.reshape(-1)
        count = np.bincount(group, minlength=len(keys))[:, None]
        middle = (
            np.column_stack([np.bincount(group, column, len(keys)) for column in self.vertices.T]) / count
        )
        faces = group[self.faces]
        kept = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        return TriangleMesh(middle, faces[kept].astype(np.int32))


Rgba = tuple[float, float, float, float]
Kind = Literal["capsule", "cylinder", "sphere", "box", "facets"]
Role = Literal["body", "bearing"]

# Okabe and Ito's colours, distinct for colour-blind eyes; the brightest is last, because it is pale on white
PALETTE: tuple[Rgba, ...] = (
    (0.835, 0.369, 0.000, 1.0),
    (0.000, 0.447, 0.698, 1.0),
    (0.000, 0.620, 0.451, 1.0),
    (0.902, 0.624, 0.000, 1.0),
    (0.800, 0.475, 0.655, 1.0),
    (0.337, 0.706, 0.914, 1.0),
    (0.941, 0.894, 0.259, 1.0),
)
STEEL: Rgba = (0.33, 0.35, 0.38, 1.0)
HOUSING: Rgba = (0.62, 0.64, 0.67, 1.0)
RUBBER: Rgba = (0.16, 0.16, 0.18, 1.0)


@dataclass(frozen=True, slots=True)
class Shape:
    """A solid in a link's frame ("ground": the world frame).

    Attributes:
        kind: capsule, cylinder and box extend from `frm` to `to`; a sphere has its centre at `frm`; facets
            have their own vertices.
        frm: start point in [m].
        to: end point in [m]; equal to `frm` for a sphere.
        sizes: (radius,), or for a box (half width, half thickness) in [m].
        rgba: colour, components 0 to 1.
        thickness: direction of the thickness of a box.
        role: "bearing" for a shape that a post can carry, else "body".
        facets: triangles of a shape of kind "facets".
    """

    kind: Kind
    frm: Vector
    to: Vector
    sizes: tuple[float, ...]
    rgba: Rgba
    thickness: Vector = (0.0, 0.0, 1.0)
    role: Role = "body"
    facets: TriangleMesh | None = None

    @property
    def centre(self) -> Array:
        """The centre, (3,) in [m]."""
        return (np.asarray(self.frm) + np.asarray(self.to)) / 2.0

    @property
    def half_sizes(self) -> tuple[float, ...]:
        """The sizes in the order of MuJoCo, in [m]."""
        if self.kind == "sphere":
            return self.sizes
        return (*self.sizes, float(np.linalg.norm(np.subtract(self.to, self.frm))) / 2.0)

    @property
    def frame(self) -> Array:
        """Axes in the link's frame as columns: width, thickness, from `frm` to `to`; (3, 3)."""
        along = np.subtract(self.to, self.frm)
        length = np.linalg.norm(along)
        if not length > 0.0:
            return np.eye(3)
        along = along / length
        thick = across_of(np.asarray(self.thickness), along)
        return np.column_stack([np.cross(thick, along), thick, along])

    @property
    def bounds(self) -> tuple[Array, float]:
        """Points whose balls of the returned radius contain the shape, (k, 3) and [m]."""
        if self.facets is not None:
            return self.facets.corners, 0.0
        if self.kind != "box":
            return np.array([self.frm, self.to]), self.sizes[0]
        corners = np.array(np.meshgrid(*((-h, h) for h in self.half_sizes))).reshape(3, -1)
        return self.centre + (self.frame @ corners).T, 0.0


def plate_of(edge: Array, half: Array, rgba: Rgba) -> Shape:
    """Return a plate of half a thickness, (3,), with an edge, (n, 3), that does not cross itself."""
    normal = half / np.linalg.norm(half)
    side = across_of(edge[1] - edge[0], normal)
    flat = edge @ side + 1j * (edge @ np.cross(normal, side))
    if (flat.conj() * np.roll(flat, -1)).imag.sum() < 0.0:
        edge, flat = edge[::-1], flat[::-1]
    n = len(edge)
    low, following, front = np.arange(n), np.roll(np.arange(n), -1), np.array(triangles(flat))
    rim = np.stack([low, low + n, following, following, low + n, following + n], 1).reshape(-1, 3)
    faces = np.vstack([front, front[:, ::-1] + n, rim]).astype(np.int32)
    facets, middle = TriangleMesh(np.vstack([edge + half, edge - half]), faces), vector(edge.mean(0))
    return Shape("facets", middle, middle, (0.0,), rgba, facets=facets)


def triangles(flat: NDArray[np.complex128]) -> list[tuple[int, int, int]]:
    """Return the triangles of a counterclockwise polygon, corners x + iy, (n,), whose ears are clipped.

    A polygon that does not cross itself has ears: corners whose triangle contains no other corner (Meisters,
    *Polygons have ears*, 1975). Of one that does, any corner is clipped.
    """
    ring, clipped, tried = list(range(len(flat))), list[tuple[int, int, int]](), 0
    while len(ring) > 2:
        if tried == len(ring) or _is_ear(flat[ring]):
            clipped.append((ring[0], ring[1], ring[2]))
            del ring[1]
            tried = -1
        ring, tried = [*ring[1:], ring[0]], tried + 1
    return clipped


def _is_ear(corners: NDArray[np.complex128]) -> bool:
    """Return whether the second corner of a polygon is convex, and its triangle contains no other corner."""
    starts = corners[:3, None]
    off = ((corners[[1, 2, 0], None] - starts).conj() * (corners[2:] - starts)).imag
    return bool(off[0, 0] > 0.0 and not (off[:, 1:] >= 0.0).all(0).any())


def across_of(direction: Array, axis: Array) -> Array:
    """Return the unit component of a direction perpendicular to an axis, or any such unit vector."""
    for candidate in (direction, *np.eye(3)):
        across = candidate - axis * (candidate @ axis)
        length = float(np.linalg.norm(across))
        if length > 1e-6:
            return across / length
    raise AssertionError("three coordinate axes cannot all lie along one axis")


def pale(colour: Rgba) -> Rgba:
    """Return a colour mixed with white."""
    r, g, b, a = colour
    return (0.62 + 0.38 * r, 0.62 + 0.38 * g, 0.62 + 0.38 * b, a)


def vector(point: ArrayLike, by: ArrayLike = 0.0) -> Vector:
    """Return a point, shifted by a vector, as three plain numbers."""
    x, y, z = (np.asarray(point, dtype=np.float64) + np.asarray(by)).tolist()
    return (x, y, z)
