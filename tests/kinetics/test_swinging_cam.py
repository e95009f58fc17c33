"""A swinging follower under a spring: at rest on a dwell, and in motion against Lagrange's equation."""

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.simulation.dynamics.forward_run import stepped_run
from mechsim.studies.dynamics_check import crosscheck_forward

MOMENT, LIGHT = 1e-3, 1e-9
# lever: mass, distance of its centre, moment about the pivot; spring
MASS, CENTRE, STIFFNESS, G = 0.02, 0.035, 5.0, 9.81
LEVER = 1e-5 + MASS * CENTRE**2
RISE, LIFT = np.radians(120.0), np.radians(15.0)
# law of cosines: arm 70 mm, centres 80 mm, base and roller 38 mm
START = np.arccos((0.08**2 + 0.07**2 - 0.038**2) / (2 * 0.08 * 0.07))


def model_of(folder, moment):
    path = folder / "cam.toml"
    path.write_text(model_text("swinging_cam.toml", moment=moment))
    return dynamic_model(ms.load(str(path), still=True))


def arm(q):
    """Return the angle of the arm and its first two derivatives on the cycloidal rise and before it."""
    if q < 0.0:
        return START, 0.0, 0.0
    u, w = q / RISE, 2 * np.pi
    return (
        START + LIFT * (u - np.sin(w * u) / w),
        LIFT / RISE * (1 - np.cos(w * u)),
        LIFT / RISE**2 * w * np.sin(w * u),
    )


def equation(_, state):
    """Lagrange: (I + J psi'^2) q'' + J psi' psi'' q'^2 + (k psi + m g c cos(psi)) psi' = 0."""
    q, v = state
    psi, first, second = arm(q)
    load = STIFFNESS * psi + MASS * G * CENTRE * np.cos(psi)
    return v, -(LEVER * first * second * v**2 + load * first) / (MOMENT + LEVER * first**2)


@pytest.mark.long
@pytest.mark.parametrize("initial", [{"cam.q": "25deg"}, {"cam.v": 6.0}])
def test_a_released_cam_against_lagrange(initial, tmp_path):
    model = model_of(tmp_path, MOMENT)
    run = ms.dynamics.run(model, initial=initial, duration=0.06, samples=30)
    start = [np.radians(25.0), 0.0] if "cam.q" in initial else [0.0, 6.0]
    exact = solve_ivp(equation, (0.0, 0.06), start, "DOP853", run.time, rtol=1e-13, atol=1e-13).y
    assert np.abs(run.motion.joints["cam"].value - exact[0]).max() < 1e-9
    assert np.abs(run.motion.joints["pivot"].value + [arm(q)[0] for q in exact[0]]).max() < 1e-9
    verdict = crosscheck_forward(run, model, initial_values(model, initial))
    assert verdict.passed, str(verdict)


@pytest.mark.long
@pytest.mark.parametrize("angle", ["0deg", "-30deg", "-50deg"])
def test_a_preloaded_follower_on_a_dwell_stays_at_rest(angle, tmp_path):
    run = ms.dynamics.run(model_of(tmp_path, LIGHT), initial={"cam.q": angle}, duration="1s")
    assert (run.outcome, run.motion.time[-1]) == ("stopped", 1.0)
    assert not run.motion.joints["cam"].rate.any()


@pytest.mark.long
def test_a_light_cam_does_not_make_its_contact_compliant_in_mujoco(tmp_path):
    model = model_of(tmp_path, LIGHT)
    stepped = stepped_run(model.mechanism, model.forces, {}, {}, np.linspace(0.0, 1.0, 101), 10)
    pivot = stepped.motion.joints["pivot"].value
    # 1e-4 rad with the mobility of the cam, which does not move
    assert np.abs(pivot + START).max() < 1e-7
