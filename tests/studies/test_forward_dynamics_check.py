"""Forward dynamics by both methods: MuJoCo agrees from equal initial values and rejects a wrong mass."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from model_files import model_text
from pendulums import WEIGHT, double_pendulum, point_mass, slider

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.initial_state import InitialValues
from mechsim.simulation.dynamics import forward_run
from mechsim.simulation.dynamics.forward_run import start_of
from mechsim.studies.dynamics_check import compared_segments, crosscheck_equilibrium, crosscheck_forward


def with_inertia(mechanism, about=1e-3):
    """Return a mechanism with the moments of inertia that MuJoCo needs."""
    return replace(
        mechanism, links=tuple(replace(link, inertia=point_mass(about=about)) for link in mechanism.links)
    )


def test_softer_loops_show_the_error_of_compliance(monkeypatch):
    # loops too soft for the usual tolerance: the check measures their error
    monkeypatch.setattr(forward_run, "COMPLIANCE", 1e-3)
    model = ms.dynamics.dynamic_model(ms.catalog.make("four_bar"), WEIGHT)
    run = ms.dynamics.run(model, initial={"crank.v": 9.0}, duration=0.1, samples=10)
    verdict = crosscheck_forward(run, model, InitialValues({}, {"crank": 9.0}))
    assert verdict.passed, verdict
    assert any("with 10 times the compliance" in check.reason for check in verdict.checks)
    wrong = model.with_forces(replace(WEIGHT, gravity=(0.0, -9.81 * (1.0 + 1e-3), 0.0)))
    assert not crosscheck_forward(run, wrong, InitialValues({}, {"crank": 9.0})).passed


@pytest.mark.parametrize(
    ("name", "kept"), [("four_bar", "rocker"), ("rssr", "rocker"), ("warp_knitter", "A")]
)
def test_mujoco_starts_in_a_far_configuration_with_a_dependent_coordinate_kept(name, kept):
    # the crank determines the coordinate to keep; a path on which both vary evenly does not exist
    made = ms.catalog.make(name)
    mechanism, motion = made.mechanism, made.solve(np.array([-2.2]))
    values = {joint: float(row.value[0]) for joint, row in motion.joints.items()}
    start = start_of(mechanism, ms.Forces(), values, {}, kept={kept}, links=motion.links)
    states = start.stepped(np.linspace(0.0, 1e-3, 3), 1)
    for point, row in states.motion.points.items():
        np.testing.assert_allclose(row.position[0], motion.points[point].position[0], atol=1e-11)


WITH_FRICTION = ms.Forces(gravity=(0.0, -9.81, 0.0), friction=(ms.Friction("rocker", 0.0, 2e-3),))


@pytest.mark.long
def test_runs_are_compared_between_friction_reversals():
    model = ms.dynamics.dynamic_model(ms.catalog.make("four_bar"), WITH_FRICTION)
    run = ms.dynamics.run(model, initial={"crank.v": 30.0}, duration=0.12, samples=60)
    # the rocker reverses at its dead centres while the crank turns, so friction cannot stop it
    assert (run.outcome, len(run.events)) == ("done", 2)
    verdict = crosscheck_forward(run, model, InitialValues({}, {"crank": 30.0}))
    assert verdict.passed, verdict
    assert len({check.variant for check in verdict.checks}) == len(compared_segments(run)) == 3
    wrong = model.with_forces(replace(WITH_FRICTION, friction=(ms.Friction("rocker", 0.0, 2.2e-3),)))
    assert not crosscheck_forward(run, wrong, InitialValues({}, {"crank": 30.0})).passed


def test_a_mechanism_that_never_moves_is_not_compared():
    model = ms.dynamics.dynamic_model(
        ms.catalog.make("four_bar"),
        ms.Forces(gravity=WITH_FRICTION.gravity, friction=(ms.Friction("crank", 0.0, 1.0),)),
    )
    run = ms.dynamics.run(model, initial={"crank.q": 0.5}, duration=0.1, samples=10)
    assert run.outcome == "stopped"
    assert compared_segments(run) == ()
    assert crosscheck_forward(run, model, InitialValues({"crank": 0.5}, {})).outcome == "failed"


def test_the_error_of_mujoco_is_of_fourth_order_in_the_step():
    from mechsim.simulation.dynamics.forward_run import stepped_run

    mechanism = with_inertia(double_pendulum())
    run = ms.dynamics.run(mechanism, WEIGHT, initial={"A.q": 0.3}, duration=1.0, samples=4)
    errors = []
    for substeps in (10, 20):
        stepped = stepped_run(mechanism, WEIGHT, {"A": 0.3}, {}, run.time, substeps)
        errors.append(np.abs(stepped.motion.joints["A"].value - run.motion.joints["A"].value).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)


def test_a_seeded_wrong_equilibrium_is_rejected():
    model = ms.dynamics.dynamic_model(with_inertia(double_pendulum()), WEIGHT)
    stable, *_, unstable = ms.dynamics.equilibria(model, starts=25)
    q = stable.linear.q
    moved = replace(stable, linear=replace(stable.linear, q=replace(q, values=q.values + 1e-5)))
    verdict = crosscheck_equilibrium(moved, model)
    assert verdict.outcome == "failed"
    assert "acceleration at rest" in verdict.reason
    swapped = replace(stable, linear=replace(stable.linear, stiffness=unstable.linear.stiffness))
    assert "eigenvalue" in crosscheck_equilibrium(swapped, model).reason


SPRING_ARM = model_text("forward_dynamics_check_spring_arm.toml")


def test_accelerations_of_a_stiff_spring_have_the_tolerance_of_the_motion_times_its_stiffness(tmp_path):
    """A tolerated error of the coordinate changes the acceleration by about k / m times as much."""
    path, stiffness, mass = tmp_path / "arm.toml", 6e4, 0.05
    path.write_text(SPRING_ARM)
    start = {"pivot.q": "20deg", "s.q": "0.5m"}

    def model(k):
        forces = ms.Forces(gravity=(0.0, -9.81, 0.0), joint_springs=(ms.JointSpring("s", k, 0.5),))
        return ms.dynamics.dynamic_model(ms.load(path), forces)

    run = ms.dynamics.run(model(stiffness), initial=start, duration=0.05, samples=8)

    def verdict(simulated):
        return crosscheck_forward(run, model(simulated), initial_values(model(simulated), start))

    result = verdict(stiffness)
    assert result.passed
    tolerances = {check.quantity: check.tolerance for check in result.checks}
    ratio = tolerances["acceleration of s"] / tolerances["coordinate of s"]
    assert 0.1 * stiffness / mass < ratio < 10.0 * stiffness / mass
    assert not verdict(stiffness * (1.0 + 1e-4)).passed


def test_a_run_that_ignores_a_stop_disagrees_with_mujoco():
    """MuJoCo keeps the limit of 0.15 m, which the run without stops passes."""
    forces = ms.Forces(gravity=(2.0, 0.0, 0.0))
    without = ms.dynamics.run(slider(), forces, initial={"s.v": 0.0}, duration=0.6, samples=30)
    assert without.motion.joints["s"].value.max() > 0.3
    values = InitialValues({}, {"s": 0.0})
    for limit, agrees in ((0.5, True), (0.15, False)):
        model = ms.dynamics.dynamic_model(KinematicSolver(slider(), ranges={"s": (-1.0, limit)}), forces)
        assert crosscheck_forward(without, model, values).passed == agrees


def test_a_drive_torque_of_zero_and_a_balance_of_zero_agree():
    hinge = '<body><joint name="crank" axis="0 0 1"/><geom size=".01" pos=".1 0 0"/></body>'
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{hinge}</worldbody></mujoco>")
    solver = ms.load(spec, drive={"crank": "1rad/s"}, duration=0.05)
    # about a vertical axis at a constant rate neither weight nor inertia needs a torque
    for drivers in (["crank"], []):
        model = ms.dynamics.dynamic_model(solver)
        start = {} if drivers else {"crank.v": 1.0}
        run = ms.dynamics.run(solver, initial=start, prescribed=drivers, duration=0.05, samples=9)
        values = InitialValues({}, {} if drivers else {"crank": 1.0})
        verdict = crosscheck_forward(run, model, values)
        assert verdict.passed, verdict
        assert any(check.method == "balance" for check in verdict.checks)
