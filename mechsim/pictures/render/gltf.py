"""A motion as a binary glTF file (.glb): the links as meshes whose poses change over time, y up.

Source: Khronos Group, "glTF 2.0 specification", 2021, sections 3 and 4.4.
"""

import json
from collections import defaultdict
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.files import write_content
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism, unit_vector
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.pictures.render.frame_poses import frame_poses
from mechsim.pictures.render.look import Look
from mechsim.shapes.body import free_sides, travels
from mechsim.shapes.camera import upright
from mechsim.shapes.joints import link_shapes
from mechsim.shapes.shape import Shape, across_of

# parts around a round shape, and from a pole to the equator of a ball
AROUND, TO_EQUATOR = 24, 6
# component types and buffer targets of the format
FLOAT, UNSIGNED, VERTICES, INDICES = 5126, 5125, 34962, 34963
TYPE_OF_WIDTH = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
TRIANGLES = np.array([[0, 1, 2], [2, 1, 3]], dtype=np.uint32)


def write_gltf(
    path: str | PathLike[str],
    mechanism: Mechanism,
    motion: Motion,
    look: Look | None = None,
    *,
    fps: float = 30.0,
    every: int = 1,
) -> int:
    """Write a motion as .glb; return the number of its frames.

    Args:
        path: of the file.
        mechanism: the mechanism.
        motion: its motion; between frames the viewer interpolates.
        look: of it count `bodies`, `forces` and `up`; None is the default.
        fps: frames per second.
        every: number of samples from one frame to the next.

    Raises:
        OutputError: where the file cannot be written.
    """
    look = look or Look()
    poses = frame_poses(mechanism, motion, every=every).poses
    travel, sides = travels(mechanism, poses), free_sides(mechanism, poses)
    bodies = look.bodies or link_shapes(mechanism, travel, sides, look.forces)
    file = _File()
    stated = look.up or mechanism.up
    up = unit_vector(stated) if stated else upright(mechanism)
    across = across_of(np.array([1.0, 0.0, 0.0]), up)
    orientation = Pose(np.zeros(3), np.array([across, up, np.cross(across, up)]))
    root = {"name": mechanism.name, "rotation": _quaternions(orientation.rotation[None])[0].tolist()}
    file.add("nodes", root)
    frames = next(len(pose.position) for name, pose in poses.items() if name != GROUND)
    times = file.accessor(np.arange(frames)[:, None] / fps, bounds=True)
    for link, shapes in bodies.items():
        if shapes:
            node = file.add("nodes", {"name": link, "mesh": file.mesh(shapes)})
            if link != GROUND:
                file.move(node, times, poses[link])
    root["children"] = list(range(1, len(file.tables["nodes"])))
    write_content(Path(path), file.packed(mechanism.name))
    return frames


class _File:
    """The parts of a file: its tables in JSON, whose entries name others by their index, and its numbers."""

    def __init__(self) -> None:
        self.tables = defaultdict[str, list[dict[str, Any]]](list)
        self.bytes = bytearray()

    def add(self, table: str, entry: dict[str, Any]) -> int:
        """Add an entry to a table and return its index."""
        self.tables[table].append(entry)
        return len(self.tables[table]) - 1

    def accessor(self, values: NDArray[Any], target: int | None = None, *, bounds: bool = False) -> int:
        """Add numbers (n, width) and return their index; indices of vertices stay integers."""
        whole = np.issubdtype(values.dtype, np.integer)
        stored = np.ascontiguousarray(values, dtype="<u4" if whole else "<f4")
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": stored.nbytes}
        index = self.add("bufferViews", view | ({} if target is None else {"target": target}))
        self.bytes += stored.tobytes()
        count, width = stored.shape
        described = {"componentType": UNSIGNED if whole else FLOAT, "type": TYPE_OF_WIDTH[width]}
        if bounds:
            described |= {"min": stored.min(0).tolist(), "max": stored.max(0).tolist()}
        return self.add("accessors", {"bufferView": index, "count": count, **described})

    def mesh(self, shapes: Sequence[Shape]) -> int:
        """Add the mesh of a link and return its index."""
        primitives: list[dict[str, Any]] = []
        for shape in shapes:
            points, normals, faces = triangles(shape)
            attributes = {"POSITION": self.accessor(points, VERTICES, bounds=True)}
            if normals is not None:
                attributes["NORMAL"] = self.accessor(normals, VERTICES)
            indices = self.accessor(faces.astype(np.uint32).reshape(-1, 1), INDICES)
            material = self._material(shape.rgba)
            primitives.append({"attributes": attributes, "indices": indices, "material": material})
        return self.add("meshes", {"primitives": primitives})

    def _material(self, rgba: Sequence[float]) -> int:
        # colours of shapes are those of screens (sRGB); the format has linear ones
        linear = [*(channel**2.2 for channel in rgba[:3]), rgba[3]]
        surface = {"baseColorFactor": linear, "metallicFactor": 0.0, "roughnessFactor": 0.6}
        material: dict[str, Any] = {"pbrMetallicRoughness": surface, "doubleSided": True}
        if rgba[3] < 1.0:
            material["alphaMode"] = "BLEND"
        own = self.tables["materials"]
        return own.index(material) if material in own else self.add("materials", material)

    def move(self, node: int, times: int, poses: Pose) -> None:
        """Add the motion of a node."""
        for path, values in (("translation", poses.position), ("rotation", _quaternions(poses.rotation))):
            sampler = self.add("samplers", {"input": times, "output": self.accessor(values)})
            self.add("channels", {"sampler": sampler, "target": {"node": node, "path": path}})

    def packed(self, name: str) -> bytes:
        """Return the bytes of the file: a header, the tables, the numbers."""
        motion = {"name": "motion", **{kind: self.tables[kind] for kind in ("samplers", "channels")}}
        content = {
            "asset": {"version": "2.0", "generator": "mechsim"},
            "scene": 0,
            "scenes": [{"name": name, "nodes": [0]}],
            **{kind: self.tables[kind] for kind in ("nodes", "meshes", "materials")},
            "animations": [motion],
            **{kind: self.tables[kind] for kind in ("accessors", "bufferViews")},
            "buffers": [{"byteLength": len(self.bytes)}],
        }
        text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        head = np.array([12 + 8 + len(text) + 8 + len(self.bytes), len(text)], dtype="<u4").tobytes()
        length = np.array([len(self.bytes)], dtype="<u4").tobytes()
        return b"glTF\x02\0\0\0" + head + b"JSON" + text + length + b"BIN\0" + bytes(self.bytes)


def _quaternions(rotations: Array) -> Array:
    """Return unit quaternions (n, 4), scalar last, of rotations (n, 3, 3), without jumps of sign."""
    from scipy.spatial.transform import Rotation

    # a copy: scipy 1.15 rejects arrays that are read-only
    values = Rotation.from_matrix(np.array(rotations)).as_quat()
    opposite = np.sum(values[1:] * values[:-1], axis=1) < 0.0
    return values * np.cumprod([1.0, *np.where(opposite, -1.0, 1.0)])[:, None]


def triangles(shape: Shape) -> tuple[Array, Array | None, NDArray[Any]]:
    """Return points (n, 3), their normals, None for flat facets, and faces (m, 3) in a link's frame."""
    if shape.facets is not None:
        return shape.facets.vertices, None, shape.facets.faces
    if shape.kind == "box":
        points, normals, faces = _box(shape.half_sizes)
    else:
        points, normals, faces = _revolved(*_profile(shape))
    return shape.centre + points @ shape.frame.T, normals @ shape.frame.T, faces


def _box(half_sizes: Sequence[float]) -> tuple[Array, Array, NDArray[Any]]:
    points, normals, ends = list[Array](), list[Array](), (-1.0, 1.0)
    for axis, along in zip(np.eye(3), np.roll(np.eye(3), 1, axis=0), strict=True):
        for normal in (-axis, axis):
            across = np.cross(normal, along)
            points += [normal + a * along + b * across for b in ends for a in ends]
            normals += [normal] * 4
    faces = TRIANGLES + 4 * np.arange(6, dtype=np.uint32)[:, None, None]
    return np.array(points) * half_sizes, np.array(normals), faces.reshape(-1, 3)


def _profile(shape: Shape) -> tuple[Array, Array]:
    """Return points (k, 2) and normals (k, 2) of half a section: distance from the axis, height."""
    radius, half = shape.sizes[0], 0.0 if shape.kind == "sphere" else shape.half_sizes[1]
    if shape.kind == "cylinder":
        points = np.array([[0, -1], [1, -1], [1, -1], [1, 1], [1, 1], [0, 1]]) * [radius, half]
        return points, np.array([[0, -1], [0, -1], [1, 0], [1, 0], [0, 1], [0, 1]], dtype=np.float64)
    quarter = np.linspace(0.0, np.pi / 2.0, TO_EQUATOR + 1)
    latitude, end = np.concatenate([-quarter[::-1], quarter]), np.repeat([-half, half], TO_EQUATOR + 1)
    normals = np.stack([np.cos(latitude), np.sin(latitude)], -1)
    return radius * normals + np.stack([np.zeros_like(end), end], -1), normals


def _revolved(profile: Array, normals: Array) -> tuple[Array, Array, NDArray[Any]]:
    """Return points, normals and faces of a section that turns about the z axis."""
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)
    around = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], -1)
    swept = [(each[:, None, [0, 0, 1]] * around).reshape(-1, 3) for each in (profile, normals)]
    row, column = np.meshgrid(np.arange(len(profile) - 1), np.arange(AROUND), indexing="ij")
    first = (row * (AROUND + 1) + column).reshape(-1, 1, 1)
    corners = np.array([0, 1, AROUND + 1, AROUND + 2])
    return swept[0], swept[1], (first + corners[TRIANGLES]).reshape(-1, 3)
