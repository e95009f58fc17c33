"""Forward dynamics by both methods: MuJoCo agrees from equal initial values and rejects a wrong mass."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from model_files import model_mechanism, model_text, stated_mechanism
from pendulums import WEIGHT, double_pendulum, point_mass, slider
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.initial_state import InitialValues
from mechsim.mechanism.masses import with_inertia as with_rods
from mechsim.simulation.dynamics import forward_run
from mechsim.simulation.dynamics.forward_run import start_of
from mechsim.studies.dynamics_check import compared_segments, crosscheck_equilibrium, crosscheck_forward

OSCILLATOR = ms.Forces(joint_springs=(ms.JointSpring("s", 200.0),), friction=(ms.Friction("s", viscous=3.0),))


def with_inertia(mechanism, about=1e-3):
    """Return a mechanism with the moments of inertia that MuJoCo needs."""
    return replace(
        mechanism, links=tuple(replace(link, inertia=point_mass(about=about)) for link in mechanism.links)
    )


@pytest.mark.parametrize(
    ("mechanism", "forces", "initial", "values"),
    [
        (
            with_inertia(double_pendulum()),
            WEIGHT,
            {"A.q": 0.3, "B.v": 1.5},
            InitialValues({"A": 0.3}, {"B": 1.5}),
        ),
        (slider(), OSCILLATOR, {"s.q": 0.1}, InitialValues({"s": 0.1}, {})),
        (ms.catalog.make("four_bar").mechanism, WEIGHT, {"crank.q": 0.5}, InitialValues({"crank": 0.5}, {})),
        (ms.catalog.make("rssr").mechanism, WEIGHT, {"crank.v": 9.0}, InitialValues({}, {"crank": 9.0})),
    ],
    ids=["double pendulum", "oscillator", "four_bar", "rssr"],
)
def test_both_methods_agree_on_free_motion(mechanism, forces, initial, values):
    model = ms.dynamics.dynamic_model(mechanism, forces)
    run = ms.dynamics.run(model, initial=initial, duration=0.1, samples=10)
    verdict = crosscheck_forward(run, model, values)
    assert verdict.passed, verdict


def test_a_light_cam_turns_back_under_its_follower_where_the_rise_begins():
    # what MuJoCo's stiff constraints cancel exceeds its inertia by 4e16
    model = ms.dynamics.dynamic_model(ms.load("cam_follower"))
    run = ms.dynamics.run(model, initial={"cam.v": 6.0}, duration=0.3, samples=109)
    cam, follower = (link.inertia for link in with_rods(model.mechanism).links[:2])
    inertia, mass = cam.matrix[2, 2], follower.mass
    over = np.deg2rad(120.0)

    def rates(_, state):
        """Of angle and speed: (I + m s'^2) q'' + m s' s'' q'^2 = -m g s' with a cycloidal lift s."""
        q, speed = state
        u = max(q, -np.pi / 3 - q, 0.0) / over
        first = np.sign(q) * 0.012 / over * 2.0 * np.sin(np.pi * u) ** 2
        second = 0.012 / over**2 * 2.0 * np.pi * np.sin(2.0 * np.pi * u)
        force = mass * first * (second * speed**2 + 9.81)
        return speed, -force / (inertia + mass * first**2)

    exact = solve_ivp(rates, (0, 0.3), (0, 6), "DOP853", run.time, rtol=1e-11, atol=1e-11, max_step=1e-3)
    assert run.motion.angle == pytest.approx(exact.y[0], abs=1e-8)
    verdict = crosscheck_forward(run, model, InitialValues({}, {"cam": 6.0}))
    assert verdict.passed, verdict


def test_a_mass_error_of_1e_5_is_rejected():
    mechanism = with_inertia(double_pendulum())
    run = ms.dynamics.run(mechanism, WEIGHT, initial={"A.q": 0.3}, duration=0.3, samples=10)
    first, second = mechanism.links
    wrong = replace(mechanism, links=(first, replace(second, inertia=point_mass(1.0 + 1e-5, about=1e-3))))
    verdict = crosscheck_forward(run, ms.dynamics.dynamic_model(wrong, WEIGHT), InitialValues({"A": 0.3}, {}))
    assert verdict.outcome == "failed"
    assert "beyond the tolerance: step: position of P by" in verdict.reason


def test_softer_loops_show_the_error_of_compliance(monkeypatch):
    # loops too soft for the usual tolerance: the check measures their error
    monkeypatch.setattr(forward_run, "COMPLIANCE", 1e-3)
    model = ms.dynamics.dynamic_model(ms.catalog.make("four_bar"), WEIGHT)
    run = ms.dynamics.run(model, initial={"crank.v": 9.0}, duration=0.1, samples=10)
    verdict = crosscheck_forward(run, model, InitialValues({}, {"crank": 9.0}))
    assert verdict.passed, verdict
    assert any("by loops 10 times softer" in check.reason for check in verdict.checks)
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


def test_a_joint_reverses_between_sticking_joints():
    sizes = {"J0": 20.0, "J1": 0.6, "J2": 0.6}
    friction = tuple(ms.Friction(name, 0.3, torque) for name, torque in sizes.items())
    model = ms.dynamics.dynamic_model(
        stated_mechanism("forward_dynamics_check_arm.toml"),
        ms.Forces(gravity=(0.0, -9.81, 0.0), friction=friction),
    )
    run = ms.dynamics.run(model, initial={"J1.v": 0.5, "J2.v": 0.5}, duration=0.2, samples=40)
    rates = {name: joint.rate[-1] for name, joint in run.motion.joints.items()}
    # the weight of both outer links, 1.3 N m at the least, exceeds 0.6 N m
    assert rates["J1"] < -1.0
    assert rates["J0"] == pytest.approx(0.0, abs=1e-12)
    assert rates["J2"] == pytest.approx(0.0, abs=1e-12)
    initial = InitialValues({}, {"J1": 0.5, "J2": 0.5})
    verdict = crosscheck_forward(run, model, initial)
    assert verdict.passed, verdict
    stronger = (*friction[:1], ms.Friction("J1", 0.3, 0.61), friction[2])
    wrong = model.with_forces(replace(model.forces, friction=stronger))
    assert not crosscheck_forward(run, wrong, initial).passed


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


@pytest.mark.long
def test_mujoco_agrees_on_equilibria_and_their_stability():
    model = ms.dynamics.dynamic_model(with_inertia(double_pendulum()), WEIGHT)
    result = ms.dynamics.equilibria(model, starts=25)
    assert len(result) == 4
    for equilibrium in result:
        verdict = crosscheck_equilibrium(equilibrium, model)
        assert verdict.passed, verdict
        # accelerations, four eigenvalues, and those of MuJoCo
        assert len(verdict.checks) == 9


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


@pytest.mark.long
def test_dry_friction_does_not_hide_a_wrong_equilibrium():
    forces = ms.Forces(gravity=WEIGHT.gravity, friction=(ms.Friction("crank", 1e-4, 0.5),))
    model = ms.dynamics.dynamic_model(ms.catalog.make("four_bar"), forces)
    stable = ms.dynamics.equilibria(model, starts=6)[0]
    assert crosscheck_equilibrium(stable, model).passed
    tilted_gravity = ms.dynamics.dynamic_model(model.mechanism, replace(forces, gravity=(0.1, -9.81, 0.0)))
    assert crosscheck_equilibrium(stable, tilted_gravity).outcome == "failed"


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


# own integration of the equations of motion, and the limit of MuJoCo's runs for short steps
M3_AT_50_MS = -0.18738


def test_redundant_loops_of_an_agile_eye_do_not_brake_mujoco():
    model = ms.dynamics.dynamic_model(model_mechanism("forward_dynamics_check_agile_eye.toml"), WEIGHT)
    run = ms.dynamics.run(model, initial={"m1.q": np.radians(20.0)}, duration=0.05, samples=10)
    assert run.motion.joints["m3"].value[-1] == pytest.approx(M3_AT_50_MS, abs=5e-6)
    verdict = crosscheck_forward(run, model, InitialValues({"m1": np.radians(20.0)}, {}))
    assert verdict.passed, verdict


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
