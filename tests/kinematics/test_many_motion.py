"""Loop equations of many designs together: each agrees with its single solution."""

from functools import cache

import numpy as np
import pytest
from motions import largest_difference, started_at

import mechsim as ms
from mechsim.kinematics.loops import design_motion
from mechsim.kinematics.loops.design_motion import many_motion, shared_loops
from mechsim.mechanism.design_arrays import similar_designs
from mechsim.numerics import continuation, loop_solver

ANGLES = 2.0 * np.pi * np.arange(24) / 24


@cache
def solver(name, parameter, value):
    return ms.load(name, {parameter: value})


def designs(name, parameter, values):
    return [solver(name, parameter, float(item)).mechanism for item in values]


def moved(name, parameter, values, joints):
    return together(ms.load(name).mechanism, designs(name, parameter, values), joints, speed=3.0)


def together(mechanism, mechanisms, joints=(), *, angles=ANGLES, speed=1.0):
    """Return the motion of the designs similar to one, and a mask of the solved designs."""
    loops = shared_loops(mechanism, joints)
    started, which = similar_designs(mechanism, mechanisms)
    motion, valid = many_motion(loops, started, angles, speed, joints)
    return motion, np.isin(np.arange(len(mechanisms)), which[valid])


def test_designs_with_a_passive_spin_agree_with_the_closed_form():
    angles = np.random.default_rng(22).uniform(-7.0, 7.0, 40)
    drives = [ms.catalog.make("rssr", crank=length) for length in (0.0186, 0.02, 0.0212)]
    mechanisms = [linkage.mechanism for linkage in drives]
    motion, reported = together(mechanisms[1], mechanisms, angles=angles, speed=3.0)
    assert reported.all()
    for i, linkage in enumerate(drives):
        rows = slice(i * len(angles), (i + 1) * len(angles))
        for point, exact in linkage.solve(angles, 3.0).points.items():
            for quantity in ("position", "velocity", "acceleration"):
                expected, result = getattr(exact, quantity), getattr(motion.points[point], quantity)[rows]
                # measured 1.3e-15
                np.testing.assert_allclose(result, expected, rtol=0, atol=1e-14 * np.abs(expected).max())


@pytest.mark.parametrize("rows_are_enough", [True, False])
def test_ill_conditioned_designs_select_equations_for_every_segment(rows_are_enough, monkeypatch):
    mechanisms = [ms.catalog.make("bennett", length0=length).mechanism for length in (0.05, 0.049, 0.051)]
    exact = [ms.loops.solve(mechanism, ANGLES) for mechanism in mechanisms]
    selections, select = [], continuation.loop_solver
    monkeypatch.setattr(
        continuation, "loop_solver", lambda *arguments: selections.append(arguments) or select(*arguments)
    )
    if not rows_are_enough:
        monkeypatch.setattr(loop_solver, "MIN_VALUE_RATIO", 2.0)
    motion, reported = together(mechanisms[0], mechanisms)
    assert reported.all()
    assert (len(selections) > 6) == (not rows_are_enough)
    for i, alone in enumerate(exact):
        rows = slice(i * len(ANGLES), (i + 1) * len(ANGLES))
        assert largest_difference(motion, alone, rows=rows) <= 1e-13


@pytest.mark.long
def test_designs_that_cannot_turn_or_differ_in_structure_are_excluded():
    _, reported = moved("watt_six_bar", "crank", [0.025, 0.3, 0.024, 0.026, 0.0251], ("output",))
    assert reported.tolist() == [True, False, True, True, True]
    others = designs("watt_six_bar", "crank", [0.025, 0.0251, 0.0252])
    others.append(ms.load("stephenson_six_bar").mechanism)
    _, reported = together(others[0], others, ("output",))
    assert reported.tolist() == [True, True, True, False]


def test_a_singular_design_does_not_affect_the_others(monkeypatch):
    mechanisms = designs("watt_six_bar", "crank", 0.025 * np.linspace(0.95, 1.05, 5))
    close = design_motion.closed_chunks

    def refusing(path, instants):
        if 3 in path.designs.which:
            raise ms.AssemblyError("too near")
        return close(path, instants)

    whole, reported = together(mechanisms[0], mechanisms, ("output",))
    assert reported.all()
    monkeypatch.setattr(design_motion, "closed_chunks", refusing)
    motion, reported = together(mechanisms[0], mechanisms, ("output",))
    assert reported.tolist() == [True, True, True, False, True]
    rows = np.repeat(reported, len(ANGLES))
    for name, point in motion.points.items():
        # closed in other chunks, they differ by rounding
        np.testing.assert_allclose(point.velocity[rows], whole.points[name].velocity[rows], atol=1e-15)
    assert not motion.joints["output"].rate[~rows].any()


def test_each_design_keeps_its_own_assembly_mode():
    both = [ms.catalog.make("four_bar", branch=branch).mechanism for branch in (1, -1)] * 3
    motion, reported = together(both[0], both, ("rocker",))
    assert reported.all()
    for i, branch in enumerate((1, -1)):
        exact = ms.catalog.make("four_bar", branch=branch).solve(ANGLES).points["B"].position
        rows = slice(i * len(ANGLES), (i + 1) * len(ANGLES))
        np.testing.assert_allclose(motion.points["B"].position[rows], exact, atol=1e-13)


def designs_with_a_change_point():
    """Return a kite with a change point and similar designs, assembled at one crank angle."""
    lengths = {"ground": 0.1, "coupler": 0.1, "rocker": 0.04}
    cranks = (0.04, 0.038, 0.037, 0.036)
    mechanisms = [ms.catalog.make("four_bar", crank=crank, **lengths).mechanism for crank in cranks]
    return [started_at(mechanism, ms.loops.solve(mechanism, [2.0])) for mechanism in mechanisms]


def test_a_design_with_a_change_point_is_excluded():
    mechanisms = designs_with_a_change_point()
    _, reported = together(mechanisms[-1], mechanisms)
    assert reported.tolist() == [False, True, True, True]


def test_the_sign_of_the_determinant_excludes_change_points(monkeypatch):
    mechanisms = designs_with_a_change_point()
    whole = np.linalg.slogdet
    monkeypatch.setattr(
        design_motion.np.linalg, "slogdet", lambda matrix: (np.ones(len(matrix)), whole(matrix)[1])
    )
    _, reported = together(mechanisms[-1], mechanisms)
    assert reported[0]


def test_mechanisms_with_several_drivers_need_motion_laws():
    assert shared_loops(ms.load("five_bar").mechanism, ()) is None
