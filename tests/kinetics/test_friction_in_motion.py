"""Runs under friction by the load: closed forms, equations by hand, and MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import load_model, model_text
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

import mechsim as ms
from mechsim import dynamics
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.compiled_model import NotCompiledError
from mechsim.kinetics.contacts import ContactMode, Contacts, least_load
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.equations_of_motion import equations_of_motion
from mechsim.mechanism.motors import ConstantTorque
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_forward

PRESS = model_text("friction_in_motion_press.toml")


@pytest.mark.parametrize("before", [1e-10, 1e-9, 1e-8])
def test_a_joint_just_before_its_dead_centre_does_not_stop_the_mechanism(before):
    # the coupler's joint on the crank reverses at 180 degrees, where the crank turns backwards
    friction = ms.Friction("B", coefficient=0.128, pin_radius=0.004, static=0.179, stribeck=0.2)
    forces = ms.Forces(friction=(friction,), motor=ConstantTorque(0.01))
    model = ms.dynamics.dynamic_model(ms.catalog.make("four_bar"), forces)

    def rate(start):
        run = ms.dynamics.run(model, initial={"crank.q": start, "crank.v": -3.0}, duration=0.3, samples=2)
        return run.motion.joints["crank"].rate[-1]

    assert rate(np.pi + before) == pytest.approx(rate(np.pi), rel=1e-6)


@pytest.mark.parametrize(("motion", "prescribed"), [("{}", []), ("{} + 3*t**2", ["crank"])])
def test_a_slide_at_its_dead_centre_has_friction_as_soon_as_it_moves(motion, prescribed, file):
    motor = ms.Forces() if prescribed else ms.Forces(motor=ConstantTorque(1.0))

    def run(start):
        press = ms.load(file(PRESS), drive={"crank": motion.format(start)} if prescribed else None)
        model = ms.dynamics.dynamic_model(press, replace(motor, friction=press.forces.friction))
        initial = {} if prescribed else {"crank.q": start}
        arguments = {"prescribed": prescribed, "initial": initial, "duration": 0.1, "samples": 4}
        return ms.dynamics.run(model, **arguments), model, initial_values(model, initial)

    first, model, initial = run(0.0)
    assert first.lost[-1] == pytest.approx(run(1e-7)[0].lost[-1], rel=1e-4)
    if not prescribed:
        assert crosscheck_forward(first, model, initial).passed


def test_a_released_slider_crank_needs_no_drive_torque(file):
    path = file(PRESS)
    run = ms.dynamics.run(path, initial={"crank.q": 0.3, "crank.v": 25.0}, duration=0.12, samples=40)
    motion, model = run.motion, ms.dynamics.dynamic_model(ms.load(path))
    forces = ms.dynamics.prescribed(model, motion.angle, motion.speed, motion.acceleration).forces
    # the torque of a prescribed motion is that by hand in test_load_friction
    assert np.abs(forces.torque * motion.speed).max() <= 1e-9 * forces.power_lost.max()
    assert len(run.events) == 1
    assert run.energy_error <= 1e-11
    assert run.executed == "C"


def ladder(file, floor, wall):
    text = model_text("friction_in_motion_ladder.toml", x=1.2, y=1.6, angle=np.rad2deg(np.arctan2(1.6, -1.2)))
    return file(text.replace("0.4 }", f"{floor} }}").replace("0.3 }", f"{wall} }}"))


def sliding_ladder(angle, rate, floor, wall):
    """Return angular accelerations of all signs of both normal forces for which a load that is off decays."""
    c, s = np.cos(angle), np.sin(angle)
    along = np.array([np.sign(s * rate), -np.sign(c * rate)])
    # 10 kg at the middle, 3 kg m2, unknown angular acceleration and normal forces
    free = np.array([[-10.0 * s, 0.0, -1.0], [10.0 * c, -1.0, 0.0], [-3.0, -c, s]])
    frictions = np.array([[1.0, 0.0], [0.0, 1.0], [s, -c]]) * along
    driving = 10.0 * np.array([c * rate**2, s * rate**2 - 9.81, 0.0])
    result = []
    for signs in np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]):
        loads = np.diag(signs * np.array([floor, wall])) @ np.eye(3)[1:]
        solution = np.linalg.solve(free - frictions @ loads, driving)
        growth = np.linalg.eigvals(loads @ np.linalg.solve(free, frictions)).real.max()
        if (signs * solution[1:] >= 0.0).all() and growth < 1.0:
            result.append(solution[0])
    return result


@pytest.mark.long
@pytest.mark.parametrize(("floor", "wall"), [(1.2, 1.2), (0.5, 3.0)])
def test_frictions_whose_loads_grow_slide_while_one_stable_solution_balances_them(floor, wall, file):
    """Normal forces change their sign within steps: an error of 6e-9 m, which grows to 8e-8 m."""
    start, rate = np.arctan2(1.6, 1.2), 3.75

    def motion(t, state):
        (acceleration,) = sliding_ladder(*state, floor, wall)
        return state[1], acceleration

    model = ms.dynamics.dynamic_model(ms.load(ladder(file, floor, wall), still=True))
    initial = {"floor.q": 1.2, "floor.v": -6.0}
    run = ms.dynamics.run(model, initial=initial, duration=0.1, samples=10)
    exact = solve_ivp(
        motion, (0.0, 0.1), (start, rate), t_eval=run.time, rtol=1e-10, atol=1e-12, max_step=1e-3
    )
    assert run.motion.joints["floor"].value == pytest.approx(2.0 * np.cos(exact.y[0]), abs=2e-7)
    assert run.energy_error <= 1e-11
    verdict = crosscheck_forward(run, model, initial_values(model, initial))
    assert verdict.passed, verdict


@pytest.mark.long
def test_a_run_ends_with_its_record_where_friction_jams_the_motion(file):
    with np.errstate(all="ignore"):
        run = ms.dynamics.run(
            ladder(file, 0.5, 3.0), initial={"floor.q": 1.2, "floor.v": -6.0}, duration=0.6, samples=20
        )
    assert run.outcome == "jammed"
    assert len(run.time) == 21
    assert run.energy_error <= 1e-11
    # the motion has a stable solution until there, and none right after
    angle = np.arccos(run.motion.joints["floor"].value[-1] / 2.0)
    rate = run.motion.joints["floor"].rate[-1] / (-2.0 * np.sin(angle))
    assert len(sliding_ladder(angle - 1e-6, rate, 0.5, 3.0)) == 1
    assert not sliding_ladder(angle + 1e-6, rate, 0.5, 3.0)


@pytest.mark.parametrize("seed", range(4))
def test_joints_at_rest_start_to_slide_by_the_principle_of_gauss(seed, file):
    """An arm at rest: accelerations a minimise (a - f)' M (a - f) / 2 + sum of T_i |a_i|, by scipy."""
    limits = np.random.default_rng(seed).uniform(0.2, 3.0, 5) * np.array([5.0, 3.0, 2.0, 1.0, 0.4])
    links = "".join(
        f'<body name="l{i}" pos="{0.2 if i else 0} 0 0">'
        f'<joint name="J{i}" axis="0 1 0" frictionloss="{limit}"/>'
        '<inertial mass="0.5" pos="0.1 0 0" diaginertia="1e-4 2e-3 2e-3"/>'
        for i, limit in enumerate(limits)
    )
    arm = file(f"<mujoco><worldbody>{links}{'</body>' * 5}</worldbody></mujoco>")
    equations = equations_of_motion(ms.dynamics.dynamic_model(ms.load(arm, still=True)))
    contacts = Contacts(equations)
    state = equations.kinematics(equations.start, np.zeros((5, 1)))
    mode = contacts.choose(state, 0.0, 0.0)
    result = contacts.accelerate(state, np.zeros(1), mode).acceleration[:, 0]
    free = contacts.accelerate(state, np.zeros(1), ContactMode(np.zeros(5))).acceleration[:, 0]
    mass = state.mass[0]

    def smooth(split):
        apart = split[:5] - split[5:] - free
        gradient = mass @ apart
        return apart @ gradient / 2 + limits @ (split[:5] + split[5:]), np.concatenate(
            [gradient + limits, limits - gradient]
        )

    best = minimize(
        smooth, np.zeros(10), jac=True, bounds=[(0, None)] * 10, options={"ftol": 1e-16, "gtol": 1e-12}
    )
    expected = best.x[:5] - best.x[5:]
    assert result == pytest.approx(expected, abs=1e-4 * np.abs(free).max())
    assert len(mode.stuck) not in (0, 5)


CLAMP = model_text("latch_clamp.toml")


@pytest.mark.parametrize("compiled", [True, pytest.param(False, marks=pytest.mark.long)])
def test_a_clamp_reverses_within_the_narrow_curve_of_stribeck(compiled, file, monkeypatch):
    if not compiled:
        monkeypatch.setattr("mechsim.kinetics.forward_dynamics.compiled_model", not_compiled)
    clamp = ms.load(file(CLAMP), still=True)
    run = ms.dynamics.run(clamp, initial={"handle.q": "119.1deg"}, duration="0.08s")
    assert run.executed == ("C" if compiled else "numpy")
    # by Newton's and Euler's equations of three bodies with all reactions, DOP853 at 1e-12, steps of 10 us
    assert np.allclose(run.events, [0.030469177301622, 0.060230287316856], rtol=0, atol=1e-12)
    assert run.energy_error < 1e-11


def not_compiled(equations):
    raise NotCompiledError("this model")


def test_a_friction_without_a_load_holds_nothing():
    # two frictions share a force of 35; the first one's limit is zero but for rounding
    shared = np.array([[1.0], [-1.0]]) / np.sqrt(2.0)
    assert least_load(np.array([10.0, 25.0]), shared, np.array([1e-33, 50.0])) == pytest.approx(0.7)


def test_friction_by_rate_acts_in_a_prescribed_motion_by_both_methods():
    solver = load_model(
        "load_friction_slider_crank.toml",
        ("coefficient = 0.1 }", 'coefficient = 0.1, static = 0.3, stribeck = "0.5 m/s" }'),
        more="[forces.loads.press]\nat = { link = 'slider' }\nforce = ['-300 N', 0, 0]",
    )
    model = dynamics.dynamic_model(solver)
    run = driven(model.mechanism, model.forces, speed=25.0, samples=12)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    study = dynamics.prescribed(model, run.motion.angle, 25.0)
    joints = model.solver.solve(run.motion.angle, 25.0).joints
    slide, normal = joints["slide"].rate, study.forces.reactions["slide"].force[:, 1]
    curve = 0.1 + 0.2 * np.exp(-((slide / 0.5) ** 2))
    # the power of all friction less that of the pins
    pins = np.zeros(13)
    for name, moment in (("crank", 0.15 * 8e-3), ("A", 0.2 * 6e-3), ("B", 0.25 * 5e-3)):
        load = np.linalg.norm(study.forces.reactions[name].force[:, :2], axis=1)
        pins += (moment * load + 0.01 * (name == "A")) * np.abs(joints[name].rate)
    expected = curve * np.abs(normal * slide)
    assert study.forces.power_lost - pins == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.long
def test_bristles_bring_a_small_motion_to_rest_in_c():
    """Errors relative to a creep of 0.4 mrad are near rounding, which shorter steps would not reduce.

    At rest the bristles hold the weight, by virtual work: k sum of z_i dq_i = -dV.
    """
    names = ("crank", "crank2", "A")
    rows = tuple(
        ms.Friction(name, coulomb=1e-3, bristle_stiffness=1.0, bristle_damping=1e-3) for name in names
    )
    model = dynamic_model(ms.load("warp_knitter"), ms.Forces(gravity=(0.0, -9.81, 0.0), friction=rows))
    run = ms.dynamics.run(model, duration=0.3, samples=900)
    assert (run.outcome, run.executed) == ("done", "C")
    assert run.energy_error <= 1e-10
    values = [run.motion.joints[name].value for name in names]
    along = (values[0] - values[0][-1]) / np.ptp(values[0])

    def derivative(course):
        return np.polyfit(along, course - course[-1], 3)[-2]

    carried = sum(z[-1] * derivative(value) for z, value in zip(run.activation, values, strict=True))
    assert abs(carried + derivative(run.potential)) <= 1e-5 * abs(carried)
