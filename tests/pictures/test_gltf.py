"""Motions as binary glTF, read back by the rules of the format without mechsim."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.pictures.render.gltf import write_gltf
from mechsim.shapes.shape import Shape

WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
TYPES = {5126: "<f4", 5125: "<u4"}
# positions are stored in single precision
SINGLE = 1e-6
RED = (1.0, 0.0, 0.0, 1.0)


def read(path):
    """Return the tables of a .glb file, and a function: index of an accessor -> its numbers."""
    data = path.read_bytes()
    assert data[:8] == b"glTF" + np.uint32(2).tobytes()
    total, length = np.frombuffer(data[8:16], "<u4")
    assert (total, total % 4, length % 4) == (len(data), 0, 0)
    tables = json.loads(data[20 : 20 + length])
    numbers = data[28 + length :]
    assert len(numbers) == tables["buffers"][0]["byteLength"]

    def values(index):
        accessor = tables["accessors"][index]
        view = tables["bufferViews"][accessor["bufferView"]]
        chunk = numbers[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(chunk, TYPES[accessor["componentType"]]).reshape(-1, WIDTHS[accessor["type"]])

    return tables, values


def moved(tables, values):
    """Return link -> (times, positions, rotations) in the file's frame, y up."""
    (animation,) = tables["animations"]
    motions = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        name = tables["nodes"][channel["target"]["node"]]["name"]
        motions.setdefault(name, {})[channel["target"]["path"]] = values(sampler["output"])
        motions[name]["times"] = values(sampler["input"])[:, 0]
    return motions


def triangles(tables, values, link):
    """Return the corners (m, 3, 3) of a link's triangles and their normals (m, 3, 3)."""
    (mesh,) = (tables["meshes"][node["mesh"]] for node in tables["nodes"] if node["name"] == link)
    corners, normals = [], []
    for primitive in mesh["primitives"]:
        faces = values(primitive["indices"]).reshape(-1, 3)
        corners.append(values(primitive["attributes"]["POSITION"])[faces])
        normals.append(values(primitive["attributes"]["NORMAL"])[faces])
    return np.concatenate(corners).astype(float), np.concatenate(normals).astype(float)


def test_links_move_as_solved_and_gravity_points_down_the_y_axis(tmp_path):
    ms.render("rssr", tmp_path / "rssr.glb", fps=24.0)
    tables, values = read(tmp_path / "rssr.glb")
    solver = ms.load("rssr")
    motion = solver.solve(np.linspace(0.0, 2.0 * np.pi, 73))
    root = Rotation.from_quat(tables["nodes"][0]["rotation"])
    links = moved(tables, values)
    for name, (link, local) in solver.mechanism.points.items():
        pose = links[link]
        np.testing.assert_allclose(pose["times"], np.arange(73) / 24.0, rtol=SINGLE)
        position = pose["translation"] + Rotation.from_quat(pose["rotation"]).apply(local)
        # both sides in the frame of the file
        np.testing.assert_allclose(
            root.apply(position), root.apply(motion.points[name].position), rtol=0.0, atol=SINGLE
        )
    np.testing.assert_allclose(np.linalg.det(root.as_matrix()), 1.0, atol=1e-12)
    # viewers interpolate from one quaternion to the next
    for pose in links.values():
        assert (np.sum(pose["rotation"][1:] * pose["rotation"][:-1], axis=1) > 0.0).all()


@pytest.mark.parametrize(("up", "axis"), [("z", 2), ("-x", 0), ("y", 1)])
def test_the_stated_axis_becomes_y(tmp_path, up, axis):
    ms.render("four_bar", tmp_path / "four_bar.glb", up=up)
    tables, _ = read(tmp_path / "four_bar.glb")
    stated = np.eye(3)[axis] * (-1.0 if up.startswith("-") else 1.0)
    np.testing.assert_allclose(
        Rotation.from_quat(tables["nodes"][0]["rotation"]).apply(stated), [0.0, 1.0, 0.0], atol=1e-12
    )


@pytest.mark.parametrize(
    ("kind", "sizes", "length", "volume"),
    [
        ("sphere", (0.02,), 0.0, 4.0 / 3.0 * np.pi * 0.02**3),
        ("cylinder", (0.02,), 0.1, np.pi * 0.02**2 * 0.1),
        ("capsule", (0.02,), 0.1, np.pi * 0.02**2 * 0.1 + 4.0 / 3.0 * np.pi * 0.02**3),
        ("box", (0.01, 0.03), 0.1, 8.0 * 0.01 * 0.03 * 0.05),
    ],
)
def test_meshes_are_closed_and_face_outwards(tmp_path, kind, sizes, length, volume):
    start = np.array([0.1, -0.2, 0.3])
    along = np.array([2.0, 3.0, 6.0]) / 7.0
    shape = Shape(kind, tuple(start), tuple(start + length * along), sizes, RED, (3.0, -2.0, 0.0))
    solver = ms.load("four_bar")
    motion = solver.solve(np.linspace(0.0, 1.0, 3))
    bodies = {link.name: [shape] for link in solver.mechanism.links}
    from mechsim.pictures.render import Look

    write_gltf(tmp_path / "shape.glb", solver.mechanism, motion, Look(bodies=bodies))
    corners, normals = triangles(*read(tmp_path / "shape.glb"), "crank")
    middle = start + 0.5 * length * along
    a, b, c = (corners - middle).swapaxes(0, 1)
    # 24 flat parts around lose 1.1 % of a circle, and 12 from pole to pole 1.2 % more of a ball
    assert np.sum(a * np.cross(b, c)) / 6.0 == pytest.approx(volume, rel=1e-5 if kind == "box" else 0.03)
    across = np.cross(b - a, c - a)
    area = np.linalg.norm(across, axis=1)
    faced = np.einsum("mi,mji->mj", across[area > 1e-12], normals[area > 1e-12])
    assert (faced > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=SINGLE)


def test_colours_are_linear_and_shared(tmp_path):
    ms.render("four_bar", tmp_path / "four_bar.glb")
    tables, _ = read(tmp_path / "four_bar.glb")
    colours = [material["pbrMetallicRoughness"]["baseColorFactor"] for material in tables["materials"]]
    assert len({tuple(colour) for colour in colours}) == len(colours)
    assert all(0.0 <= channel <= 1.0 for colour in colours for channel in colour)


def test_a_motion_that_cannot_be_drawn_leaves_no_file(tmp_path):
    solver = ms.load("four_bar")
    motion = solver.solve(np.linspace(0.0, 1.0, 3))
    motion.links["crank"].position[1] = np.nan
    with pytest.raises(ms.InputError, match="cannot be drawn"):
        write_gltf(tmp_path / "bad.glb", solver.mechanism, motion)
    assert list(tmp_path.iterdir()) == []
