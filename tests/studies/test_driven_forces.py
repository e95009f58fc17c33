"""Forces of several drivers: a boom at rest, velocity products of couplings, couplings stated twice."""

from dataclasses import replace

import driven_mechanisms as machines
import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import make_motion_laws, steady
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.equality_rows import CouplingConstraint
from mechsim.studies.dynamics_check import crosscheck_driven

WEIGHT = ms.Forces(gravity=(0.0, -9.81, 0.0))


def test_the_force_on_a_resting_boom_balances_its_weight():
    mechanism = machines.boom()
    negligible = ms.Inertia(1e-9, (0.0, 0.0, 0.0), (1e-12, 1e-12, 1e-12))
    arm = replace(mechanism.links[0], inertia=ms.Inertia(5.0, (1.2, 0.0, 0.0), (1e-3, 1e-3, 1e-3)))
    links = (arm, *(replace(link, inertia=negligible) for link in mechanism.links[1:]))
    mechanism = replace(mechanism, links=links)
    slowly = make_motion_laws(mechanism, {"stroke": steady(0.75, 1e-7)}, 1.0)
    solver = KinematicSolver(mechanism, motion_laws=slowly)
    study = ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver, WEIGHT), t=[0.0, 1.0])
    lift = solver.solve(t=[0.0]).joints["lift"].value[0]
    foot, head = np.array([0.5, -0.2]), np.array([np.cos(lift), np.sin(lift)])
    along = (head - foot) / np.linalg.norm(head - foot)
    lever = head[0] * along[1] - head[1] * along[0]
    assert study.forces.drives["stroke"][0] == pytest.approx(5.0 * 9.81 * 1.2 * head[0] / lever, rel=1e-7)


@pytest.mark.long
def test_forces_without_the_velocity_product_of_a_coupling_are_rejected(monkeypatch):
    mechanism = machines.nonlinear_rack()
    moves = make_motion_laws(mechanism, {"crank": machines.sinusoidal(0.3, 1.0, 2.0)}, 2.0)
    model = ms.dynamics.dynamic_model(KinematicSolver(mechanism, motion_laws=moves), WEIGHT)

    def failed_checks():
        chosen = ms.Settings(steps_per_turn=250)
        run = driven(model.mechanism, WEIGHT, motion_laws=moves, method="step", settings=chosen, samples=20)
        return {item.kind for item in crosscheck_driven(run, model).checks if not item.passed}

    # at so few steps the positions have errors of 1e-5, but the forces pass
    assert failed_checks() == set()
    monkeypatch.setattr(CouplingConstraint, "velocity_product", lambda _, qpos, __: np.zeros(len(qpos)))
    assert failed_checks() >= {"drive torque", "driver effort"}


def test_duplicate_couplings_share_the_force_of_one():
    single = machines.press()
    duplicate = ms.Coupling("again", "thread.way", "thread.turn", (0.0, 0.005 / (2.0 * np.pi)))
    doubled = replace(single, couplings=(duplicate,))
    name = "thread.turn-thread.way"
    weight = ms.Forces(gravity=(0.0, 0.0, -9.81))
    runs = [driven(item, weight, speed=2.0, samples=6, method="pose").forces for item in (single, doubled)]
    studies = [
        ms.dynamics.prescribed(ms.dynamics.dynamic_model(item, weight), runs[0].angle, 2.0).forces
        for item in (single, doubled)
    ]
    for item, two in (runs, studies):
        assert [*two.gears] == [name, f"{name} 2"]
        assert np.abs(item.gears[name]).min() > 1e-3
        np.testing.assert_allclose(two.gears[name] + two.gears[f"{name} 2"], item.gears[name], rtol=1e-9)
