"""Pitch points and tooth forces of gears, bevel pairs and racks, against the formulas of textbooks."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import mechsim as ms
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.meshes import meshes_of, threads_of

Z, X = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
ANGLE = np.deg2rad(20.0)


def hinge(name, position=(0.0, 0.0, 0.0), axis=Z):
    return ms.Joint(name, "revolute", ms.End(GROUND, position, axis), ms.End(name, (0.0, 0.0, 0.0), axis))


def slide(name, position, axis):
    return ms.Joint(name, "prismatic", ms.End(GROUND, position, axis), ms.End(name, (0.0, 0.0, 0.0), axis))


def mechanism(joints, gears=(), couplings=()):
    links = tuple(ms.Link(joint.b.link) for joint in joints)
    points = {"P": (joints[0].b.link, (0.05, 0.0, 0.0))}
    return ms.Mechanism("pair", links, joints, joints[0].name, points, gears, couplings=couplings)


def pair(second, ratio, angle=ANGLE):
    (mesh,) = meshes_of(
        mechanism((hinge("one"), second), (ms.Gear("one", second.name, ratio, 0.0, angle),))
    ).values()
    return mesh


def test_tooth_forces_of_an_external_pair_separate_the_wheels():
    mesh = pair(hinge("two", (0.03, 0.0, 0.008)), -0.5)
    # radii 10 and 20 mm; the middle of both along their shafts
    assert_allclose(mesh.point, (0.01, 0.0, 0.004), atol=1e-16)
    assert (mesh.driven.link, mesh.driver.link, mesh.carrier) == ("two", "one", GROUND)
    # 1 N m on the second wheel, 20 mm to its left
    assert_allclose(mesh.tangential, (0.0, -1.0 / 0.02, 0.0), atol=1e-13)
    assert_allclose(mesh.separating, (np.tan(ANGLE) / 0.02, 0.0, 0.0), atol=1e-13)


def test_the_tooth_force_of_a_ring_points_to_the_shaft_of_the_pinion():
    # a pinion of 10 mm in a ring of 20 mm whose shaft lies 10 mm to the right
    mesh = pair(hinge("ring", (0.01, 0.0, 0.0)), 0.5)
    assert_allclose(mesh.point, (-0.01, 0.0, 0.0), atol=1e-16)
    assert_allclose(mesh.tangential, (0.0, -1.0 / 0.02, 0.0), atol=1e-13)
    # on the ring outwards, away from both shafts
    assert_allclose(mesh.separating, (-np.tan(ANGLE) / 0.02, 0.0, 0.0), atol=1e-13)


@pytest.mark.parametrize("radius", [0.02, -0.02])
def test_the_tooth_force_of_a_rack_points_away_from_the_shaft(radius):
    joints = hinge("pinion", (0.1, 0.2, 0.3)), slide("rack", (0.5, 0.2, 0.7), X)
    mesh_law = ms.Coupling("mesh", "rack", "pinion", (0.0, radius), pressure_angle=ANGLE)
    (mesh,) = meshes_of(mechanism(joints, couplings=(mesh_law,))).values()
    assert_allclose(mesh.point, (0.1, 0.2 - radius, 0.3), atol=1e-16)
    assert_allclose(mesh.tangential, X, atol=1e-14)
    assert_allclose(mesh.separating, (0.0, -np.sign(radius) * np.tan(ANGLE), 0.0), atol=1e-14)


def test_tooth_forces_of_a_bevel_pair_agree_with_a_textbook():
    """Radial F tan a cos d and axial F tan a sin d, on a pinion of cone angle d away from the apex."""
    # shafts along x and z meet in the origin; the pinion turns twice as fast
    ratio = -0.5
    joints = hinge("pinion", (0.04, 0.0, 0.0), X), hinge("wheel", (0.0, 0.0, 0.02), Z)
    (mesh,) = meshes_of(mechanism(joints, (ms.Gear("pinion", "wheel", ratio, 0.0, ANGLE),))).values()
    assert_allclose(mesh.point, (0.04, 0.0, 0.02), atol=1e-16)
    cone = np.arctan2(0.02, 0.04)
    tangential = 1.0 / 0.04
    assert_allclose(np.linalg.norm(mesh.tangential), tangential, rtol=1e-14)
    assert_allclose(mesh.tangential[[0, 2]], 0.0, atol=1e-14)
    on_pinion = -mesh.separating
    axial, radial = on_pinion[0], on_pinion[2]
    assert_allclose(axial, tangential * np.tan(ANGLE) * np.sin(cone), rtol=1e-13)
    assert_allclose(radial, -tangential * np.tan(ANGLE) * np.cos(cone), rtol=1e-13)


@pytest.mark.parametrize(
    ("second", "ratio"),
    [
        (hinge("two", (0.03, 0.0, 0.0)), 1.0),
        (hinge("two", (0.0, 0.0, 0.1)), -2.0),
        (hinge("two", (0.0, 0.03, 0.0), X), -2.0),
        (hinge("two", (0.0, 0.0, 0.0), X), -2.0),
    ],
    ids=["positive ratio", "coaxial shafts", "skew shafts", "joints at the apex"],
)
def test_gears_without_a_pitch_point_have_no_tooth_forces(second, ratio):
    assert meshes_of(mechanism((hinge("one"), second), (ms.Gear("one", "two", ratio),))) == {}


def test_polynomials_and_screws_have_no_tooth_forces():
    joints = hinge("pinion"), slide("rack", (0.0, 0.1, 0.0), X), slide("along", (0.0, 0.1, 0.0), Z)
    plain = ms.Coupling("law", "rack", "pinion", (0.0, 0.02))
    leant = ms.Coupling("leant", "along", "pinion", (0.0, 0.02), pressure_angle=0.0)
    assert meshes_of(mechanism(joints, couplings=(plain, leant))) == {}
    screw = ms.Joint("thread", "screw", ms.End("pinion"), ms.End("nut"), lead=0.004)
    made = mechanism((hinge("pinion"), screw))
    assert meshes_of(made) == {}
    assert threads_of(made) == {"thread.turn-thread.way": screw}
