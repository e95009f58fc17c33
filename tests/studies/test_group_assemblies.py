"""Every assembly by Assur groups, compared with circles, published poses and random starts."""

import numpy as np
import pytest
from model_files import load_model

import mechsim as ms
from mechsim.errors import InputError
from mechsim.kinematics.group_assemblies import group_assemblies
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.studies.assemblies import all_assembly_points

# the published triad of Gosselin and Merlet: six poses (x, y, angle), printed with six decimals
PUBLISHED = [
    (-15.150496, 5.144167),
    (-3.623487, 15.584298),
    (3.233389, -15.669882),
    (15.045358, -5.444005),
    (15.137333, 5.182774),
    (15.296369, 4.692663),
]


def poses_of(solver, angle):
    """Return the poses of the solver's own assembly."""
    links = KinematicSolver(solver.mechanism).solve([angle]).links
    poses = {name: Pose(link.position[0], link.rotation[0]) for name, link in links.items()}
    return {GROUND: IDENTITY, **poses}


def test_a_triad_has_its_six_published_poses():
    every = ms.assemblies(load_model("group_assemblies_triad.toml"), 0.0)
    assert every.complete
    points = sorted(tuple(points["P"][:2]) for points in every.points)
    assert np.abs(np.array(points) - np.array(PUBLISHED)).max() <= 1e-6


@pytest.mark.long
@pytest.mark.parametrize("name", ["jansen", "klann", "stephenson_six_bar", "planar_3rrr", "quick_return"])
def test_random_starts_find_the_same_assemblies(name):
    solver = ms.load(name)
    every = ms.assemblies(name, 0.2)
    searched = all_assembly_points(solver, 0.2)[0]
    assert every.complete
    assert len(every) == len(searched)
    for _, points in searched:
        assert any(
            all(np.abs(points[point] - other[point]).max() <= 1e-9 for point in points)
            for other in every.points
        )


# a slide on a line (RRP), one that turns (RPR), and mechanisms of the gallery
@pytest.mark.parametrize(
    "name", ["slide", "turning_slide", "jansen", "peaucellier_lipkin", "quick_return", "oldham_coupling"]
)
def test_poses_of_groups_close_the_loops(name):
    is_dyad = "slide" in name
    solver = load_model(f"group_assemblies_{name}.toml") if is_dyad else ms.load(name)
    for angle in (0.3, 1.1, 2.6) if is_dyad else (0.4,):
        every = group_assemblies(solver.mechanism, poses_of(solver, angle)).poses
        for poses in every:
            stacked = {link: Pose(pose.position[None], pose.rotation[None]) for link, pose in poses.items()}
            gaps, tilts = ms.loops.residual_norms(solver.mechanism, stacked, [angle])
            assert gaps.max() <= 1e-13 * solver.mechanism.characteristic_length
            assert tilts.max() <= 1e-13
        if is_dyad:
            # a line meets a circle twice
            first, second = (np.stack([pose.rotation for pose in poses.values()]) for poses in every)
            assert np.abs(first - second).max() > 0.1


def test_a_rhombus_on_one_pin_is_a_family():
    every = ms.assemblies("peaucellier_lipkin", 0.4)
    assert every.complete
    assert len(every.families) == 1
    assert "bar_a, bar_b" in every.families[0]


@pytest.mark.long
@pytest.mark.parametrize("name", ["delta_robot", "rack_steering"])
def test_without_closed_forms_the_list_is_not_called_complete(name):
    every = ms.assemblies(name, 0.0)
    assert not every.complete
    assert len(every) >= 4


@pytest.mark.parametrize(
    ("name", "reason"),
    [("cam_follower", "curve or cam"), ("belt_drive", "coupling"), ("sarrus", "not planar")],
)
def test_curves_couplings_and_spatial_mechanisms_belong_to_no_group(name, reason):
    solver = ms.load(name)
    with pytest.raises(InputError, match=reason):
        group_assemblies(solver.mechanism, poses_of(solver, 0.1))


@pytest.mark.long
def test_a_trace_with_groups_states_at_how_many_angles_it_is_complete():
    trace = ms.trace("watt_six_bar", starts=0)
    assert trace.complete_at == 12
    # without random starts the other curves come from the groups
    assert len(trace.curves) == len(ms.trace("watt_six_bar", starts=100).curves)


@pytest.mark.parametrize("count", [6, 7])
def test_many_dyads_list_their_first_assemblies_only(count):
    # dyads on one crank, each with two poses: 64 and 128
    upright, tip = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), (1.0, 0.0, 0.0)
    links, poses = [ms.Link("crank")], {"crank": Pose(np.zeros(3), upright)}
    joints = [ms.Joint("A", "revolute", ms.End("ground"), ms.End("crank"))]
    for i in range(count):
        corner, rod, rocker = (1.0 + 0.3 * i, 0.0, 0.0), f"rod{i}", f"rocker{i}"
        links += [ms.Link(rod), ms.Link(rocker)]
        joints += [
            ms.Joint(f"B{i}", "revolute", ms.End("crank", tip), ms.End(rod)),
            ms.Joint(f"C{i}", "revolute", ms.End(rod, corner), ms.End(rocker, tip)),
            ms.Joint(f"D{i}", "revolute", ms.End("ground", corner), ms.End(rocker)),
        ]
        poses |= {rod: Pose(np.array([0.0, 1.0, 0.0]), np.eye(3)), rocker: Pose(np.array(corner), upright)}
    mechanism = ms.Mechanism("dyads", tuple(links), tuple(joints), "A", {}, guess=poses)
    groups = group_assemblies(mechanism, {GROUND: IDENTITY, **poses})
    assert (len(groups.poses), groups.complete) == (64, count == 6)


def test_assemblies_that_move_while_the_crank_holds_are_reported_once():
    every = ms.assemblies(ms.load("peaucellier_rods"), 0.0)
    # A is above or below with B opposite, and P on either side of both; with A on B, P turns about them
    x = [points["P"] for points in every.points]
    np.testing.assert_allclose(sorted(p[0] for p in x), [0.06, 0.06, 0.275 / 3.0, 0.275 / 3.0], atol=1e-12)
    np.testing.assert_allclose([p[1:] for p in x], 0.0, atol=1e-9)
    (moving,) = every.families
    assert "plane_p.x" in moving
