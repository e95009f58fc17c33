"""Forces of several drivers: MuJoCo against the formulas, and the formulas against energy balance."""

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


def five_bar():
    mechanism = machines.five_bar()
    states = {
        "left": machines.sinusoidal(2.0, 0.3, 6.0, 0.2),
        "right": machines.sinusoidal(1.0, 0.4, 9.0, 1.0),
    }
    rubbing = replace(WEIGHT, friction=(ms.Friction("A", viscous=0.01),))
    return ms.dynamics.dynamic_model(
        KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, states, 1.0)), rubbing
    )


def boom():
    mechanism = machines.boom()
    states = {"stroke": machines.sinusoidal(0.8, 0.1, 2.0)}
    return ms.dynamics.dynamic_model(
        KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, states, 3.0)), WEIGHT
    )


def locked_rack():
    """A pinion that drives a rack, with a locked joint."""
    mechanism = machines.rack_and_cam()
    mesh = ms.Coupling("mesh", "rack", "crank", (0.001, 0.02))
    mechanism = replace(mechanism, driver=("crank",), couplings=(mesh,), locked={"cam": 0.01})
    moves = make_motion_laws(mechanism, {"crank": machines.sinusoidal(0.3, 1.0, 2.0)}, 2.0)
    return ms.dynamics.dynamic_model(
        KinematicSolver(mechanism, motion_laws=moves), ms.Forces(gravity=(-9.81, -9.81, 0.0))
    )


def nonlinear_rack():
    mechanism = machines.nonlinear_rack()
    moves = make_motion_laws(mechanism, {"crank": machines.sinusoidal(0.3, 1.0, 2.0)}, 2.0)
    return ms.dynamics.dynamic_model(KinematicSolver(mechanism, motion_laws=moves), WEIGHT)


def nonlinear_passive_joint():
    mechanism = machines.five_bar_with_cam()
    arms = {"left": machines.sinusoidal(2.0, 0.3, 6.0, 0.2), "right": machines.sinusoidal(1.0, 0.4, 9.0, 1.0)}
    return ms.dynamics.dynamic_model(
        KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, arms, 1.0)), WEIGHT
    )


def nonlinear_table():
    """A plate of 9 g with nonlinear couplings to a tool of 2 mg and between its coordinates."""
    mechanism = machines.table(backwards=False)
    moves = make_motion_laws(mechanism, {"tool": machines.sinusoidal(0.3, 1.0, 2.0)}, 2.0)
    return ms.dynamics.dynamic_model(KinematicSolver(mechanism, motion_laws=moves), WEIGHT)


NONLINEAR = {
    "nonlinear rack": nonlinear_rack,
    "nonlinear passive joint": nonlinear_passive_joint,
    "nonlinear table": nonlinear_table,
}
CASES = {"five-bar": five_bar, "boom": boom, "rack": locked_rack} | NONLINEAR


def study_of(model, count=41):
    moves = model.solver.motion_laws
    return ms.dynamics.prescribed(model, t=np.linspace(0.0, moves.duration, count))


@pytest.mark.parametrize("case", CASES)
def test_drive_power_balances_energy_rates_and_losses(case):
    """Eighth-order differences of the energy against the drive power and the friction losses."""
    model = CASES[case]()
    moves = model.solver.motion_laws
    step, middle = 1e-3 * moves.duration, 0.4 * moves.duration
    times = middle + step * np.arange(-4, 5)
    result = ms.dynamics.prescribed(model, t=times).forces
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / step
    energy_rate = weights @ (result.kinetic + result.potential)
    motion = model.solver.solve(t=times)
    power = sum(result.drives[name] * motion.joints[name].rate for name in moves.drivers)[4]
    assert power - result.power_lost[4] == pytest.approx(energy_rate, rel=1e-8)
    assert result.power_in[4] == pytest.approx(power, rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_both_methods_for_drive_forces_agree(case):
    study = study_of(CASES[case]())
    assert study.second_torque == pytest.approx(
        study.forces.torque, abs=1e-12 * np.abs(study.forces.torque).max()
    )


def test_the_force_on_a_resting_boom_balances_its_weight():
    mechanism = machines.boom()
    negligible = ms.Inertia(1e-9, (0.0, 0.0, 0.0), (1e-12, 1e-12, 1e-12))
    arm = replace(mechanism.links[0], inertia=ms.Inertia(5.0, (1.2, 0.0, 0.0), (1e-3, 1e-3, 1e-3)))
    links = (arm, *(replace(link, inertia=negligible) for link in mechanism.links[1:]))
    mechanism = replace(mechanism, links=links)
    slowly = make_motion_laws(mechanism, {"stroke": steady(0.75, 1e-7)}, 1.0)
    study = study_of(ms.dynamics.dynamic_model(KinematicSolver(mechanism, motion_laws=slowly), WEIGHT), 3)
    lift = KinematicSolver(mechanism, motion_laws=slowly).solve(t=[0.0]).joints["lift"].value[0]
    foot, head = np.array([0.5, -0.2]), np.array([np.cos(lift), np.sin(lift)])
    along = (head - foot) / np.linalg.norm(head - foot)
    lever = head[0] * along[1] - head[1] * along[0]
    assert study.forces.drives["stroke"][0] == pytest.approx(5.0 * 9.81 * 1.2 * head[0] / lever, rel=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
@pytest.mark.parametrize("case", CASES)
def test_mujoco_agrees_and_a_heavier_link_is_rejected(case, method):
    model = CASES[case]()
    settings = ms.Settings(steps_per_turn=1000) if method == "step" else None
    run = driven(
        model.mechanism,
        model.forces,
        motion_laws=model.solver.motion_laws,
        method=method,
        settings=settings,
        samples=20,
    )
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    assert {check.kind for check in verdict.checks} >= {"driver effort"}
    link = model.mechanism.links[0]
    heavier = replace(link, inertia=replace(link.inertia, mass=1.001 * link.inertia.mass))
    links = (heavier, *model.mechanism.links[1:])
    wrong = ms.dynamics.dynamic_model(
        model.solver, model.forces, mechanism=replace(model.mechanism, links=links)
    )
    assert not crosscheck_driven(run, wrong).passed


@pytest.mark.long
@pytest.mark.parametrize("case", list(NONLINEAR)[:1])
def test_forces_without_the_velocity_product_of_a_coupling_are_rejected(case, monkeypatch):
    model = NONLINEAR[case]()

    def failed_checks():
        moves, chosen = model.solver.motion_laws, ms.Settings(steps_per_turn=250)
        stepped = driven(
            model.mechanism, model.forces, motion_laws=moves, method="step", settings=chosen, samples=20
        )
        checks = crosscheck_driven(stepped, model).checks
        return {item.kind for item in checks if not item.passed}

    # at so few steps the positions have errors of 1e-5, but the forces pass
    assert failed_checks() == set()
    monkeypatch.setattr(CouplingConstraint, "velocity_product", lambda _, qpos, __: np.zeros(len(qpos)))
    assert failed_checks() >= {"drive torque", "driver effort"}


def test_drive_inertia_under_motion_laws_is_rejected():
    model = locked_rack()
    with pytest.raises(ms.InputError, match=r"flywheel.*motion laws"):
        model.with_forces(ms.Forces(flywheel=1.0))


def test_duplicate_couplings_share_the_force_of_one():
    single = machines.press()
    duplicate = ms.Coupling("again", "thread.way", "thread.turn", (0.0, 0.005 / (2.0 * np.pi)))
    doubled = replace(single, couplings=(duplicate,))
    name = "thread.turn-thread.way"
    weight = ms.Forces(gravity=(0.0, 0.0, -9.81))
    runs = [driven(item, weight, speed=2.0, samples=6, method="pose").forces for item in (single, doubled)]
    studies = [
        ms.dynamics.prescribed(
            ms.dynamics.dynamic_model(KinematicSolver(item), weight), runs[0].angle, 2.0
        ).forces
        for item in (single, doubled)
    ]
    for item, two in (runs, studies):
        assert [*two.gears] == [name, f"{name} 2"]
        assert np.abs(item.gears[name]).min() > 1e-3
        np.testing.assert_allclose(two.gears[name] + two.gears[f"{name} 2"], item.gears[name], rtol=1e-9)
