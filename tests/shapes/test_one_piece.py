from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mechsim import catalog, load
from mechsim.io import gallery
from mechsim.mechanism.joints import End, Gear, Joint
from mechsim.mechanism.links import GROUND, VIRTUAL_PREFIX, Link
from mechsim.mechanism.mechanism import Mechanism, unit_vector
from mechsim.pictures.render import scenery
from mechsim.shapes import camera
from mechsim.shapes.body import edges, planar_normals, rod_radius
from mechsim.shapes.joints import link_shapes


def pieces(shapes, radius):
    """Return groups of shapes that touch one another, as lists of indices."""
    spec = mujoco.MjSpec()
    spec.add_material(name=scenery.MATTE)
    for shape in shapes:
        frm, to = (tuple(np.divide(end, radius)) for end in (shape.frm, shape.to))
        sizes = tuple(length / radius for length in shape.sizes)
        facets = shape.facets and replace(shape.facets, vertices=shape.facets.vertices / radius)
        scaled = replace(shape, frm=frm, to=to, sizes=sizes, facets=facets)
        scenery.add_shape(spec, spec.worldbody.add_body(), scaled)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    piece = list(range(model.ngeom))
    for i in range(model.ngeom):
        for j in range(i):
            if piece[i] != piece[j] and mujoco.mj_geomDistance(model, data, i, j, 1.0, None) < 0.02:
                piece = [piece[j] if item == piece[i] else item for item in piece]
    return [[i for i, item in enumerate(piece) if item == number] for number in set(piece)]


def of_joints(*joints, travel=None, **couplings):
    links = dict.fromkeys(end.link for joint in joints for end in (joint.a, joint.b) if end.link != GROUND)
    outline = ((0.01, 0.003, 0.0), (0.05, -0.013, 0.0))
    mechanism = Mechanism(
        "own", tuple(Link(link, outline=outline) for link in links), joints, joints[0].name, {}, **couplings
    )
    return mechanism, link_shapes(mechanism, travel)


CRANK = Joint("crank", "revolute", End(GROUND), End("crank"))
SHAFT = Joint("crank", "revolute", End(GROUND, axis=(0.6, 0.0, 0.8)), End("crank"))
JOINT_KINDS = ("revolute", "prismatic", "cylindrical", "screw", "universal", "spherical", "planar", "fixed")
TRAVEL = {"held": (0.07, 0.09)}


def joint_pairs(kind, carrier):
    axis = (0.0, 1.0, 0.0) if kind == "prismatic" else (0.0, 0.0, 1.0)
    ends = End(carrier, (0.03, 0.02, 0.0), axis=axis), End("guest", (0.002, 0.01, 0.0), axis=axis)
    joint = Joint("held", kind, *ends, lead=0.01 if kind == "screw" else 0.0)
    return joint, replace(joint, a=joint.b, b=joint.a)


@pytest.mark.long
@pytest.mark.parametrize("name", [*catalog.MECHANISMS, *gallery.files()])
def test_every_link_is_drawn_in_one_piece(name):
    mechanism = load(name).mechanism
    for link, shapes in link_shapes(mechanism).items():
        # links without a body are equations
        hidden = link == GROUND or link.startswith(VIRTUAL_PREFIX)
        assert hidden or len(pieces(shapes, rod_radius(mechanism))) == 1, link


@pytest.mark.long
@pytest.mark.parametrize("first", [CRANK, SHAFT], ids=["flat", "spatial"])
@pytest.mark.parametrize("carrier", [GROUND, "crank"])
@pytest.mark.parametrize("kind", JOINT_KINDS)
def test_links_are_in_one_piece_with_joints_of_every_kind_and_order(kind, carrier, first):
    for joint in joint_pairs(kind, carrier):
        mechanism, shapes = of_joints(first, joint, travel=TRAVEL)
        for link in mechanism.links:
            assert len(pieces(shapes[link.name], rod_radius(mechanism))) == 1, link


@pytest.mark.parametrize("kind", JOINT_KINDS)
def test_shapes_on_the_ground_reach_the_floor_or_wall(kind):
    for first in (CRANK, SHAFT):
        for joint in joint_pairs(kind, GROUND):
            mechanism, shapes = of_joints(first, joint, travel=TRAVEL)
            radius, floor, ground = rod_radius(mechanism), -0.2, shapes[GROUND]
            flat = planar_normals(mechanism)
            if not flat:
                ground = [*ground, *camera.stands(ground, unit_vector("y"), floor, radius)]
            up = 2 if flat else 1
            lowest = np.array([shape.bounds[0][:, up].min() - shape.bounds[1] for shape in ground])
            for piece in pieces(ground, radius):
                assert lowest[piece].min() < lowest.min() + 1.5 * radius


def test_only_the_lowest_of_stacked_bearings_gets_a_post():
    axis = (0.0, 1.0, 0.0)
    sleeve = Joint("sleeve", "cylindrical", End(GROUND, axis=axis), End("guest", axis=axis))
    mechanism, shapes = of_joints(SHAFT, sleeve, travel={"sleeve": (0.0, 0.1)})
    radius = rod_radius(mechanism)
    stands = camera.stands(shapes[GROUND], unit_vector("y"), -0.2, radius)
    posts = [shape for shape in stands if shape.sizes[0] < 2.0 * radius]
    under = [post for post in posts if abs(post.frm[0]) < 1e-9 and abs(post.frm[2]) < 1e-9]
    assert len(posts) == 2
    assert [post.frm[1] < 0.0 for post in under] == [True]


@pytest.mark.long
@pytest.mark.parametrize("dimensions", [1, 2, 3])
@pytest.mark.parametrize("number", range(2, 10))
def test_rods_connect_all_points_of_a_link_without_crossing_them(number, dimensions):
    chance = np.random.default_rng(number)
    for _ in range(20):
        positions = np.zeros((number, 3))
        positions[:, :dimensions] = np.round(chance.normal(size=(number, dimensions)), chance.integers(1, 5))
        positions = list(np.unique(positions, axis=0))
        rods = [
            tuple(sorted(next(i for i, p in enumerate(positions) if p is end) for end in rod))
            for rod in edges(positions)
        ]
        piece = list(range(len(positions)))
        for i, j in rods:
            piece = [piece[i] if item == piece[j] else item for item in piece]
            direction = positions[j] - positions[i]
            for k in set(range(len(positions))) - {i, j}:
                share = (positions[k] - positions[i]) @ direction / (direction @ direction)
                off = np.linalg.norm(positions[i] + share * direction - positions[k])
                assert not (0.0 < share < 1.0 and off < 1e-12)
        assert len(set(rods)) == len(rods)
        assert len(set(piece)) == 1


def test_a_ring_and_its_planet_are_connected_to_their_links():
    axle = Joint("axle", "revolute", End("crank", (0.04, 0.0, 0.0)), End("planet"))
    ring = Joint("ring", "revolute", End(GROUND), End("ring"))
    arm = replace(CRANK, a=End("ring"))
    mechanism, shapes = of_joints(ring, arm, axle, gears=(Gear("crank", "axle", -2.5),))
    for link in ("ring", "planet"):
        assert len(shapes[link]) > 20, link
        assert len(pieces(shapes[link], rod_radius(mechanism))) == 1, link
