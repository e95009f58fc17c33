"""Runs of forward dynamics whose forces are far too large for their masses end soon, with a cause."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.kinetics.forward_dynamics import BUDGET
from mechsim.mechanism.forces import Forces, Friction, JointSpring

WEIGHT = (0.0, -9.81, 0.0)
# a rod of 2 kg and 0.5 m that starts level, with 0.05 kg m2 about its centre
ROD = model_text("stiff_runs_rod.xml")
INERTIA, TORQUE = 0.05 + 2.0 * 0.25**2, 2.0 * 9.81 * 0.25


@pytest.fixture
def rod(tmp_path):
    (tmp_path / "rod.xml").write_text(ROD)
    return ms.load(tmp_path / "rod.xml", fix_base=False, still=True)


@pytest.mark.parametrize("decays", [1e6, 1e10, 1e11])
def test_a_creeping_rod_loses_the_energy_of_its_weight(rod, decays):
    """The rate is the torque divided by the viscous friction; the loss in 1 s is their product."""
    viscous = decays * INERTIA
    run = ms.dynamics.run(rod, Forces(gravity=WEIGHT, friction=(Friction("j", viscous=viscous),)), duration=1)
    assert (run.outcome, run.executed) == ("done", "C")
    assert run.motion.joints["j"].rate[-1] == pytest.approx(-TORQUE / viscous, rel=1e-5)
    assert run.lost[-1] == pytest.approx(TORQUE**2 / viscous, rel=1e-5)


@pytest.mark.parametrize("decays", [1e12, 1e20])
def test_a_run_with_more_decays_than_digits_is_too_stiff(rod, decays):
    forces = Forces(gravity=WEIGHT, friction=(Friction("j", viscous=decays * INERTIA),))
    run = ms.dynamics.run(rod, forces, duration=1.0)
    assert run.outcome == "too stiff"
    assert "friction" in run.reason
    assert run.steps == 0


def test_coulomb_friction_of_any_magnitude_holds_the_rod(rod):
    forces = Forces(gravity=WEIGHT, friction=(Friction("j", coulomb=1e12),))
    run = ms.dynamics.run(rod, forces, duration=1.0)
    assert run.outcome == "stopped"
    assert np.abs(run.motion.joints["j"].value).max() == 0.0


@pytest.mark.parametrize(
    "forces",
    [
        Forces(joint_springs=(JointSpring("j", stiffness=1e12, rest=0.5),)),
        Forces(gravity=(0.0, -1e14, 0.0)),
    ],
)
def test_a_run_that_needs_a_thousand_budgets_ends_after_its_first_steps(rod, forces):
    run = ms.dynamics.run(rod, forces, duration=1.0)
    assert run.outcome == "work budget spent"
    assert "at this pace" in run.reason
    # C takes 17 states a step, and looks at the budget every 512 steps
    assert 17 * run.steps < 0.1 * BUDGET
