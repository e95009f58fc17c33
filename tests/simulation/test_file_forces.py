"""Forces of an MJCF file: the analytic run against MuJoCo stepping the file, and their balance in it."""

from collections import defaultdict
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from model_files import copied, model_text

import mechsim as ms
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.studies.dynamics_check import crosscheck_forward

ARM = model_text("tendon_arm.xml")
TIME = 0.1
POLYNOMIALS = hasattr(mujoco.MjModel, "jnt_stiffnesspoly")
# what the file has; MuJoCo's actuators without a control are springs here
CASES = {
    "plain": {},
    "damper of a ball": {"ball": 'damping=".05"'},
    "spring between sites": {"line": 'stiffness="300" springlength=".3"'},
    "spring as long as at the start": {"line": 'stiffness="300" damping="2"'},
    "rope": {"line": 'stiffness="300" springlength="0 .35"'},
    "spring of two joints": {"pair": 'stiffness="3" springlength=".5" damping=".1" armature=".02"'},
    "servo between sites": {"actuator": '<position tendon="line" kp="200" kv="5" gear="2"/>'},
    "limited servo between sites": {
        "actuator": '<position tendon="line" kp="200" forcerange="-99 9" ctrlrange="0 1"/>'
    },
    "servo with a state": {
        "actuator": '<general tendon="line" dyntype="filter" dynprm=".1" biastype="affine" '
        'biasprm="1 -30 -2"/>'
    },
    "compensated weight": {"gravcomp": "0.7"},
    "no springs": {"line": 'stiffness="300"', "j": 'stiffness="9"', "flags": '<flag spring="disable"/>'},
    "no dampers": {"line": 'damping="30"', "j": 'damping="9"', "flags": '<flag damper="disable"/>'},
    "no actuators": {
        "actuator": '<position tendon="line" kp="200"/>',
        "flags": '<flag actuation="disable"/>',
    },
}
if POLYNOMIALS:
    CASES |= {
        "polynomials of a joint": {"j": 'stiffness="1 20 30" damping=".01 .05 .02" springref="-20"'},
        "polynomials of a line": {"line": 'stiffness="100 300 20" springlength=".3 .35" damping="1 2 1"'},
    }


def loaded(case):
    """Return the solver of a case, its run, and the final coordinates of MuJoCo's run of the file."""
    text = ARM.format_map(defaultdict(str, {"gravcomp": "0", **case}))
    solver = ms.load(copied(text, ".xml"), still=True)
    plain = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(plain)
    mujoco.mj_step(plain, data, nstep=round(TIME / plain.opt.timestep))
    model = ms.dynamics.dynamic_model(solver, solver.forces)
    return model, ms.dynamics.run(model, duration=TIME, samples=4), data


@pytest.mark.parametrize("name", CASES)
def test_the_run_is_that_of_mujoco_stepping_the_file(name):
    model, run, data = loaded(CASES[name])
    assert model.solver.source.left_out == ()
    joints = [float(run.motion.joints[name].value[-1]) for name in "jk"]
    assert np.abs(joints - data.qpos[:2]).max() < 1e-8
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, data.qpos[2:])
    assert np.abs(run.motion.links["bob"].rotation[-1] - rotation.reshape(3, 3)).max() < 1e-8
    assert run.energy_error < 1e-10


def checks_of(run, model):
    """Return the checks of a run in MuJoCo by their kind."""
    return {check.kind: check for check in crosscheck_forward(run, model, initial_values(model, {})).checks}


def test_forces_that_are_not_computed_are_not_balanced_in_the_file():
    model, run, _ = loaded({"ball": 'frictionloss=".05"'})
    assert "forces of the file" not in checks_of(run, model)


@pytest.mark.parametrize("name", ["damper of a ball", "servo with a state", "spring of two joints"])
def test_the_balance_in_the_file_rejects_a_force_that_was_not_read(name):
    model, run, _ = loaded(CASES[name])
    balance = checks_of(run, model)["forces of the file"]
    assert balance.worst < 1e-6 * balance.tolerance
    weight = ms.Forces(gravity=model.forces.gravity)
    unread = replace(model.solver, source=replace(model.solver.source, forces=weight), forces=weight)
    incomplete = ms.dynamics.dynamic_model(unread, weight)
    run = ms.dynamics.run(incomplete, duration=TIME, samples=4)
    failed = [kind for kind, check in checks_of(run, incomplete).items() if not check.passed]
    # MuJoCo's model from the forces as they were read agrees all the same
    assert failed == ["forces of the file"]
