"""The sign of an assembly applies at the first configuration that is asked for."""

from dataclasses import replace

import numpy as np
import pytest
from flat_linkages import FLAT_ONES, FOLDING

from mechsim import catalog, dynamics, loops
from mechsim.model.forces import Forces

TURN = 2.0 * np.pi
PARALLELOGRAM = {"ground": 0.1, "crank": 0.04, "coupler": 0.1, "rocker": 0.04}


def deviation(drive, angles, speed=1.0):
    """Return how far AB of a four-bar is from being parallel to its frame, in [m]."""
    points = drive.solve(np.deg2rad(angles), speed).points
    along = points["B"].position - points["A"].position
    return np.abs(along - [drive.ground, 0.0, 0.0]).max()


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
    assert deviation(catalog.make("four_bar", **PARALLELOGRAM, branch=branch), angles, speed) <= 1e-15
    if len(angles) > 1:
        assert deviation(catalog.make("four_bar", **PARALLELOGRAM, branch=-branch), angles, speed) > 0.01


@pytest.mark.parametrize("which", FLAT_ONES)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_branch_applies_at_any_first_configuration(which, direction):
    drive = FLAT_ONES[which]
    for first in [*np.linspace(-7.0, 7.0, 5), *drive.change_points()]:
        angles = first + direction * np.linspace(0.0, TURN, 41)
        after = first + direction * np.array([0.0, 1e-3])
        for branch in (1, -1):
            form = replace(drive, branch=branch)
            assert form.assembly_sign(form.positions(after))[1] > 0.0
            own = form.solve(angles, direction)
            # the same motion asked for with one configuration more keeps its assembly
            more = form.solve(np.append(angles, angles[-1] + direction), direction)
            other = replace(drive, branch=-branch).solve(angles, direction)
            name = list(own.points)[1]
            size = drive.mechanism.characteristic_length
            np.testing.assert_allclose(
                own.points[name].position, more.points[name].position[:-1], atol=1e-12 * size
            )
            assert np.abs(own.points[name].position - other.points[name].position).max() > 0.01 * size


@pytest.mark.parametrize("which", FLAT_ONES)
def test_the_branch_applies_to_the_loop_equations(which):
    drive = FLAT_ONES[which]
    angles = 3.7 + np.linspace(0.0, 3.0, 12)
    exact, by_loops = drive.solve(angles), loops.solve(drive, angles)
    for name, point in exact.points.items():
        assert (
            np.abs(by_loops.points[name].position - point.position).max()
            <= 1e-12 * drive.mechanism.characteristic_length
        )


@pytest.mark.parametrize("which", FOLDING)
def test_the_branch_policy_starts_with_its_sign(which):
    drive = FLAT_ONES[which].with_change_point("branch")
    for first in (0.3, 2.0, 3.9, 5.5):
        assert drive.assembly_sign(drive.positions([first, first + 1e-3]))[0] > 0.0


def test_starting_at_an_angle_selects_the_assembly_mode():
    drive = catalog.make("four_bar", **PARALLELOGRAM)
    later = np.deg2rad([200.0, 300.0])
    kept = drive.starting_at(np.deg2rad([1.0, 359.0]))
    assert np.abs(kept.positions(later)["B"] - drive.positions(later)["B"]).max() > 0.01
    assert deviation(kept, [200.0, 300.0]) <= 1e-15
    assert {item.branch for item in kept.assemblies(4.0)} == {1, -1}
    places = [points["B"] for _, points in kept.assembly_points(4.0)]
    assert np.abs(places[0] - places[1]).max() > 0.01


def test_the_start_does_not_matter_without_change_points():
    drive = catalog.make("four_bar")
    assert drive.starting_at([3.0]) is drive


def test_the_torque_belongs_to_the_first_assembly_mode():
    drive = catalog.make("four_bar", **PARALLELOGRAM, branch=-1)
    angles = np.deg2rad(np.linspace(195.0, 255.0, 7))
    machine = dynamics.dynamic_model(drive, Forces(gravity=(0.0, -9.81, 0.0)))
    own = dynamics.prescribed(machine, angles, 1e-6).forces.torque
    # of a parallelogram crank, rocker and coupler rise alike: torque is the weight times one cosine
    assert np.abs(own / np.cos(angles) - own[0] / np.cos(angles[0])).max() <= 1e-9 * np.abs(own).max()
    other = dynamics.dynamic_model(replace(drive, branch=1), machine.forces)
    result = dynamics.prescribed(other, angles, 1e-6).forces.torque
    assert np.abs(result / np.cos(angles) - own[0] / np.cos(angles[0])).max() > 0.1 * np.abs(own).max()
