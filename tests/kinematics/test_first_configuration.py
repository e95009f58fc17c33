"""The branch applies at the first requested configuration."""

import numpy as np
import pytest
from change_point_linkages import CHANGE_POINT_LINKAGES
from motions import largest_difference

import mechsim as ms

PARALLELOGRAM = {"ground": 0.1, "crank": 0.04, "coupler": 0.1, "rocker": 0.04}


def deviation(linkage, angles, speed=1.0):
    """Return the deviation of AB from parallel to the frame of a four-bar, in [m]."""
    points = linkage.solve(np.deg2rad(angles), speed).points
    along = points["B"].position - points["A"].position
    return np.abs(along - [linkage.ground, 0.0, 0.0]).max()


@pytest.mark.parametrize(
    ("angles", "speed", "branch"),
    [
        ([1, 90, 200, 359], 1.0, 1),
        ([0, 90, 200], 1.0, 1),
        ([0], 1.0, 1),
        ([361, 90, 200], 1.0, 1),
        ([359, 200, 90, 1], -1.0, -1),
        ([0, -90, -200], -1.0, -1),
        ([200, 300, 400], 1.0, -1),
        ([180, 170, 90], -1.0, 1),
        ([180, 190, 300], 1.0, -1),
    ],
)
def test_the_branch_selects_parallelogram_or_antiparallelogram(angles, speed, branch):
    assert deviation(ms.catalog.make("four_bar", **PARALLELOGRAM, branch=branch), angles, speed) <= 1e-15
    if len(angles) > 1:
        assert deviation(ms.catalog.make("four_bar", **PARALLELOGRAM, branch=-branch), angles, speed) > 0.01


@pytest.mark.parametrize("which", CHANGE_POINT_LINKAGES)
def test_the_branch_applies_to_the_loop_equations(which):
    linkage = CHANGE_POINT_LINKAGES[which]
    angles = 3.7 + np.linspace(0.0, 3.0, 12)
    off = largest_difference(ms.loops.solve(linkage, angles), linkage.solve(angles))
    assert off <= 1e-12 * linkage.mechanism.characteristic_length


def test_starting_at_an_angle_selects_the_assembly_mode():
    linkage = ms.catalog.make("four_bar", **PARALLELOGRAM)
    later = np.deg2rad([200.0, 300.0])
    kept = linkage.starting_at(np.deg2rad([1.0, 359.0]))
    assert np.abs(kept.positions(later)["B"] - linkage.positions(later)["B"]).max() > 0.01
    assert deviation(kept, [200.0, 300.0]) <= 1e-15
    assert {item.branch for item in kept.assemblies(4.0)} == {1, -1}
    positions = [points["B"] for _, points in kept.assembly_points(4.0)]
    assert np.abs(positions[0] - positions[1]).max() > 0.01


def test_the_start_does_not_matter_without_change_points():
    linkage = ms.catalog.make("four_bar")
    assert linkage.starting_at([3.0]) is linkage


def test_the_torque_belongs_to_the_first_assembly_mode():
    linkage = ms.catalog.make("four_bar", **PARALLELOGRAM, branch=-1)
    angles = np.deg2rad(np.linspace(195.0, 255.0, 7))
    model = ms.dynamics.dynamic_model(linkage, ms.Forces(gravity=(0.0, -9.81, 0.0)))
    own = ms.dynamics.prescribed(model, angles, 1e-6).forces.torque
    # the links of a parallelogram rise equally: the torque is the weight times a cosine
    assert np.abs(own / np.cos(angles) - own[0] / np.cos(angles[0])).max() <= 1e-9 * np.abs(own).max()
    other = ms.dynamics.dynamic_model(linkage.with_parameters(branch=1), model.forces)
    result = ms.dynamics.prescribed(other, angles, 1e-6).forces.torque
    assert np.abs(result / np.cos(angles) - own[0] / np.cos(angles[0])).max() > 0.1 * np.abs(own).max()
