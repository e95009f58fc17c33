"""Detection of another assembly mode, with artificial solvers whose modes have given positions."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from mechsim.compare.crosscheck import elsewhere
from mechsim.mechanism.motion import Motion, PointMotion

N = 12
# of either sign
ANGLE = np.linspace(-3.0, 0.5, N)


def motion_through(positions):
    points = {
        name: PointMotion(position, 0.0 * position, 0.0 * position) for name, position in positions.items()
    }
    return Motion("closed form", ANGLE, np.ones(N), np.zeros(N), points)


# P moves along x by 1 m, so that the stroke is half a metre; Q is at rest
PATH = {"P": np.stack([np.linspace(0.0, 1.0, N), np.zeros(N), np.zeros(N)], 1), "Q": np.zeros((N, 3))}
RIGHT = motion_through(PATH)


@dataclass
class TwoAssemblies:
    """The right assembly mode, and one with P above it."""

    apart: np.ndarray

    def assembly_points(self, angle):
        i = int(np.argmin(np.abs(ANGLE - angle)))
        positions = {name: position[i] for name, position in PATH.items()}
        yield "right", positions
        yield "other", {**positions, "P": positions["P"] + np.array([0.0, self.apart[i], 0.0])}


@dataclass
class Signed:
    """A solver that distinguishes assembly modes by a sign: that of P's height."""

    def assembly_sign(self, points):
        return points["P"][:, 1]


def raised(heights):
    return replace(
        RIGHT, points=motion_through({**PATH, "P": PATH["P"] + np.outer(heights, (0.0, 1.0, 0.0))}).points
    )


@pytest.mark.parametrize(
    ("apart", "height", "first", "until", "reported"),
    [
        *((0.2, 0.2, first, N, first) for first in (0, 3, N - 2)),
        # another assembly mode must be twice as close: 0.06 of 0.2 is closer to its own
        *((0.2, height, 0, N, None) for height in (0.0, 0.06, 0.12, -0.2)),
        (0.2, 0.14, 0, N, 0),
        # two samples are a change of assembly mode, a single one is not
        *((0.2, 0.2, *samples) for samples in ((4, 5, None), (N - 1, N, None), (4, 6, 4))),
        # modes closer than 0.01 m are not distinguished
        (0.009, 0.009, 0, N, None),
        (0.011, 0.011, 0, N, 0),
    ],
)
def test_a_change_of_assembly_mode_is_reported_with_its_first_instant(apart, height, first, until, reported):
    heights = np.where((np.arange(N) >= first) & (np.arange(N) < until), height, 0.0)
    result = elsewhere(raised(heights), RIGHT, TwoAssemblies(np.full(N, apart)))
    assert result == (None if reported is None else pytest.approx(ANGLE[reported]))


def test_separating_assembly_modes_are_distinguished():
    differences = np.linspace(0.0, 0.2, N)
    first = int(np.flatnonzero(differences > 0.01)[0])
    assert elsewhere(raised(differences), RIGHT, TwoAssemblies(differences)) == pytest.approx(ANGLE[first])


def test_the_point_of_largest_distance_decides():
    # P is in the other assembly mode, but Q is equally far from both
    solver = TwoAssemblies(np.full(N, 0.2))
    both = {**PATH, "P": PATH["P"] + np.array([0.0, 0.2, 0.0]), "Q": PATH["Q"] + np.array([0.0, 0.0, 0.19])}
    assert elsewhere(motion_through(both), RIGHT, solver) is None


def test_a_long_run_is_sampled_from_start_to_end():
    n, sampled = 1000, []
    angle = np.linspace(0.0, 50.0, n)
    flat = np.zeros((n, 3))
    path = np.stack([np.linspace(0.0, 1.0, n), np.zeros(n), np.zeros(n)], 1)
    still = Motion("closed form", angle, flat[:, 0], flat[:, 0], {"P": PointMotion(path, flat, flat)})

    class Listing:
        def assembly_points(self, q):
            sampled.append(q)
            yield "right", {"P": path[np.argmin(np.abs(angle - q))]}

    assert elsewhere(still, still, Listing()) is None
    assert 150 <= len(sampled) <= 200
    assert (sampled[0], sampled[1]) == (angle[0], angle[1])
    assert (sampled[-2], sampled[-1]) == (angle[-2], angle[-1])


def test_two_samples_of_the_wrong_sign_are_a_change_of_assembly_mode():
    heights = np.ones(N)
    heights[2] = heights[6:9] = -1.0
    assert elsewhere(raised(heights), RIGHT, Signed()) == pytest.approx(ANGLE[6])
    heights[7] = 0.0
    assert elsewhere(raised(heights), RIGHT, Signed()) is None
    assert elsewhere(raised(-np.ones(N)), RIGHT, Signed()) == pytest.approx(ANGLE[0])
    assert elsewhere(raised(np.ones(N)), RIGHT, Signed()) is None


def test_a_change_of_assembly_mode_needs_two_samples():
    class Above:
        def assembly_points(self, angle):
            yield "other", {"P": np.array([0.0, 0.2, 0.0])}

    for n, reported in ((1, None), (2, ANGLE[0])):
        flat = np.zeros((n, 3))
        path = np.linspace([0.0, 0.0, 0.0], [0.1, 0.0, 0.0], n)
        exact = Motion("closed form", ANGLE[:n], flat[:, 0], flat[:, 0], {"P": PointMotion(path, flat, flat)})
        moved = replace(exact, points={"P": PointMotion(flat + np.array([0.0, 0.2, 0.0]), flat, flat)})
        assert elsewhere(moved, exact, Above()) == reported
