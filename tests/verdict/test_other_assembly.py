"""Detection of another assembly mode, with artificial solvers whose modes have given positions."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from mechsim.model.motion import Motion, PointMotion
from mechsim.verdict.crosscheck import elsewhere

N = 12
ANGLE = np.linspace(0.5, 4.0, N)


def at(places):
    points = {name: PointMotion(place, 0.0 * place, 0.0 * place) for name, place in places.items()}
    return Motion("user", ANGLE, np.ones(N), np.zeros(N), points)


# P runs along x for 1 m, so that the stroke is half a metre; Q stands still
PATH = {"P": np.stack([np.linspace(0.0, 1.0, N), np.zeros(N), np.zeros(N)], 1), "Q": np.zeros((N, 3))}
RIGHT = at(PATH)


@dataclass
class TwoAssemblies:
    """The right assembly mode, and one whose P lies above it."""

    apart: np.ndarray

    def assembly_points(self, angle):
        i = int(np.argmin(np.abs(ANGLE - angle)))
        places = {name: place[i] for name, place in PATH.items()}
        yield "right", places
        yield "other", {**places, "P": places["P"] + np.array([0.0, self.apart[i], 0.0])}


@dataclass
class Signed:
    """A solver that distinguishes assembly modes by a sign: that of P's height."""

    def assembly_sign(self, points):
        return points["P"][:, 1]


def lifted(heights):
    return replace(RIGHT, points=at({**PATH, "P": PATH["P"] + np.outer(heights, (0.0, 1.0, 0.0))}).points)


def up_from(first, height, until=N):
    heights = np.zeros(N)
    heights[first:until] = height
    return heights


@pytest.mark.parametrize("first", [0, 3, N - 2])
def test_a_change_of_assembly_mode_is_reported_with_its_first_instant(first):
    solver = TwoAssemblies(np.full(N, 0.2))
    assert elsewhere(lifted(up_from(first, 0.2)), RIGHT, solver) == pytest.approx(ANGLE[first])
    assert elsewhere(lifted(up_from(first, 0.14)), RIGHT, solver) == pytest.approx(ANGLE[first])


def test_another_assembly_mode_must_be_twice_as_close():
    solver = TwoAssemblies(np.full(N, 0.2))
    # a third of the way over: nearer to its own; three fifths: two to three from the other
    for height in (0.0, 0.06, 0.12, -0.2):
        assert elsewhere(lifted(up_from(0, height)), RIGHT, solver) is None


def test_a_single_sample_is_not_a_change_of_assembly_mode():
    solver = TwoAssemblies(np.full(N, 0.2))
    assert elsewhere(lifted(up_from(4, 0.2, 5)), RIGHT, solver) is None
    assert elsewhere(lifted(up_from(N - 1, 0.2)), RIGHT, solver) is None
    assert elsewhere(lifted(up_from(4, 0.2, 6)), RIGHT, solver) == pytest.approx(ANGLE[4])


@pytest.mark.parametrize(("apart", "reported"), [(0.009, False), (0.011, True)])
def test_close_assembly_modes_are_not_distinguished(apart, reported):
    result = elsewhere(lifted(up_from(0, apart)), RIGHT, TwoAssemblies(np.full(N, apart)))
    assert (result == pytest.approx(ANGLE[0])) if reported else (result is None)


def test_separating_assembly_modes_are_distinguished():
    gaps = np.linspace(0.0, 0.2, N)
    first = int(np.flatnonzero(gaps > 0.01)[0])
    assert elsewhere(lifted(gaps), RIGHT, TwoAssemblies(gaps)) == pytest.approx(ANGLE[first])


def test_the_point_of_largest_distance_decides():
    # P is in the other assembly, but Q is as far from both: the right one is as near
    solver = TwoAssemblies(np.full(N, 0.2))
    both = {**PATH, "P": PATH["P"] + np.array([0.0, 0.2, 0.0]), "Q": PATH["Q"] + np.array([0.0, 0.0, 0.19])}
    assert elsewhere(at(both), RIGHT, solver) is None


def test_a_long_run_is_sampled_from_start_to_end():
    n, looked = 1000, []
    angle = np.linspace(0.0, 50.0, n)
    flat = np.zeros((n, 3))
    path = np.stack([np.linspace(0.0, 1.0, n), np.zeros(n), np.zeros(n)], 1)
    still = Motion("user", angle, flat[:, 0], flat[:, 0], {"P": PointMotion(path, flat, flat)})

    class Listing:
        def assembly_points(self, at):
            looked.append(at)
            yield "right", {"P": path[np.argmin(np.abs(angle - at))]}

    assert elsewhere(still, still, Listing()) is None
    assert 150 <= len(looked) <= 200
    assert (looked[0], looked[1]) == (angle[0], angle[1])
    assert (looked[-2], looked[-1]) == (angle[-2], angle[-1])


def test_two_samples_of_the_wrong_sign_are_a_change_of_assembly_mode():
    heights = np.ones(N)
    heights[2] = heights[6:9] = -1.0
    assert elsewhere(lifted(heights), RIGHT, Signed()) == pytest.approx(ANGLE[6])
    heights[7] = 0.0
    assert elsewhere(lifted(heights), RIGHT, Signed()) is None
    assert elsewhere(lifted(-np.ones(N)), RIGHT, Signed()) == pytest.approx(ANGLE[0])
    assert elsewhere(lifted(np.ones(N)), RIGHT, Signed()) is None


def test_a_change_of_assembly_mode_needs_two_samples():
    class Above:
        def assembly_points(self, angle):
            yield "other", {"P": np.array([0.0, 0.2, 0.0])}

    for n, reported in ((1, None), (2, ANGLE[0])):
        flat = np.zeros((n, 3))
        path = np.linspace([0.0, 0.0, 0.0], [0.1, 0.0, 0.0], n)
        exact = Motion("user", ANGLE[:n], flat[:, 0], flat[:, 0], {"P": PointMotion(path, flat, flat)})
        gone = replace(exact, points={"P": PointMotion(flat + np.array([0.0, 0.2, 0.0]), flat, flat)})
        assert elsewhere(gone, exact, Above()) == reported
