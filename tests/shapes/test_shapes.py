from dataclasses import replace

import numpy as np
import pytest
from model_files import stated_mechanism

from mechsim import catalog, load, loops
from mechsim.mechanism.joints import End
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.links import IDENTITY as STANDING
from mechsim.mechanism.mechanism import unit_vector
from mechsim.mechanism.motion_plane import hinged_normals
from mechsim.shapes import camera
from mechsim.shapes.body import extent, free_sides, layers_of, planar_normals, rod_radius
from mechsim.shapes.joints import link_shapes
from mechsim.shapes.shape import PALETTE, Shape

NAMES = list(catalog.MECHANISMS)
ANGLES = np.linspace(0.0, 2.0 * np.pi, 73)


def mechanism_of(name):
    return catalog.make(name).mechanism


@pytest.mark.parametrize("name", NAMES)
def test_every_joint_lies_in_a_shape_of_both_its_links(name):
    mechanism = mechanism_of(name)
    shapes, normals = link_shapes(mechanism), planar_normals(mechanism)
    for end in (end for joint in mechanism.joints for end in (joint.a, joint.b) if end.link != GROUND):
        start, stop = (np.array([getattr(s, side) for s in shapes[end.link]]) for side in ("frm", "to"))
        # layers are separated along the normal
        normal = normals[end.link] if normals else np.zeros(3)
        flat = np.eye(3) - np.outer(normal, normal)
        off, along = (end.point - start) @ flat, (stop - start) @ flat
        share = np.clip((off * along).sum(1) / np.maximum((along**2).sum(1), 1e-300), 0.0, 1.0)
        distances = np.linalg.norm(off - share[:, None] * along, axis=1)
        assert distances.min() <= 2.7 * rod_radius(mechanism)


def test_platforms_are_plates_and_a_hanging_robot_has_its_base_above():
    for name in ("delta_robot", "stewart_gough"):
        mechanism = load(name).mechanism
        shapes, up = link_shapes(mechanism), np.array([0.0, 1.0, 0.0])
        (plate,) = (shape for shape in shapes["plate"] if shape.facets)
        joints = np.array([end.point for end in mechanism.ends("plate")])
        assert plate.facets is not None
        np.testing.assert_allclose(np.ptp(plate.facets.vertices, 0)[[0, 2]], np.ptp(joints, 0)[[0, 2]])
        ground = shapes["ground"]
        own = len(ground)
        bearings = np.array([shape.centre @ up for shape in ground if shape.role == "bearing"])
        links = ((mechanism.guess[link.name], shapes[link.name]) for link in mechanism.links)
        balls = extent([*links, (STANDING, ground)])
        floor = float((balls[0] @ up - balls[1]).min())
        camera.add_stands(ground, up, floor, rod_radius(mechanism), balls)
        heights = [end[1] for shape in ground[own:] for end in (shape.frm, shape.to)]
        if name == "delta_robot":
            assert min(heights) >= bearings.min() - 1e-12
        else:
            assert min(heights) == pytest.approx(floor)


def test_links_that_share_a_joint_lie_in_different_layers():
    heights = {}
    for link, shapes in link_shapes(mechanism_of("four_bar")).items():
        if link != GROUND:
            heights[link] = {round(float(shape.centre[2]), 9) for shape in shapes if shape.kind == "box"}
    assert all(len(height) == 1 for height in heights.values())
    assert heights["crank"].isdisjoint(heights["coupler"])
    assert heights["coupler"].isdisjoint(heights["rocker"])
    # Jansen's crank carries two links on one pin
    jansen = load("jansen").mechanism
    crank = jansen.crank.b.link
    pinned = {link for joint in jansen.joints if crank in joint.links for link in joint.links} - {GROUND}
    assert len(pinned) == len({layers_of(jansen)[link] for link in pinned}) == 3


@pytest.mark.parametrize("branch", [1, -1])
def test_the_default_rail_covers_the_full_stroke(branch):
    linkage = catalog.make("slider_crank", branch=branch)
    mechanism = linkage.mechanism
    rail = next(shape for shape in link_shapes(mechanism)[GROUND] if shape.kind == "box")
    displacement = linkage.solve(ANGLES).links["slider"].position[:, 0]
    assert min(rail.frm[0], rail.to[0]) < displacement.min()
    assert max(rail.frm[0], rail.to[0]) > displacement.max()


def test_a_rail_covers_a_given_stroke():
    mechanism = mechanism_of("slider_crank")
    rail = next(s for s in link_shapes(mechanism, {"slide": (0.1, 0.3)})[GROUND] if s.kind == "box")
    clearance = 4.0 * rod_radius(mechanism)
    assert sorted((rail.frm[0], rail.to[0])) == pytest.approx([0.1 - clearance, 0.3 + clearance])


def teeth_of(mechanism, link, centre, axis):
    """Return the angles from x of the outermost radial boxes, or of the innermost ones of a ring."""
    boxes = [s for s in link_shapes(mechanism)[link] if s.kind == "box" and s.thickness == axis]
    spokes = [np.array([s.frm, s.to])[:, :2] - centre for s in boxes]
    spokes = [s for s in spokes if abs(np.linalg.det(s)) < 1e-9 * np.linalg.norm(s) ** 2]
    sizes = [(np.linalg.norm(s, axis=1) * 1e6).round(2).tolist() for s in spokes]
    most = max(sizes, key=sizes.count)
    return np.array(
        [np.arctan2(*s[1][::-1]) for s, lengths in zip(spokes, sizes, strict=True) if lengths == most]
    )


def assert_mesh(motion, mechanism, wheels, inside):
    """Check that a tooth of one wheel faces a gap of the other: half a pitch apart, at any angle."""
    links = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()} | {
        GROUND: STANDING
    }
    centres = [np.atleast_2d(links[joint.b.link].point(joint.b.point)) for joint, _ in wheels]
    line = (centres[1] - centres[0])[:, :2]
    phases = []
    for (joint, link), sign in zip(wheels, (1.0, 1.0 if inside else -1.0), strict=True):
        end = joint.a if joint.a.link == link else joint.b
        teeth = teeth_of(mechanism, link, end.point[:2], (0.0, 0.0, 1.0))
        rotated = np.atleast_3d(links[link].rotation).reshape(-1, 3, 3)
        angle = np.arctan2(rotated[:, 1, 0], rotated[:, 0, 0]) + teeth[0]
        phases.append((np.arctan2(*(sign * line).T[::-1]) - angle) * len(teeth) / (2.0 * np.pi))
    off = (phases[0] + (-1.0 if inside else 1.0) * phases[1]) % 1.0
    np.testing.assert_allclose(off, 0.5, atol=1e-6)


def test_gears_mesh_at_every_crank_angle():
    linkage = catalog.make("warp_knitter")
    mechanism = linkage.mechanism
    first, second = (mechanism.joint(name) for name in ("crank", "crank2"))
    assert_mesh(linkage.solve(ANGLES), mechanism, ((first, "crank1"), (second, "crank2")), inside=False)


@pytest.mark.parametrize(("ring", "sun"), [(60, 24), (66, 18), (67, 19)])
def test_a_planet_meshes_with_its_sun_and_its_ring(ring, sun):
    planet = (ring - sun) / 2
    solver = load("planetary_gear", set={"teeth_sun": str(sun), "teeth_planet": str(planet)})
    gears = tuple(
        replace(gear, phase=phase) for gear, phase in zip(solver.mechanism.gears, (0.2, -0.5), strict=True)
    )
    mechanism = replace(solver.mechanism, gears=gears)
    motion = loops.solve(mechanism, ANGLES)
    carrier, planet, sun = (mechanism.joint(name) for name in ("carrier", "planet", "sun"))
    assert_mesh(motion, mechanism, ((planet, "planet"), (sun, "sun")), inside=False)
    assert_mesh(motion, mechanism, ((carrier, GROUND), (planet, "planet")), inside=True)


def test_a_planet_meshes_with_a_fixed_wheel():
    mechanism = load("planetary_gear").mechanism
    first, second = mechanism.gears
    gears = replace(first, ratio=1.5, phase=0.2), replace(second, ratio=-1.0 / 1.5, phase=0.1)
    mechanism = replace(mechanism, gears=gears)
    wheels = (mechanism.joint("carrier"), GROUND), (mechanism.joint("planet"), "planet")
    assert_mesh(loops.solve(mechanism, ANGLES), mechanism, wheels, inside=False)


def test_shafts_extend_to_the_side_without_links():
    linkage = catalog.make("rssr")
    motion = linkage.solve(ANGLES)
    sides = free_sides(linkage.mechanism, {GROUND: STANDING, **motion.links})
    # the coupler and rocker lie at positive x, where the crank shaft would be in their way
    assert sides["crank"] == -1.0


@pytest.mark.parametrize("kind", ["capsule", "cylinder", "box", "sphere"])
def test_bounds_contain_the_shape(kind):
    frm, to = (0.1, 0.2, -0.3), (0.4, -0.1, 0.2)
    to = frm if kind == "sphere" else to
    shape = Shape(kind, frm, to, (0.05, 0.02) if kind == "box" else (0.05,), PALETTE[0])
    points, radius = shape.bounds
    corners = shape.centre + (shape.frame @ np.diag(np.array([*shape.half_sizes, 0.0, 0.0])[:3])).T
    for corner in corners:
        assert ((points.min(0) - radius - 1e-12 <= corner) & (corner <= points.max(0) + radius + 1e-12)).all()


@pytest.mark.parametrize(
    ("axis", "stated", "expected"),
    [
        ("x", None, "y"),
        ("y", None, "z"),
        ("x", "z", "z"),
        ("z", "z", "z"),
        ("y", "y", "y"),
        ("x", "x", "x"),
        ("x", "-z", "-z"),
    ],
)
def test_floor_posts_and_camera_use_the_same_vertical(axis, stated, expected):
    shaft = {"axis": tuple(np.eye(3)["xyz".index(axis)])}
    leaving = stated_mechanism("shapes_ball.toml")
    crank, ball = leaving.joints
    crank = replace(crank, a=End(GROUND, **shaft), b=End("crank", **shaft))
    mechanism = replace(leaving, joints=(crank, ball), up=stated)
    vertical = unit_vector(expected)
    np.testing.assert_array_equal(camera.upright(mechanism), vertical)
    back, up = camera.directions(mechanism, "iso")
    assert up @ vertical > 0.5
    low, high = np.full(3, -0.05), np.full(3, 0.05)
    view = camera.framed(back, up, np.array([low, high]), np.zeros(2), (320, 240))
    floor = camera.backdrop(mechanism, view, vertical, low, high, 0.01)
    np.testing.assert_allclose(floor.normal, vertical)
    assert floor.point @ vertical == pytest.approx(-0.05)
    low, high, height = camera.lowered(low, high, vertical, 0.02)
    assert height == pytest.approx(-0.07)
    assert (high - low) @ np.abs(vertical) == pytest.approx(0.12)
    bearings = [shape for shape in link_shapes(mechanism)[GROUND] if shape.role == "bearing"]
    post, foot = camera.stands(bearings, vertical, -0.07, rod_radius(mechanism))
    assert foot.to @ vertical == pytest.approx(-0.07)
    across = np.flatnonzero(vertical == 0.0)
    np.testing.assert_allclose(np.take(post.frm, across), np.take(foot.to, across))


def test_planar_mechanisms_are_viewed_along_their_normal():
    flat = mechanism_of("slider_crank")
    ball = tuple(replace(joint, kind="spherical") if joint.name == "A" else joint for joint in flat.joints)
    for mechanism in (replace(flat, joints=ball), replace(flat, driver="slide", start=0.2)):
        back, up = camera.directions(mechanism, "iso")
        np.testing.assert_allclose((back, up), ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)), atol=1e-12)
    assert planar_normals(replace(flat, joints=ball)) is None
    # a ball that holds a link alone lets it leave the plane
    assert all(hinged_normals(mechanism_of(name)) is None for name in ("rssr", "rrsrr", "looper", "bennett"))


@pytest.mark.parametrize("name", ["slider_crank", "four_bar", "rssr"])
def test_the_clearest_pose_has_a_large_projected_area(name):
    solver = catalog.make(name)
    motion = solver.solve(ANGLES, 1.0)
    poses = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}
    poses[GROUND] = STANDING
    back, up = camera.directions(solver.mechanism, "iso")
    view = np.cross(up, back), up

    def area(index):
        ends = [end for joint in solver.mechanism.joints for end in (joint.a, joint.b)]
        points = [np.broadcast_to(poses[end.link].point(end.point), (len(ANGLES), 3))[index] for end in ends]
        return float(np.linalg.det(np.cov(np.array(points) @ np.column_stack(view), rowvar=False)))

    chosen = camera.clearest_pose(solver.mechanism, poses, view)
    areas = [area(i) for i in range(len(ANGLES))]
    assert areas[chosen] > 0.8 * max(areas)
    assert areas[chosen] >= areas[0]
