from dataclasses import replace

import numpy as np
import pytest
from drawing import draws
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.pictures import render
from mechsim.pictures.render import frame_poses as ghost
from mechsim.pictures.render import gl_backend, scenery
from mechsim.pictures.render.drawing import Source, draw
from mechsim.pictures.render.drawn_model import GHOST
from mechsim.pictures.render.frame_poses import frame_poses
from mechsim.shapes.body import span
from mechsim.studies.drawn_motion import drawn_motion, joint_loads
from mechsim.studies.motions import profile_of

ANGLES = np.linspace(0.0, 2.0 * np.pi, 25)
SIZE = (320, 240)
NONE: frozenset[str] = frozenset()


@pytest.fixture(scope="module")
def linkage():
    return ms.catalog.make("four_bar")


@pytest.fixture(scope="module")
def motion(linkage):
    return linkage.solve(ANGLES, 60.0)


def moved(motion: ms.Motion, link: str, by: np.ndarray) -> ms.Motion:
    """Return the motion with one displaced link."""
    other = replace(motion.links[link], position=motion.links[link].position + by)
    return replace(motion, source="step", links={**motion.links, link: other})


def test_a_position_error_is_measured_and_magnified(linkage, motion):
    displacement = np.array([2e-9, -1e-9, 0.0])
    run = frame_poses(linkage.mechanism, moved(motion, "rocker", displacement)).poses
    exact = frame_poses(linkage.mechanism, motion).poses
    result = ghost.errors(linkage.mechanism, run, exact, NONE)
    np.testing.assert_allclose(result["rocker"][0] + displacement, 0.0, atol=1e-15)
    assert np.abs(result["crank"][0]).max() == 0.0
    by = ghost.factor(linkage.mechanism, result)
    assert f"{by:e}".partition("e")[0] in ("1.000000", "2.000000", "5.000000")
    assert 0.1 < 2e-9 * by / (ghost.MAX_GHOST_DISTANCE * span(linkage.mechanism)) <= 1.0
    magnified = ghost.magnified(linkage.mechanism, run, result, by)["rocker"]
    shift = magnified.position - run["rocker"].position
    np.testing.assert_allclose(shift + displacement * by, 0.0, atol=1e-8)


@pytest.mark.parametrize("size", [1e-12, 1e-3, 1.0])
def test_a_rotation_error_is_magnified_about_its_axis(linkage, motion, size):
    axis = np.array([0.36, 0.48, 0.8])
    poses = frame_poses(linkage.mechanism, motion).poses
    crank = poses["crank"]
    by_axis = Rotation.from_rotvec(size * axis).as_matrix()
    rotated = {**poses, "crank": ms.Pose(crank.position, by_axis @ crank.rotation)}
    result = ghost.errors(linkage.mechanism, poses, rotated, NONE)
    np.testing.assert_allclose(result["crank"][1], np.tile(size * axis, (25, 1)), rtol=1e-3, atol=1e-15)
    twice = ghost.magnified(linkage.mechanism, poses, result, 2.0)["crank"]
    back = ghost.magnified(linkage.mechanism, rotated, result, 1.0)["crank"]
    np.testing.assert_allclose(twice.rotation, back.rotation, atol=2e-3 * size + 1e-15)


def test_an_idle_spin_is_no_error():
    linkage = ms.catalog.make("rssr")
    motion = linkage.solve(ANGLES, 60.0)
    poses = frame_poses(linkage.mechanism, motion).poses
    assert motion.spinning == {"coupler"}
    ends = [np.asarray(end.point) for end in linkage.mechanism.ends("coupler")]
    line = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    spun = poses["coupler"].rotation @ Rotation.from_rotvec(np.tile(0.7 * line, (25, 1))).as_matrix()
    first = poses["coupler"].point(tuple(ends[0]))
    other = {**poses, "coupler": ms.Pose(first - spun @ ends[0], spun)}
    assert np.abs(ghost.errors(linkage.mechanism, poses, other, NONE)["coupler"][1]).max() > 0.5
    direction, rotation = ghost.errors(linkage.mechanism, poses, other, motion.spinning)["coupler"]
    assert max(np.abs(direction).max(), np.abs(rotation).max()) < 1e-14


@pytest.mark.long
@draws
def test_the_ghost_is_visible_only_with_an_error(linkage, motion, monkeypatch):
    # a picture with a ghost has no shadow
    monkeypatch.setattr("mechsim.pictures.render.drawn_model.DrawnModel.stands_on_wall", False)

    def picture(run):
        return render.still(linkage.mechanism, run, exact=motion, size=SIZE, notes=False, labels=False)

    plain = render.still(linkage.mechanism, motion, size=SIZE, notes=False, labels=False)
    assert (np.abs(picture(motion).astype(int) - plain).max(2) > 60).mean() < 2e-3
    displacement = moved(motion, "rocker", np.array([1e-9, 0.0, 0.0]))
    # the frame includes the ghost, so the whole picture may shift: count dark pixels instead
    dark = [(item.max(2) < 110).sum() for item in (plain, picture(displacement))]
    assert dark[1] > dark[0] + 60
    assert GHOST[3] < 1.0


@pytest.mark.long
@draws
def test_an_arrow_ends_at_the_tip_of_its_vector(linkage):
    direction = np.array([0.3, 2.0, 4.1])
    motion = linkage.solve(direction, 60.0)
    force = np.column_stack([np.cos(3.0 * direction), np.sin(3.0 * direction), 0.0 * direction])
    forces = {"A": 80.0 * force}
    look = ms.Look(size=SIZE, notes=False, labels=False, paths=False, arrows=("force",))
    stage = Source(linkage.mechanism, motion, forces=forces).drawn(look)
    (drawn,) = stage.arrows
    pictures = []
    for arrows in ([drawn], []):
        stage.arrows = arrows
        pictures.append([picture.astype(int) for picture in draw(stage, gl_backend.choose())])
    for frame in range(3):
        start = stage.frames.points["A"][frame]
        tip = start + drawn.scale * forces["A"][frame]
        observed = np.argwhere(np.abs(pictures[0][frame] - pictures[1][frame]).max(2) > 40)[:, ::-1] + 0.5
        # an arrow drawn in front only changes the pixels it covers
        start, tip = stage.camera.pixel(start), stage.camera.pixel(tip)
        direction = (tip - start) / np.linalg.norm(tip - start)
        along, across = ((observed - start) @ np.column_stack([direction, direction[::-1] * [-1.0, 1.0]])).T
        assert along.max() == pytest.approx(np.linalg.norm(tip - start), abs=2.0)
        assert along.min() > -4.0
        assert abs(across.mean()) < 1.5


def test_forces_of_the_caller_are_drawn(linkage, motion):
    forces = {"B": np.ones((25, 3))}
    stage = Source(linkage.mechanism, motion, forces=forces).drawn(ms.Look(arrows=("force",)))
    assert stage.arrows[0].largest == pytest.approx(np.sqrt(3.0))
    # a joint that is no tracked point: its position is that on its link
    moments = {"rocker": np.ones((25, 3))}
    with_moments = Source(linkage.mechanism, motion, moments=moments).drawn(ms.Look(arrows=("moment",)))
    pivot = [linkage.ground, 0.0, 0.0]
    np.testing.assert_allclose(with_moments.frames.starts["rocker"], np.tile(pivot, (25, 1)))
    assert with_moments.arrows[0].legend[0].endswith("at most 1.73 N m")
    nan, few = {"B": np.full((25, 3), np.nan)}, {"B": np.ones((3, 3))}
    for wrong, match in ((nan, "holds NaN"), ({}, "no force to draw"), (few, r"give \(25, 3\) numbers")):
        with pytest.raises(ms.InputError, match=match):
            Source(linkage.mechanism, motion, forces=wrong).drawn(ms.Look(arrows=("force",)))


@pytest.mark.parametrize("name", ["rssr", "four_bar"])
def test_both_methods_give_the_same_joint_forces(name):
    linkage = ms.catalog.make(name)
    profile = profile_of(linkage, 60.0, 1.0)
    motion = drawn_motion(linkage, "closed", profile, 12)
    closed = joint_loads(linkage, "closed", profile, motion)
    simulated = joint_loads(linkage, "simulated", profile, motion)
    for kind, result in closed.items():
        largest = max(np.abs(force).max() for force in result.values())
        for joint, force in result.items():
            # both solve the poses to rounding; forces normal to the plane are undetermined
            other = simulated[kind][joint][:, :2]
            np.testing.assert_allclose(force[:, :2], other, atol=1e-6 * largest + 1e-12)


@pytest.mark.parametrize(("name", "none"), [("four_bar", True), ("rssr", False)])
def test_rounding_sized_moments_are_not_drawn(name, none):
    linkage = ms.catalog.make(name)
    profile = profile_of(linkage, 60.0, 1.0)
    loads = joint_loads(linkage, "closed", profile, drawn_motion(linkage, "closed", profile, 24))
    arrows = scenery.arrows("moment", loads["moments"], linkage.mechanism.characteristic_length)
    assert (arrows.legend[0] == "moment: none") == none
