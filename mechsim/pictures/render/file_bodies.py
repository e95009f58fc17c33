"""The bodies of a user's MJCF file as it draws them: geoms and meshes in the colours of their materials."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypedDict

import mujoco
import numpy as np

from mechsim.model.links import Pose
from mechsim.numerics.arrays import Array
from mechsim.shapes import Kind, Rgba, Shape, TriangleMesh
from mechsim.shapes.shape import vector
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.simulation.mjcf_reader import MjcfModel
from mechsim.simulation.mjcf_reader.kinematic_tree import carriers, shifted

ROUND: Mapping[int, Kind] = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
}
BOX, BALL, MESH = (
    int(kind)
    for kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID, mujoco.mjtGeom.mjGEOM_MESH)
)
# MuJoCo shows these groups of geoms by default; collision shapes lie in the others
SHOWN = 2
# a mesh of more triangles is made coarser
MAX_TRIANGLES = 60_000
# first step of the grid that merges vertices, relative to the extent of all bodies
FIRST_GRID_STEP = 1.0 / 400.0
# what is lighter is drawn as light as this: lit from the front it would look like the paper behind
LIGHTEST, LIGHTNESS = 0.78, np.array([0.2126, 0.7152, 0.0722])
# meridians and parallels of an ellipsoid
ELLIPSOID = (24, 12)


class Drawn(TypedDict):
    """Fields of a look or a view that a user's MJCF file decides."""

    bodies: dict[str, list[Shape]] | None


def drawn_as(solver: object) -> Drawn:
    """Return how what was read from an MJCF file is drawn: with the file's bodies; all else as usual."""
    read = getattr(solver, "source", None)
    return {"bodies": file_bodies(read) if isinstance(read, MjcfModel) else None}


@quiet()
def file_bodies(read: MjcfModel) -> dict[str, list[Shape]] | None:
    """Return the bodies of a file's links, "ground" included; None where it draws nothing on them.

    Planes and height fields are left out. Materials give their colour, textures the mean of theirs.
    """
    model = plainly_compiled(read.spec.copy())
    carried = carriers(model)
    shown = [i for i in range(model.ngeom) if model.geom_group[i] <= SHOWN] or list(range(model.ngeom))
    bodies: dict[str, list[Shape]] = {}
    for i in shown:
        carrier = carried[model.geom_bodyid[i]]
        shape = _shape(model, i, shifted(carrier.pose, model.geom_pos[i], model.geom_quat[i]))
        if shape is not None:
            bodies.setdefault(carrier.link, []).append(shape)
    moving = {link.name for link in read.mechanism.links}
    return _few(bodies) if moving & bodies.keys() else None


def _shape(model: mujoco.MjModel, i: int, pose: Pose) -> Shape | None:
    kind, half_sizes, colour = int(model.geom_type[i]), model.geom_size[i], _colour(model, i)
    middle, along = pose.position, pose.rotation[:, 2]
    if kind in ROUND:
        half = 0.0 if ROUND[kind] == "sphere" else float(half_sizes[1])
        return Shape(
            ROUND[kind],
            vector(middle, -half * along),
            vector(middle, half * along),
            (float(half_sizes[0]),),
            colour,
        )
    if kind == BOX:
        ends = vector(middle, -half_sizes[2] * along), vector(middle, half_sizes[2] * along)
        return Shape(
            "box", *ends, (float(half_sizes[0]), float(half_sizes[1])), colour, vector(pose.rotation[:, 1])
        )
    facets = (
        _mesh(model, int(model.geom_dataid[i]))
        if kind == MESH
        else _ellipsoid(half_sizes)
        if kind == BALL
        else None
    )
    if facets is None:
        return None
    placed = TriangleMesh(middle + facets.vertices @ pose.rotation.T, facets.faces)
    return Shape("facets", vector(middle), vector(middle), (0.0,), colour, facets=placed)


def _mesh(model: mujoco.MjModel, mesh: int) -> TriangleMesh:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return TriangleMesh(
        np.array(model.mesh_vert[first : first + count], dtype=np.float64),
        np.array(model.mesh_face[face : face + faces]),
    )


def _ellipsoid(half_axes: Array) -> TriangleMesh:
    n, m = ELLIPSOID
    azimuth, height = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, n + 1), np.linspace(0.0, np.pi, m + 1))
    ball = np.stack([np.sin(height) * np.cos(azimuth), np.sin(height) * np.sin(azimuth), np.cos(height)], -1)
    row, column = (index.ravel() for index in np.meshgrid(range(m), range(n), indexing="ij"))
    a, b = row * (n + 1) + column, (row + 1) * (n + 1) + column
    faces = np.concatenate([np.stack([a, b, a + 1], -1), np.stack([a + 1, b, b + 1], -1)])
    return TriangleMesh(ball.reshape(-1, 3) * half_axes, faces.astype(np.int32)).coarser(
        1e-6 * float(half_axes.min())
    )


def _colour(model: mujoco.MjModel, i: int) -> Rgba:
    material = int(model.geom_matid[i])
    rgba = np.array(model.geom_rgba[i] if material < 0 else model.mat_rgba[material], dtype=np.float64)
    if material >= 0:
        texture = int(model.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
        if texture >= 0:
            first, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
            count = int(model.tex_width[texture]) * int(model.tex_height[texture]) * channels
            texels = model.tex_data[first : first + count].reshape(-1, channels)
            rgba[:3] *= np.broadcast_to(texels.mean(0)[: min(3, channels)], 3) / 255.0
    rgba = np.clip(rgba, 0.0, 1.0)
    rgba[:3] *= min(1.0, LIGHTEST / max(float(LIGHTNESS @ rgba[:3]), LIGHTEST))
    red, green, blue, alpha = rgba.tolist()
    return (red, green, blue, alpha)


def _few(bodies: Mapping[str, Sequence[Shape]]) -> dict[str, list[Shape]]:
    """Return bodies with no more triangles than a page can hold, their small features gone."""
    made = {link: list(shapes) for link, shapes in bodies.items()}
    whole = max((_extent(shape) for shapes in made.values() for shape in shapes), default=0.0)
    grid_step = FIRST_GRID_STEP * whole
    while sum(len(s.facets.faces) for shapes in made.values() for s in shapes if s.facets) > MAX_TRIANGLES:
        made = {link: [_coarser(shape, grid_step) for shape in shapes] for link, shapes in made.items()}
        grid_step *= 1.5
    return {link: [shape for shape in shapes if _is_visible(shape)] for link, shapes in made.items()}


def _is_visible(shape: Shape) -> bool:
    """Say whether anything is left of a shape; of a screw nothing may be. MuJoCo takes no mesh of less."""
    return shape.facets is None or (len(shape.facets.vertices) >= 4 and len(shape.facets.faces) > 0)


def _coarser(shape: Shape, grid_step: float) -> Shape:
    return replace(shape, facets=shape.facets.coarser(grid_step)) if shape.facets else shape


def _extent(shape: Shape) -> float:
    points, _ = shape.bounds
    return float(np.linalg.norm(np.ptp(points, axis=0)))
