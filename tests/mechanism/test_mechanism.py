from dataclasses import replace
from pathlib import Path

import mechanisms
import numpy as np
import pytest
from hypothesis import given
from model_files import stated_mechanism
from strategies import EPS, offsets, turns

import mechsim as ms
from mechsim.errors import InputError
from mechsim.kinematics.vector_method.vectors import rotation
from mechsim.mechanism.joint_kinds import KINDS, coordinates, crossed_at_zero, displaced, kinds_that
from mechsim.mechanism.joints import End, Joint, joint_coordinate
from mechsim.mechanism.links import EX, EY, EZ, GROUND, IDENTITY, Link, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import plane_normals
from mechsim.mechanism.moved_links import moved_links


def joint(kind, a=GROUND, b="arm", **more):
    slanted = End(b, (0.01, 0.0, -0.02), axis=(1.0, 2.0, -2.0), reference=(0.0, 1.0, 1.0))
    return Joint("hinge", kind, End(a, (0.03, 0.01, 0.0), axis=(0.2, -0.4, 1.0)), slanted, **more)


def placed(joint, relative, along=0.0):
    """Return the pose of b with its joint frame at `relative` to a's, displaced by `along` along a's axis."""
    frame = joint.a.frame
    r = frame @ relative @ joint.b.frame.T
    return Pose(np.array(joint.a.point) + along * frame[:, 2] - r @ np.array(joint.b.point), r)


def test_an_end_normalises_its_directions():
    end = End("arm", axis=(0.0, 3.0, 4.0), reference=(1.0, 1.0, 1.0))
    assert np.abs(end.frame.T @ end.frame - np.eye(3)).max() <= 4 * EPS
    assert np.linalg.det(end.frame) == pytest.approx(1.0)
    assert end.axis == pytest.approx((0.0, 0.6, 0.8))
    assert End("arm", axis=(2.0, 0.0, 0.0)).reference == EY
    assert End("arm", axis=(0.0, 0.0, 2.0)).reference == EX


@given(turns)
def test_the_angle_of_a_revolute_joint_is_measured_between_references(angle):
    hinge = joint("revolute")
    pose = placed(hinge, rotation("z", angle))
    assert abs(joint_coordinate(hinge, IDENTITY, pose)[0] - angle) <= 8 * EPS * np.pi


@given(turns, turns)
def test_a_universal_joint_has_the_angles_about_its_two_axes(first, second):
    cross = joint("universal", cross_angle=1.1)
    relative = rotation("z", first) @ crossed_at_zero(cross.cross_angle) @ rotation("z", second)
    measured = joint_coordinate(cross, IDENTITY, placed(cross, relative))
    assert np.abs(measured - [first, second]).max() <= 16 * EPS * np.pi


def chain(**changes):
    fields = {
        "name": "chain",
        "links": (Link("arm"), Link("tip")),
        "joints": (
            Joint("crank", "revolute", End(GROUND), End("arm")),
            Joint("knee", "revolute", End("arm", (0.3, 0.0, 0.4)), End("tip")),
        ),
        "driver": "crank",
        "points": {"P": ("tip", (0.1, 0.0, 0.0))},
    }
    return Mechanism(**{**fields, **changes})


def test_rounding_does_not_set_the_characteristic_length():
    ends = End("arm", (0.1, 0.2, 0.3)), End("arm", (0.1, 0.1 + 0.1, 0.3 + 1e-17), axis=EX)
    hinges = (
        Joint("crank", "revolute", End(GROUND), ends[0]),
        Joint("out", "revolute", End(GROUND), ends[1]),
    )
    distinct = Joint("out", "revolute", End(GROUND), End("arm", (0.1, 0.2, 0.3 + 2e-16), axis=EX))
    points = {"P": ("arm", (0.1, 0.2, 0.7))}
    for joints in (hinges, (hinges[0], distinct)):
        assert Mechanism(
            "sphere", (Link("arm"),), joints, "crank", points
        ).characteristic_length == pytest.approx(0.4)


def test_the_characteristic_length_is_the_longest_distance_within_a_link():
    assert chain().characteristic_length == pytest.approx(0.5)
    assert [end.link for end in chain().ends("arm")] == ["arm", "arm"]


@pytest.mark.parametrize("kind", ["prismatic", "fixed"])
@given(turns, turns)
def test_a_slide_without_references_has_the_smallest_rotation(kind, first, second):
    a, b = (
        rotation("x", first) @ np.array([0.3, -0.2, 0.9]),
        rotation("y", second) @ np.array([0.1, 0.8, 0.4]),
    )
    made = Joint("slide", kind, End(GROUND, axis=tuple(a)), End("arm", axis=tuple(b)))
    rotated = made.a.frame @ made.b.frame.T
    assert np.abs(rotated @ made.b.axis - made.a.axis).max() <= 64 * EPS
    cosine = float(np.dot(made.a.axis, made.b.axis))
    # antiparallel axes have no smallest rotation, and near them it is ill-conditioned
    assert np.trace(rotated) == pytest.approx(1.0 + 2.0 * cosine, abs=1e-9)


@given(turns, turns)
def test_a_slide_without_references_keeps_mechanisms_planar(first, second):
    a, b = ((float(np.cos(item)), float(np.sin(item)), 0.0) for item in (first, second))
    for axis in (b, tuple(-item for item in a)):
        made = Joint("slide", "prismatic", End(GROUND, axis=a), End("arm", axis=axis))
        assert (made.a.frame @ made.b.frame.T)[2, 2] == pytest.approx(1.0, abs=1e-9)


def test_references_determine_the_orientation_of_a_slide():
    slanted = End(GROUND, axis=(0.6, 0.8, 0.0))
    made = Joint("slide", "prismatic", slanted, End("arm", axis=EX, reference=EZ))
    assert made.b.reference == EZ
    assert made.a.reference == pytest.approx((0.8, -0.6, 0.0))


SLIDE = Joint("slide", "prismatic", End(GROUND, axis=(1.0, 0.1, 0.2)), End("arm", axis=(0.2, 0.3, 1.0)))


def guessed(rotated, joint=SLIDE):
    guess = {"arm": Pose(np.zeros(3), rotated)}
    return Mechanism("slant", (Link("arm"),), (joint,), "slide", {}, guess=guess)


@given(turns)
def test_a_guess_selects_the_orientation_of_a_slide(about):
    by_itself = Joint("slide", "prismatic", SLIDE.a, End("arm", axis=SLIDE.b.axis, reference=EX))
    guesses = {}
    for expected in (SLIDE, by_itself):
        roughly = SLIDE.a.frame @ rotation("z", about) @ expected.b.frame.T
        # an inaccurate guess also tilts the axis
        guesses[expected.b.reference] = rotation("y", 0.3) @ roughly
    least = min(abs(about + item) for item in (0.0, 2.0 * np.pi, -2.0 * np.pi))
    for reference, orientation in guesses.items():
        if least < 0.4:
            result = guessed(orientation)
            assert result.joints[0].b.reference == pytest.approx(reference, abs=1e-15)
            assert result.with_guess({"arm": Pose(np.ones(3), orientation)}, 0.0).joints == result.joints
        elif least > 2.9:
            with pytest.raises(
                InputError, match="prismatic joint 'slide' has no reference, and the guess rotates"
            ):
                guessed(orientation)


def test_a_guess_does_not_change_slides_with_references():
    rotated = rotation("x", 1.7)
    for a, b in (((0.2, 0.3, 1.0), {"reference": EY}), (SLIDE.a.axis, {})):
        made = Joint("slide", "prismatic", SLIDE.a, End("arm", axis=a, **b))
        assert guessed(rotated, made).joints[0] == made


CROSS_ANGLE = 1.1


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@given(offsets, offsets, turns, turns)
def test_coordinates_are_the_inverse_of_displacements(kind, first, second, angle, other):
    lengths, angles = iter((first, second, first)), iter((angle, other))
    values = [next(lengths if unit == "m" else angles) for unit in kind.units]
    shift, rotation = displaced(kind, values, CROSS_ANGLE)
    result = coordinates(kind, shift, np.eye(3), rotation, CROSS_ANGLE)
    assert result.shape == (len(kind.units),)
    assert np.abs(result - values).max(initial=0.0) <= 16 * EPS * np.pi


def test_matching_joint_kinds_are_listed_by_name():
    assert kinds_that(lambda kind: kind.single).startswith("revolute or prismatic")
    assert kinds_that(lambda kind: kind.mixed).startswith("cylindrical")
    assert kinds_that(lambda kind: kind.dof > 6) == ""


LOOPER = Path(__file__).parents[2] / "models" / "looper.xml"
ANGLES = np.linspace(0.0, 6.0, 7)


@pytest.fixture(scope="module")
def solver():
    return ms.load(str(LOOPER))


def test_poses_of_virtual_bodies_follow_from_their_joints(solver):
    unseen = [link.name for link in solver.mechanism.links if not link.is_body]
    assert unseen == ["~slide.way"]
    everything = solver.whole_motion(ANGLES)
    for motion in (
        solver.solve(ANGLES),
        ms.simulate(solver, speed=1.0, turns=6.0 / (2 * np.pi), samples=6).motion,
    ):
        assert unseen[0] not in motion.links
        placed = moved_links(solver.mechanism, motion)
        for name, pose in placed.items():
            expected = everything.links[name]
            # rounding of a turn of six radians
            assert np.abs(pose.position - expected.position).max() < 1e-13, name
            assert np.abs(pose.rotation - expected.rotation).max() < 1e-12, name


def test_a_motion_must_contain_every_body(solver):
    motion = solver.solve(ANGLES)
    motion.links.pop("crank")
    with pytest.raises(ms.InputError, match="the motion has no pose of link 'crank'"):
        moved_links(solver.mechanism, motion)


def test_a_mechanism_is_planar_if_no_joint_leaves_the_plane():
    planar = [ms.catalog.make(name).mechanism for name in ("four_bar", "slider_crank")]
    planar.append(stated_mechanism("driven_mechanisms_boom.toml"))  # a cylinder drives it
    assert all(plane_normals(item) for item in [*planar, mechanisms.geared_five_bar()])
    spatial = [ms.catalog.make("rssr").mechanism, mechanisms.bennett(), mechanisms.rsup()]
    assert not any(plane_normals(item) for item in spatial)


@pytest.mark.parametrize("tilt", [1e-3, 1e-8])
def test_a_four_bar_with_a_slightly_tilted_axis_is_not_planar(tilt):
    mechanism = ms.catalog.make("four_bar").mechanism
    tilted = [
        replace(joint, b=replace(joint.b, axis=(tilt, 0.0, 1.0))) if joint.name == "rocker" else joint
        for joint in mechanism.joints
    ]
    assert plane_normals(replace(mechanism, joints=tuple(tilted))) is None


def test_plane_normals_are_expressed_in_the_frame_of_each_link():
    normals = plane_normals(stated_mechanism("motion_plane_arm.toml"))
    assert normals is not None
    assert {link: tuple(np.round(normal, 12) + 0.0) for link, normal in normals.items()} == {
        "arm": (0.0, 0.0, 1.0),
        GROUND: (0.0, -1.0, 0.0),
        "slider": (0.0, 1.0, 0.0),
    }
