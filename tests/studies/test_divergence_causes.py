"""Each seeded cause of divergence is reported and distinguished from the others."""

from dataclasses import replace

import pytest
from scene_texts import CONTROL, FINGER, scene

from mechsim.simulation.plain_settings import PlainSettings
from mechsim.studies.scene.errors import divergence_reason
from mechsim.studies.scene.run import run_scene

RINGING = PlainSettings(integrator="RK4", solref=(-1e9, -1.0), solimp=(0.9999, 0.9999, 0.001, 0.5, 2.0))


def divergence_of(folder, text=FINGER, settings=RINGING, **motion):
    item = scene(folder, text=text, **(motion or {"ctrl": CONTROL}))
    run = run_scene(item, settings.applied(item.model))
    assert run.broken
    return divergence_reason(run)


STIFF = {
    "the damper of joint swing": ('damping="0.001"', 'damping="0.02"'),
    "the spring of joint swing": ('stiffness="0.05"', 'stiffness="5e6"'),
    "actuator servo": ('kp="0.5" kv="0.02"', 'kp="0.5" kv="2"'),
}


@pytest.mark.parametrize("element", STIFF)
def test_the_stiff_element_is_reported_with_a_stable_step(tmp_path, element):
    text, rk4 = FINGER.replace(*STIFF[element]), PlainSettings(integrator="RK4", timestep=5e-4)
    reason = divergence_of(tmp_path, text, rk4)
    assert reason.startswith(f"stiffness: {element} needs steps below")
    stable_step = float(reason.split("below ")[1].split(" s")[0])
    item = scene(tmp_path, text=text, ctrl=CONTROL, duration=500 * stable_step)
    assert not run_scene(item, replace(rk4, timestep=0.8 * stable_step).applied(item.model)).broken
    assert run_scene(item, replace(rk4, timestep=3.0 * stable_step).applied(item.model)).broken


def test_a_diverging_joint_limit_is_reported(tmp_path):
    limited = FINGER.replace(
        '<joint name="swing"',
        '<joint name="swing" limited="true" range="-0.001 0.001" solreflimit="-1e12 -1"',
    )
    result = divergence_of(tmp_path, limited, PlainSettings(refsafe=False), ctrl={"servo": "5*sin(20*t)"})
    assert "a limit" in result
    assert "swing" in result


def test_a_converged_run_has_no_divergence_reason(tmp_path):
    assert divergence_reason(run_scene(scene(tmp_path, ctrl=CONTROL))) == ""
