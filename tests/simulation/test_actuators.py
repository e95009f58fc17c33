"""Actuators of an MJCF file: the analytic run against plain MuJoCo, which converges to it with its order."""

import mujoco
import numpy as np
import pytest
from model_files import copied, model_text

import mechsim as ms
from mechsim.io.law_text import with_controls
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.studies.dynamics_check import crosscheck_forward

ARM = model_text("actuators_arm.xml")
# actuator, its control, and the order with which RK4 converges: limits and filterexact reduce it
CASES = {
    "motor": ('<motor joint="j1" gear="2"/>', "3*sin(5*t)", 4),
    "position": ('<position joint="j2" kp="20" kv="1"/>', "20deg*sin(3*t)", 4),
    "velocity": ('<velocity joint="j1" kv=".3"/>', "cos(t)", 4),
    "intvelocity": ('<intvelocity joint="j3" kp="50" kv="2" actrange="-9 9"/>', "0.2*cos(t)", 4),
    "damper": ('<damper joint="j2" kv="0.5" ctrlrange="0 9"/>', "1+sin(t)", 4),
    "affine": (
        '<general tendon="t" dyntype="filter" dynprm="0.05" gaintype="affine" gainprm="1 0.2 .1" '
        'biastype="affine" biasprm="0.1 -2 -0.1" gear="1.5"/>',
        "2*sin(2*t)",
        4,
    ),
    "filterexact": ('<general joint="j3" dyntype="filterexact" dynprm="0.1" gainprm="5"/>', "1+t", 1),
    "integrator": ('<general joint="j2" dyntype="integrator" gainprm="2"/>', "cos(3*t)", 4),
    "ctrlrange": ('<motor joint="j2" ctrlrange="-1 1"/>', "2*sin(4*t)", 1),
    "forcerange": ('<position joint="j2" kp="20" forcerange="-1 2"/>', "1*sin(3*t)", 1),
    "actrange": ('<intvelocity joint="j3" kp="50" actrange="-.05 .05"/>', "0.4", 1),
}
if hasattr(mujoco.mjtGain, "mjGAIN_PID"):
    CASES |= {
        "pid": ('<pid joint="j2" kp="20" kv="1"/>', "20deg*sin(3*t)", 4),
        "pid with integral": ('<pid joint="j2" kp="20" kv="1" ki="30"/>', "20deg*sin(3*t)", 4),
        "dcmotor": ('<dcmotor joint="j1" resistance="2" motorconst="0.3 0.3"/>', "20*sin(5*t)", 4),
    }
TIME = 0.4


def model_of(case):
    actuator, text, order = CASES[case]
    path = copied(ARM.format(actuator.replace(" ", ' name="u" ', 1)), ".xml")
    solver = ms.load(path, still=True)
    forces = with_controls(solver.forces, {"u": text})
    return ms.dynamics.dynamic_model(solver, forces), path, order


def plainly_stepped(path, model, step):
    """Return the final qpos of the user's file, stepped by RK4 with the control of the model's actuator."""
    plain = mujoco.MjModel.from_xml_path(path)
    plain.opt.integrator, plain.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, step
    data, (actuator,) = mujoco.MjData(plain), model.forces.actuators

    def control(_, state):
        state.ctrl[0] = float(np.ravel(actuator.control(np.array([state.time]))[0])[0])

    mujoco.set_mjcb_control(control)
    try:
        mujoco.mj_step(plain, data, nstep=round(TIME / step))
    finally:
        mujoco.set_mjcb_control(None)
    return data.qpos.copy()


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_plain_mujoco_converges_to_the_analytic_run(case):
    model, path, order = model_of(case)
    run = ms.dynamics.run(model, duration=TIME, samples=4)
    exact = np.array([run.motion.joints[name].value[-1] for name in ("j1", "j2", "j3")])
    coarse, fine = (np.abs(plainly_stepped(path, model, step) - exact).max() for step in (4e-3, 1e-3))
    assert coarse > 1e-8 or order == 1
    assert fine < max(coarse / (3.0 if order == 1 else 4.0**3.5), 1e-11)
    assert run.energy_error < 1e-10


@pytest.mark.long
@pytest.mark.parametrize("case", ["position", "affine", "intvelocity", "forcerange"])
def test_the_check_passes_and_rejects_another_actuator(case):
    model, _, _ = model_of(case)
    run = ms.dynamics.run(model, duration=0.2, samples=10)
    verdict = crosscheck_forward(run, model, initial_values(model, {}))
    assert verdict.passed, str(verdict)
    other = model.with_forces(with_controls(model.forces, {"u": "0.01+" + CASES[case][1]}))
    assert not crosscheck_forward(run, other, initial_values(other, {})).passed


@pytest.mark.skipif("pid" not in CASES, reason="MuJoCo has pid from version 4 on")
def test_a_file_with_two_controls_of_one_actuator_is_checked(file):
    assert ms.check(file(ARM.format('<pid name="u" joint="j2" kp="20" kv="1"/>'))) is not None
