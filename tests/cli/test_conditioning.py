import numpy as np
import pytest
from exact_solutions import four_bar_b

from mechsim import catalog, simulate, simulation
from mechsim.cli.motion_warnings import loss_of_significance
from mechsim.compare.tolerances import RATES
from mechsim.kinematics.loops.motion import conditioning_of
from mechsim.kinematics.solvers import KinematicSolver

SWINGS = {"ground": 0.1, "crank": 0.09, "coupler": 0.05, "rocker": 0.06}


@pytest.mark.long
@pytest.mark.parametrize("loops", [False, True])
def test_reported_digits_match_the_true_error(loops):
    """Compare the acceleration of B near a dead centre with 50 digits and with the reported error bound."""
    rng = np.random.default_rng(8)
    error_ratios = []
    while len(error_ratios) < 12:
        lengths = dict(zip(SWINGS, rng.uniform(0.03, 0.1, 4), strict=True))
        linkage = catalog.make("four_bar", **lengths)
        ends = linkage.dead_centres()
        if len(ends) != 2:
            continue
        angles = max(ends) - 10.0 ** np.array([-8.0, -10.0, -11.0])
        motion = (KinematicSolver(linkage.mechanism) if loops else linkage).solve(angles, 1.0)
        conditioning = motion.conditioning if loops else conditioning_of(linkage.mechanism, motion)
        for row, angle in enumerate(angles):
            exact = four_bar_b(linkage, float(angle))[2]
            error = np.linalg.norm(motion.points["B"].acceleration[row] - exact) / np.linalg.norm(exact)
            error_ratios.append(error / RATES.widened(conditioning, 3)[row])
    assert 0.01 < np.median(error_ratios) < 1.0
    assert max(error_ratios) < 100.0


@pytest.mark.long
def test_every_method_reports_a_loss_of_significance():
    linkage = catalog.make("four_bar", **SWINGS)
    near_dead_centre = max(linkage.dead_centres()) - 1e-10
    angles = np.array([0.0, 1.0, near_dead_centre])
    speed = near_dead_centre - 0.5
    profile = simulation.constant(speed, speed / (2.0 * np.pi), 0.5)
    run = simulate(linkage, profile=profile, method="pose").motion
    for solver, motion in (
        (linkage, linkage.solve(angles, 1.0)),
        (KinematicSolver(linkage.mechanism), KinematicSolver(linkage.mechanism).solve(angles, 1.0)),
        (linkage, run),
    ):
        warning = loss_of_significance(solver, motion)
        assert warning is not None
        assert 3 <= warning.digits <= 5
        assert warning.at == pytest.approx(near_dead_centre, abs=1e-12)


def test_exact_and_limiting_rates_give_no_warning():
    flat = catalog.make("four_bar", ground=0.1, crank=0.045, coupler=0.1, rocker=0.045, branch=-1)
    angles = np.linspace(0.0, 2.0 * np.pi, 73)
    for solver in (flat, KinematicSolver(flat.mechanism), catalog.make("bennett"), catalog.make("rssr")):
        assert loss_of_significance(solver, solver.solve(angles, 1.0)) is None
    swings = catalog.make("four_bar", **SWINGS)
    assert (
        loss_of_significance(swings, swings.solve(np.array([max(swings.dead_centres()) - 1e-10]), 0.0))
        is None
    )


def test_a_well_conditioned_motion_needs_no_search_of_change_points(monkeypatch):
    """The search traces a whole revolution, which takes longer than the motion."""
    monkeypatch.setattr(KinematicSolver, "change_points", lambda solver: pytest.fail("traced"))
    solver = KinematicSolver(catalog.make("four_bar").mechanism)
    assert loss_of_significance(solver, solver.solve([0.0, 0.1], 1.0)) is None
