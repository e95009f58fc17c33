"""A body made of triangles, and the same with fewer of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class Facets:
    """Triangles in a link's frame.

    Attributes:
        vertices: (n, 3) in [m].
        faces: indices of vertices, (m, 3).
    """

    vertices: Array
    faces: NDArray[np.int32]

    @property
    def corners(self) -> Array:
        """The corners of the box along the axes that holds it, (8, 3)."""
        low, high = self.vertices.min(0), self.vertices.max(0)
        return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T

    def coarser(self, cell: float) -> "Facets":
        """Return it with all vertices within a cell of a grid made one, at their middle; cells in [m]."""
        keys, of = np.unique(np.round(self.vertices / cell), axis=0, return_inverse=True)
        of = of.reshape(-1)
        count = np.bincount(of, minlength=len(keys))[:, None]
        middle = np.column_stack([np.bincount(of, column, len(keys)) for column in self.vertices.T]) / count
        faces = of[self.faces]
        kept = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        return Facets(middle, faces[kept].astype(np.int32))
