"""Teeth of bevel gears and of racks lie in each other's gaps at every angle."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.links import IDENTITY as STANDING
from mechsim.shapes.joints import link_shapes

ANGLES = np.linspace(0.0, 2.0 * np.pi, 25)
AXES = np.array([[0.2, 0.1, 1.0], [1.0, 0.3, -0.4]])
AXES /= np.linalg.norm(AXES, axis=1)[:, None]
APEX = np.array([0.01, -0.02, 0.03])


def shafts(heights, carried):
    """Return two shafts that intersect at the apex; the frame or the first shaft carries the second."""
    points = [tuple(APEX + height * axis) for height, axis in zip(heights, AXES, strict=True)]
    first, second = (tuple(axis) for axis in AXES)
    joints = (
        ms.Joint("one", "revolute", ms.End(GROUND, points[0], first), ms.End("one", points[0], first)),
        ms.Joint("two", "revolute", ms.End(carried, points[1], second), ms.End("two", points[1], second)),
    )
    links = ms.Link("one"), ms.Link("two")
    guess = {link.name: STANDING for link in links}
    points, gears = {"P": ("two", (0.02, 0.0, 0.0))}, (ms.Gear("one", "two", -1.5, 0.4),)
    return ms.Mechanism("bevel", links, joints, "one", points, guess=guess, gears=gears)


def outer_tooth_ends(mechanism, link, poses):
    """Return the outer ends of the teeth, which point at the apex, in the world, (teeth, n, 3)."""
    boxes = [shape for shape in link_shapes(mechanism)[link] if shape.kind == "box"]
    local = [
        np.array(box.to) for box in boxes if np.linalg.norm(np.cross(box.frm - APEX, box.to - APEX)) < 1e-12
    ]
    assert len(local) == len(boxes) > 10
    return np.array([np.broadcast_to(poses[link].point(point), (len(ANGLES), 3)) for point in local])


@pytest.mark.parametrize("heights", [(0.03, 0.05), (0.0, 0.0), (0.04, 0.0), (-0.03, 0.04)])
@pytest.mark.parametrize("carried", [GROUND, "one"])
def test_teeth_of_bevel_gears_mesh_at_every_angle(heights, carried):
    mechanism = shafts(heights, carried)
    motion = ms.loops.solve(mechanism, ANGLES)
    poses = {name: ms.Pose(link.position, link.rotation) for name, link in motion.links.items()}
    poses[GROUND] = STANDING
    arm = np.broadcast_to(np.eye(3), (len(ANGLES), 3, 3)) if carried == GROUND else poses["one"].rotation
    wheels = ("one", "two") if carried == GROUND else (GROUND, "two")
    axes = [np.broadcast_to(AXES[0], (len(ANGLES), 3)), arm @ AXES[1]]
    rims = [outer_tooth_ends(mechanism, link, poses) - APEX for link in wheels]
    slants = [np.linalg.norm(rim, axis=2) for rim in rims]
    assert np.ptp(np.concatenate(slants)) < 1e-12
    cosines = [
        float((rim[0] * axis).sum(1)[0] / slants[0][0, 0]) for rim, axis in zip(rims, axes, strict=True)
    ]
    # the line that has both cones' angles to the axes: the cones touch, they do not cross
    square = np.array([[1.0, AXES[0] @ AXES[1]], [AXES[0] @ AXES[1], 1.0]])
    factors = np.linalg.solve(square, cosines)
    line = factors[0] * axes[0] + factors[1] * axes[1]
    np.testing.assert_allclose(np.linalg.norm(line, axis=1), 1.0, atol=1e-9)
    phases = []
    for rim, axis in zip(rims, axes, strict=True):
        tangent, out = np.cross(axis, line), line - axis * (line * axis).sum(1)[:, None]
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        out /= np.linalg.norm(out, axis=1)[:, None]
        angle = np.arctan2((rim[0] * tangent).sum(1), (rim[0] * out).sum(1))
        phases.append(angle * len(rim) / (2.0 * np.pi))
    direction = np.sign((np.cross(axes[0], line) * np.cross(axes[1], line)).sum(1))
    np.testing.assert_allclose((phases[0] - direction * phases[1]) % 1.0, 0.5, atol=1e-6)


def test_skew_shafts_have_no_bevel_gears():
    mechanism = shafts((0.03, 0.05), GROUND)
    first, second = mechanism.joints
    aside = tuple(np.add(second.a.point, 0.01 * np.cross(*AXES)))
    moved = replace(mechanism, joints=(first, replace(second, a=replace(second.a, point=aside))))
    assert not [shape for shape in link_shapes(moved)["one"] if shape.kind == "box"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_pinion_meshes_with_its_rack_over_the_whole_travel(sign):
    solver = ms.load("rack_steering")
    mesh = solver.mechanism.couplings[0]
    radius = 0.04
    coupling = ms.Coupling(mesh.name, mesh.left, mesh.right, (0.003, sign * radius), (0.001, 0.2))
    mechanism = replace(solver.mechanism, couplings=(coupling,))
    joints = {joint.name: joint for joint in mechanism.joints}
    shapes = link_shapes(mechanism, {"rack": (-0.05, 0.06)})
    spokes = [s for s in shapes["pinion"] if s.kind == "box" and s.thickness == (0.0, 0.0, 1.0)]
    spokes = [s for s in spokes if np.linalg.norm(s.to) > radius]
    teeth = [
        s for s in shapes["rack"] if s.kind == "box" and abs(s.frm[1] - s.to[1]) > abs(s.frm[0] - s.to[0])
    ]
    tooth = np.arctan2(spokes[0].to[1], spokes[0].to[0])
    step = 2.0 * np.pi * radius / len(spokes)
    shaft, slide = joints["pinion"].a.point, joints["rack"].a.point
    contact_angle = -0.5 * np.pi * sign
    assert {round(np.sign(s.to[1] - s.frm[1])) for s in teeth} == {-round(sign)}
    for angle in np.linspace(-1.0, 1.0, 9):
        displacement = 0.001 + 0.003 + sign * radius * (angle - 0.2)
        offset = (teeth[0].frm[0] + slide[0] + displacement - shaft[0]) / step
        rotated = (tooth + angle - contact_angle) * len(spokes) / (2.0 * np.pi)
        assert (offset - sign * rotated) % 1.0 == pytest.approx(0.5, abs=1e-6)
    ends = [t.frm[0] + slide[0] - shaft[0] for t in teeth]
    assert min(ends) < -0.06 - step
    assert max(ends) > 0.05 + step
